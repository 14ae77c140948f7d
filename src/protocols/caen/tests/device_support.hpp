#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "protocols/caen/device.hpp"
#include "protocols/caen/device_settings.hpp"
#include "testkit/script.hpp"
#include "testkit/vectors.hpp"

// What the tests of the virtual reader share: tags on a shelf, a host with a pen, a hand on each fault.
namespace gantry::caen::device_test {

using testkit::hex;
using Given = std::vector<std::pair<std::string, std::string>>;  // settings

inline Settings device_with(const Given& given = {}) {
    auto settings = Settings::make(device_settings, given);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return *settings;
}

inline event::TagId id_of(std::string_view text) {
    return event::TagId(hex(text));
}

// Tags of any kind that lie in front of an antenna, each heard every 50 ms.
class Shelf final : public Air {
public:
    struct Tag {
        event::TagId id;
        event::Technology technology = event::Technology::epc_gen2;
        std::uint16_t antenna = 1;
        std::int16_t rssi = -500;
        std::map<Bank, Bytes> banks = {};  // other kinds: one memory, in Bank::user
        std::uint32_t kill_password = 0;
        bool away = false;
        std::map<std::uint32_t, bool> locked = {};
        std::uint16_t lock_mask = 0, lock_action = 0;
    };
    std::vector<Tag> tags;
    std::optional<AirError> refuses;  // what every access is answered with
    std::vector<std::uint16_t> connected{1, 2, 3, 4};
    std::vector<double> powers;  // of the inventories so far
    std::uint32_t last_password = 0;

    Tag& add(std::string_view id, event::Technology technology = event::Technology::epc_gen2,
             std::uint16_t antenna = 1) {
        tags.push_back({.id = id_of(id), .technology = technology, .antenna = antenna});
        auto& tag = tags.back();
        auto view = tag.id.view();
        if (technology != event::Technology::epc_gen2) {
            tag.banks[Bank::user] = Bytes(view.begin(), view.end());
            tag.banks[Bank::user].resize(64);
            return tag;
        }
        tag.banks[Bank::reserved] = Bytes(8);
        tag.banks[Bank::tid] = hex("E2801160600002051234ABCD");
        tag.banks[Bank::user] = Bytes(32, 0x11);
        auto& epc = tag.banks[Bank::epc];
        epc = {0xC0, 0xDE, static_cast<std::uint8_t>(view.size() / 2 << 3), 0};
        epc.insert(epc.end(), view.begin(), view.end());
        return tag;
    }

    void inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) override {
        powers.push_back(carrier.power_dbm);
        auto beat = std::chrono::duration_cast<Steady::duration>(50ms);
        for (auto& tag : tags) {
            if (tag.away || tag.antenna != carrier.antenna) continue;
            auto at = Steady{} + (from.time_since_epoch() + beat - Steady::duration{1}) / beat * beat;
            for (; at < to; at += beat)
                out.push_back({tag.id, tag.technology, tag.rssi, at});
        }
    }
    std::vector<std::uint16_t> antennas() const override { return connected; }

