#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "field/field.hpp"
#include "protocols/harting/device.hpp"
#include "protocols/harting/device_settings.hpp"
#include "protocols/harting/tag_command.hpp"
#include "testkit/script.hpp"
#include "testkit/vectors.hpp"

// What the tests of the virtual reader share: tags in a field, a host on the wire, a hand on each fault.
namespace gantry::harting::device_test {

using testkit::hex;
inline constexpr std::string_view tag_1 = "300833B2DDD9014035050001", tag_2 = "300833B2DDD9014035050002",
                                  tag_3 = "300833B2DDD9014035050003";

// "serial=true boot=3s"
inline Settings device_with(std::string_view list) {
    std::vector<std::pair<std::string, std::string>> given;
    while (!list.empty()) {
        auto each = list.substr(0, list.find(' '));
        auto equals = each.find('=');
        given.emplace_back(each.substr(0, equals), each.substr(equals + 1));
        list.remove_prefix(std::min(each.size() + 1, list.size()));
    }
    auto settings = Settings::make(device_settings, given);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return *settings;
}

inline Bytes taken(Party& party) {
    Bytes out(party.output().begin(), party.output().end());
    party.output_sent(out.size());
    return out;
}

struct Reply {
    std::uint8_t address = 0, control = 0;
    Status status{};
    Bytes data;
};
inline std::vector<Reply> replies(ByteView bytes) {
    std::vector<Reply> all;
    while (!bytes.empty()) {
        auto look = look_at(bytes, wire::Direction::to_host);
        EXPECT_EQ(look.what, Look::What::frame) << to_hex(bytes);
        if (look.what != Look::What::frame) break;
        auto& frame = look.frame;
        all.push_back({frame.address, frame.control, static_cast<Status>(frame.status),
                       Bytes(frame.data.begin(), frame.data.end())});
        bytes = bytes.subspan(look.size);
    }
    return all;
}

inline Bytes request(std::uint8_t control, ByteView data, std::uint8_t address = any_address) {
    Bytes frame;
    append_request(frame, address, control, data);
    return frame;
}
inline Bytes request(Command command, std::string_view data = "", std::uint8_t address = any_address) {
    auto bytes = hex(data);
    if (has_sub(control_of(command))) bytes.insert(bytes.begin(), sub_of(command));
    return request(control_of(command), bytes, address);
}

// Records of a [0x22] reply.
struct Records {
    std::vector<Observation> tags;
    std::vector<InputEvent> events;
    Bytes bank;
    Walked walked;

    std::vector<std::string> ids() const {
        std::vector<std::string> all;
        for (auto& tag : tags)
            all.push_back(to_hex(tag.tag.view()));
        return all;
    }
};
inline Records records_of(const Reply& reply, const WalkOptions& options = {}) {
    Records records;
    records.walked = walk_buffer(reply.data, 0, options, records.tags, records.bank, records.events);
    EXPECT_FALSE(records.walked.fault) << records.walked.fault->text();
    return records;
}

struct Bench {
    explicit Bench(std::string_view given = {}, std::uint64_t seed = 3)
        : air(field.add_reader("reader", 4, 20)), device({"reader", seed, device_with(given)}, air) {}

    void places(std::string_view epc, std::uint16_t antenna = 1, double rssi = -50,
                const std::function<void(field::TagSpec&)>& change = {}) {
        field::TagSpec spec;
        spec.id = event::TagId(hex(epc));
        spec.tid = hex("E280116060000205" + std::string(epc.substr(epc.size() - 8)));
        spec.user = hex("000102030405060708090A0B0C0D0E0F");
        if (change) change(spec);
        field.place(air, {spec, antenna, rssi});
    }
    void removes(std::string_view epc) { field.remove(air, event::TagId(hex(epc))); }

    void starts() {
        device.power_on(now);
        waits(1s);
        device.start(now);
    }
    void gets(ByteView bytes) { device.received(bytes, now); }
    void does(std::string_view fault) {
        auto done = device.inject(fault, now);
        EXPECT_TRUE(done) << done.error().text();
    }
    void waits(std::chrono::microseconds time) {
        auto end = now + time;
        for (auto due = device.deadline(); due && *due <= end.steady; due = device.deadline()) {
            if (*due > now.steady)
                now = now + std::chrono::ceil<std::chrono::microseconds>(*due - now.steady);
            device.time_passed(now);
            auto again = device.deadline();
            ASSERT_TRUE(!again || *again > now.steady) << "a deadline that does not move on";
        }
        now = end;
    }
    // Sends one request and takes its answer.
    Reply ask(const Bytes& bytes) {
        gets(bytes);
        if (device.output().empty()) waits(1s);
        auto all = replies(taken(device));
        EXPECT_EQ(all.size(), 1u) << to_hex(bytes);
        return all.empty() ? Reply{} : all.front();
    }
    Reply ask(Command command, std::string_view data = "") { return ask(request(command, data)); }
    Status status(Command command, std::string_view data = "") { return ask(command, data).status; }
    void sets(std::string_view name, std::string_view value, bool eeprom = false) {
        auto& row = config_row(name);
        Bytes all;
        for (std::size_t i = 0; i < blocks_of(row); ++i) {
            auto data =
                ask(request(control_of(Command::read_configuration), Bytes{block_number(row, i, eeprom)}))
                    .data;
            ASSERT_EQ(data.size(), block_size) << name;
            all.insert(all.end(), data.begin(), data.end());
        }
        auto done = set(row, wire::Value(std::string(value)), all);
        ASSERT_TRUE(done) << done.error().text();
        for (std::size_t i = 0; i < blocks_of(row); ++i) {
            Bytes data{block_number(row, i, eeprom)};
            auto from = all.begin() + static_cast<std::ptrdiff_t>(i * block_size);
            data.insert(data.end(), from, from + block_size);
            ASSERT_EQ(ask(request(control_of(Command::write_configuration), data)).status, Status::ok)
                << name;
        }
    }
    // After a reset: the link is lost, and dialled again when the reader is back.
    void reconnects() {
        EXPECT_TRUE(device.finished());
        (void)taken(device);
        device.link_lost(now);
        waits(3s);
        device.start(now);
    }
    std::int64_t state(std::string_view name) const {
        auto fields = device.state();
        const auto* value = wire::find(fields, name);
        EXPECT_NE(value, nullptr) << name;
        if (const auto* yes = value->get<bool>()) return *yes ? 1 : 0;
        return *value->get<std::int64_t>();
    }
    std::string state_text(std::string_view name) const {
        auto fields = device.state();
        return *wire::find(fields, name)->get<std::string>();
    }

    field::Field field;
    Air& air;
    Now now = testkit::script_start;
    HartingDevice device;

private:
    static std::uint8_t block_number(const ConfigRow& row, std::size_t more, bool eeprom) {
        return static_cast<std::uint8_t>((row.block + more) | (eeprom ? cfg_eeprom : 0u));
    }
};

// On the bench and switched on.
struct Reader : Bench {
    explicit Reader(std::string_view given = {}, bool tag = true) : Bench(given) {
        if (tag) places(tag_1);
        starts();
    }
};

}  // namespace gantry::harting::device_test
