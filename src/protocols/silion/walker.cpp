#include "protocols/silion/walker.hpp"

#include <algorithm>
#include <cstring>

#include <fmt/format.h>

namespace gantry::silion {

using event::TagId;
using event::Technology;

static constexpr std::array<Technology, 256> technologies = [] {
    std::array<Technology, 256> table{};
    table[3] = Technology::iso18000_6b;
    table[5] = Technology::epc_gen2;
    table[6] = Technology::iso18000_6b;
    return table;
}();

static void copy_id(TagId& id, const std::uint8_t* from, std::size_t size) {
    id.size = static_cast<std::uint8_t>(size);
    if (size == 12) {  // EPC-96, nearly always: one fixed copy
        std::memcpy(id.data.data(), from, 12);
    } else {
        std::memcpy(id.data.data(), from, size);
    }
}

struct Pass {
    std::uint32_t records = 0;
    std::uint32_t unusable = 0;
    std::uint64_t reads = 0;
    std::size_t end = 0;          // where the pass stopped
    const char* field = nullptr;  // that does not fit; nullptr: all records are whole
};

// One pass with `width` bytes of bank length (docs/protocols/silion.md section 5).
template <std::size_t width>
static Pass pass(ByteView data, std::vector<Observation>& out, Bytes& bank) {
    constexpr std::size_t fixed = 5 + width;  // a record without its EPC and bank data
    Pass pass;
    std::uint32_t count = static_cast<std::uint32_t>(data[0]) << 8 | data[1];
    const auto* at = data.data() + 2;
    const auto* const end = data.data() + data.size();
    auto before = out.size();
    // A count that lies makes room for no more records than the bytes can hold.
    out.resize(before + std::min<std::size_t>(count, static_cast<std::size_t>(end - at) / fixed));
    auto* next = out.data() + before;
    for (; pass.records < count; ++pass.records) {
        auto left = static_cast<std::size_t>(end - at);
        if (left < fixed) {
            pass.field = left < 5 ? "Tags" : "BankData";
            break;
        }
        std::size_t id_size = at[4];
        if (left < fixed + id_size) {
            pass.field = left < 5 + id_size ? "Epc" : "BankData";
            break;
        }
        const auto* id = at + 5;
        const auto* length = id + id_size;
        std::size_t bank_size = width == 1 ? length[0] : static_cast<std::size_t>(length[0] << 8 | length[1]);
        if (left - fixed - id_size < bank_size) {
            pass.field = "BankData";
            break;
        }
        if (id_size - 1 >= TagId::max_size) [[unlikely]] {  // 0, or longer than any tag's
            ++pass.unusable;
        } else {
            auto& o = *next++;
            copy_id(o.tag, id, id_size);
            o.technology = technologies[at[3]];
            o.antenna = at[0];
            o.rssi = static_cast<std::int16_t>(static_cast<std::int8_t>(at[2]) * 10);
            o.reads = std::max<std::uint16_t>(at[1], 1);
            pass.reads += o.reads;
            if (bank_size > 0) [[unlikely]] {
                o.data_size = static_cast<std::uint16_t>(bank_size);
                o.data_offset = static_cast<std::uint32_t>(bank.size());
                bank.insert(bank.end(), length + width, length + width + bank_size);
            }
        }
        at = length + width + bank_size;
    }
    out.resize(static_cast<std::size_t>(next - out.data()));
    pass.end = static_cast<std::size_t>(at - data.data());
    return pass;
}

Walked walk_tags(ByteView data, std::size_t base, std::vector<Observation>& out, Bytes& bank) {
    Walked walked;
    if (data.size() < 2) {
        walked.fault = wire::Fault{wire::Errc::truncated, base, "Tags"};
        return walked;
    }
    auto out_size = out.size(), bank_size = bank.size();
    auto undo = [&] {
        out.resize(out_size);
        bank.resize(bank_size);
    };
    auto done = pass<1>(data, out, bank);
    if (done.field != nullptr || done.end != data.size()) [[unlikely]] {
        undo();
        auto wide = pass<2>(data, out, bank);
        walked.wide = wide.field == nullptr && wide.end == data.size();
        if (walked.wide) {
            done = wide;
        } else {
            undo();
            done = pass<1>(data, out, bank);
            if (done.field != nullptr)
                walked.fault = wire::Fault{wire::Errc::truncated, base + done.end, done.field,
                                           fmt::format("record {} of the tags is cut off", done.records + 1)};
            else
                walked.fault =
                    wire::Fault{wire::Errc::trailing_bytes, base + done.end, "Tags",
                                fmt::format("{} bytes after the last tag", data.size() - done.end)};
        }
    }
    walked.records = done.records;
    walked.unusable = done.unusable;
    walked.reads = done.reads;
    return walked;
}

}  // namespace gantry::silion