    AirResult<Bytes> read(const AirAccess& access, Bank bank, std::uint32_t word,
                          std::uint32_t words) override {
        return read_range(access, bank, word * 2, words * 2);
    }
    AirResult<void> write(const AirAccess& access, Bank bank, std::uint32_t word, ByteView data) override {
        auto done = write_range(access, bank, word * 2, data);
        if (done && bank == Bank::epc) {
            auto& tag = *reach(access).value();
            auto& epc = tag.banks[Bank::epc];
            tag.id = event::TagId(ByteView(epc).subspan(4, static_cast<std::size_t>(epc[2] >> 3) * 2));
        }
        return done;
    }
    AirResult<void> lock(const AirAccess& access, AirLock lock) override {
        auto tag = reach(access);
        if (!tag) return tl::unexpected(tag.error());
        (*tag)->lock_mask = lock.mask;
        (*tag)->lock_action = lock.action;
        return {};
    }
    AirResult<void> kill(const AirAccess& access, std::uint32_t password) override {
        auto tag = reach(access);
        if (!tag) return tl::unexpected(tag.error());
        if ((*tag)->kill_password != password) return tl::unexpected(AirError::locked);
        (*tag)->away = true;
        return {};
    }
    AirResult<Bytes> read_bytes(const AirAccess& access, std::uint32_t address, std::uint32_t size) override {
        return read_range(access, Bank::user, address, size);
    }
    AirResult<void> write_bytes(const AirAccess& access, std::uint32_t address, ByteView data) override {
        return write_range(access, Bank::user, address, data);
    }
    AirResult<void> lock_byte(const AirAccess& access, std::uint32_t address) override {
        auto tag = reach(access);
        if (!tag) return tl::unexpected(tag.error());
        (*tag)->locked[address] = true;
        return {};
    }
    AirResult<void> program(const AirAccess& access, const event::TagId& id, std::uint32_t password,
                            bool) override {
        auto tag = reach(access);
        if (!tag) return tl::unexpected(tag.error());
        (*tag)->id = id;
        (*tag)->kill_password = password;
        return {};
    }

private:
    AirResult<Tag*> reach(const AirAccess& access) {
        last_password = access.password;
        for (auto& tag : tags)
            if (!tag.away && tag.antenna == access.carrier.antenna && tag.id == access.tag) {
                if (refuses) return tl::unexpected(*refuses);
                return &tag;
            }
        // A tag that was just given another id still answers to whoever wrote it.
        for (auto& tag : tags)
            if (&tag == written_ && !tag.away) return &tag;
        return tl::unexpected(AirError::no_tag);
    }
    AirResult<Bytes> read_range(const AirAccess& access, Bank bank, std::uint32_t first, std::uint32_t size) {
        auto tag = reach(access);
        if (!tag) return tl::unexpected(tag.error());
        auto& memory = (*tag)->banks[bank];
        if (first >= memory.size() || size > memory.size() - first)
            return tl::unexpected(AirError::bad_address);
        auto from = memory.begin() + first;
        return Bytes(from, size == 0 ? memory.end() : from + size);
    }
    AirResult<void> write_range(const AirAccess& access, Bank bank, std::uint32_t first, ByteView data) {
        auto tag = reach(access);
        if (!tag) return tl::unexpected(tag.error());
        auto& memory = (*tag)->banks[bank];
        if (first >= memory.size() || data.size() > memory.size() - first)
            return tl::unexpected(AirError::bad_address);
        for (std::size_t i = 0; i < data.size(); ++i)
            if ((*tag)->locked[first + static_cast<std::uint32_t>(i)])
                return tl::unexpected(AirError::locked);
        std::ranges::copy(data, memory.begin() + first);
        written_ = *tag;
        return {};
    }
    Tag* written_ = nullptr;
};

// --- pairs of a request ------------------------------------------------------------------------------------

using Pairs = std::vector<Bytes>;

inline Bytes number(Attribute attribute, std::uint64_t value) {
    Bytes pair;
    append_number(pair, attribute, value);
    return pair;
}
inline Bytes text(Attribute attribute, std::string_view value) {
    Bytes pair;
    append_text(pair, attribute, value);
    return pair;
}
inline Bytes bytes(Attribute attribute, std::string_view value) {
    Bytes pair;
    append_bytes(pair, attribute, hex(value));
    return pair;
}
inline Bytes source(unsigned which = 0) {
    return text(Attribute::source_name, source_name(which));
}
inline Bytes point(unsigned which = 0) {
    return text(Attribute::read_point_name, read_point_name(which));
}
inline Pairs tag_pairs(std::string_view id) {
    return {number(Attribute::tag_id_len, id.size() / 2), bytes(Attribute::tag_id, id)};
}
inline Pairs operator+(Pairs a, const Pairs& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
}

inline Bytes request(std::uint16_t code, const Pairs& pairs = {}, std::uint16_t id = 7) {
    Bytes message;
    Builder builder(message, to_reader_head, id);
    builder.command(code);
    for (auto& pair : pairs)
        message.insert(message.end(), pair.begin(), pair.end());
    EXPECT_TRUE(builder.finish());
    return message;
}
inline Bytes request(Command code, const Pairs& pairs = {}, std::uint16_t id = 7) {
    return request(static_cast<std::uint16_t>(code), pairs, id);
}

