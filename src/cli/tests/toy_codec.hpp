#pragma once
#include <algorithm>

#include "wire/layout.hpp"

namespace gantry::cli::test {

// 55 SIZE, then SIZE bytes of one field `Data`; `kind` in the header says the first of them where there is
// one.
class ToyCodec final : public wire::Codec {
public:
    wire::Decoded decode(ByteView input, wire::Direction, bool end) const override {
        if (input[0] != 0x55) {
            auto next = std::find(input.begin(), input.end(), 0x55);
            return {static_cast<std::size_t>(next - input.begin()), false,
                    tl::unexpected(wire::Fault{wire::Errc::bad_value, 0, "start"})};
        }
        std::size_t size = input.size() < 2 ? 2 : 2u + input[1];
        if (input.size() < size) {
            if (!end) return {0, true, {}};
            return {input.size(), false,
                    tl::unexpected(wire::Fault{wire::Errc::truncated, input.size(), "frame"})};
        }
        auto data = input.subspan(2, size - 2);
        wire::Message message{"Data", {}, {{"Data", Bytes(data.begin(), data.end())}}};
        return {size, false, message};
    }
    wire::Result<void> encode(const wire::Message& message, wire::Direction, Bytes& out) const override {
        auto raw = wire::as_raw(*wire::find(message.fields, "Data"));
        out.push_back(0x55);
        out.push_back(static_cast<std::uint8_t>(raw->size()));
        out.insert(out.end(), raw->begin(), raw->end());
        return {};
    }
    wire::Result<void> check(const wire::Message&, wire::Direction) const override { return {}; }
    std::vector<std::string_view> names(wire::Direction) const override { return {"Data", "Date"}; }
    std::vector<std::string_view> field_names(std::string_view message, wire::Direction) const override {
        return message == "Data" ? std::vector<std::string_view>{"Data"} : std::vector<std::string_view>{};
    }
};

// Claims nothing and wants nothing: a decoder with a bug.
class StuckCodec final : public wire::Codec {
public:
    wire::Decoded decode(ByteView, wire::Direction, bool) const override { return {}; }
    wire::Result<void> encode(const wire::Message&, wire::Direction, Bytes&) const override { return {}; }
    wire::Result<void> check(const wire::Message&, wire::Direction) const override { return {}; }
    std::vector<std::string_view> names(wire::Direction) const override { return {}; }
    std::vector<std::string_view> field_names(std::string_view, wire::Direction) const override { return {}; }
};

}  // namespace gantry::cli::test