// --- a message of the reader, kept -------------------------------------------------------------------------

struct Said {
    explicit Said(ByteView message) : bytes(message.begin(), message.end()), parsed(parse(bytes)) {}
    Said(const Said& other) : Said(ByteView(other.bytes)) {}
    Said(Said&&) = default;
    Said& operator=(const Said& other) {
        bytes = other.bytes;
        parsed = parse(bytes);
        return *this;
    }
    Said& operator=(Said&&) = default;
    ~Said() = default;

    ResultCode result() const { return static_cast<ResultCode>(parsed.result.value_or(0xFFFF)); }
    std::uint32_t number(Attribute attribute) const { return parsed.number(attribute).value_or(0xFFFFFFFF); }
    std::string text(Attribute attribute) const { return std::string(parsed.text(attribute).value_or("-")); }
    std::string hex_of(Attribute attribute) const {
        const auto* avp = parsed.find(attribute);
        return avp != nullptr ? to_hex(avp->value) : "-";
    }
    std::vector<std::string> all(Attribute attribute) const {
        std::vector<std::string> values;
        for (auto& avp : parsed.avps)
            if (avp.is(attribute)) values.push_back(to_hex(avp.value));
        return values;
    }
    std::vector<std::uint16_t> types() const {
        std::vector<std::uint16_t> found;
        for (auto& avp : parsed.avps)
            found.push_back(avp.type);
        return found;
    }

    Bytes bytes;
    Parsed parsed;
};

inline Bytes take_output(Party& party) {
    Bytes out(party.output().begin(), party.output().end());
    party.output_sent(out.size());
    return out;
}
inline std::vector<Said> messages(ByteView bytes) {
    std::vector<Said> all;
    while (auto header = read_header(bytes)) {
        if (header->length < header_size || header->length > bytes.size()) break;
        all.emplace_back(bytes.first(header->length));
        bytes = bytes.subspan(header->length);
    }
    EXPECT_TRUE(bytes.empty()) << to_hex(bytes);
    return all;
}

// --- the reader on the bench -------------------------------------------------------------------------------

struct Bench {
    explicit Bench(const Given& settings = {}, bool tag = true) : Bench(std::make_unique<Shelf>(), settings) {
        if (tag) shelf->add("300833B2DDD9014035050000");
    }
    Bench(std::unique_ptr<Shelf> the_shelf, const Given& settings)
        : shelf(std::move(the_shelf)), device({"caen", 3, device_with(settings)}, *shelf) {
        device.power_on(now);
        waits(1s);
        device.start(now);
    }

    void gets(ByteView request) { device.received(request, now); }
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
    Bytes says() { return take_output(device); }
    // Sends one request and takes its answer.
    Said ask(const Bytes& request, std::chrono::microseconds within = 1s) {
        gets(request);
        if (device.output().empty()) waits(within);
        auto all = messages(says());
        EXPECT_EQ(all.size(), 1u);
        return all.empty() ? Said(Bytes{}) : all.front();
    }
    Said ask(Command code, const Pairs& pairs = {}) { return ask(request(code, pairs)); }
    ResultCode result(Command code, const Pairs& pairs = {}) { return ask(code, pairs).result(); }
    void sets(Command code, const Pairs& pairs = {}) { EXPECT_EQ(result(code, pairs), ResultCode::success); }
    void sets(Config which, std::uint32_t value, unsigned of = 0) {
        sets(Command::set_source_config,
             {source(of), number(Attribute::config_parameter, static_cast<std::uint32_t>(which)),
              number(Attribute::config_value, value)});
    }
    void reboots() {
        does("restart");
        EXPECT_TRUE(device.finished());
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

    std::unique_ptr<Shelf> shelf;
    Now now = testkit::script_start;
    CaenDevice device;
};

}  // namespace gantry::caen::device_test
