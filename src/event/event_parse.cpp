#include "event/event_parse.hpp"

#include <cmath>

#include <fmt/format.h>
#include <boost/json.hpp>

namespace gantry::event {

namespace json = boost::json;

namespace {
// Takes members into places of an event; the first that is wrong is remembered.
class Members {
public:
    explicit Members(const json::object& object) : object_(object) {}

    void text(std::string_view key, std::string& place) {
        if (const auto* value = find(key)) {
            if (const auto* text = value->if_string())
                place = std::string(*text);
            else
                wrong(key);
        }
    }
    void time(std::string_view key, std::optional<Wall>& place) {
        std::string text_of;
        text(key, text_of);
        if (text_of.empty()) return;
        place = parse_rfc3339(text_of);
        if (!place) wrong(key);
    }
    void hex(std::string_view key, Bytes& place) {
        std::string text_of;
        text(key, text_of);
        if (text_of.empty()) return;
        auto bytes = from_hex(text_of);
        if (bytes)
            place = std::move(*bytes);
        else
            wrong(key);
    }
    template <class Number>
    void number(std::string_view key, std::optional<Number>& place) {
        const auto* value = find(key);
        if (value == nullptr) return;
        boost::system::error_code error;
        if (value->is_number()) {
            auto number = value->to_number<Number>(error);
            if (!error) {
                place = number;
                return;
            }
        }
        wrong(key);
    }
    void boolean(std::string_view key, std::optional<bool>& place) {
        const auto* value = find(key);
        if (value == nullptr) return;
        if (const auto* yes = value->if_bool())
            place = *yes;
        else
            wrong(key);
    }
    const json::value* find(std::string_view key) const {
        return object_.if_contains(json::string_view(key.data(), key.size()));
    }
    void wrong(std::string_view key) {
        if (wrong_.empty()) wrong_ = key;
    }
    const std::string& first_wrong() const { return wrong_; }

private:
    const json::object& object_;
    std::string wrong_;
};
}  // namespace

Result<Event> parse_event(std::string_view text) {
    boost::system::error_code error;
    auto parsed = json::parse(json::string_view(text.data(), text.size()), error);
    const auto* object = error ? nullptr : parsed.if_object();
    if (object == nullptr) return fail("an event is one JSON object");

    Event event;
    Members members(*object);
    std::optional<std::uint64_t> seq, reads;
    std::optional<Wall> time;
    std::string type, technology;
    members.number("seq", seq);
    members.text("type", type);
    members.time("time", time);
    auto known = parse_type(type);
    if (!seq) members.wrong("seq");
    if (!known) members.wrong("type");
    if (!time) members.wrong("time");
    members.text("reader", event.reader);
    members.text("antenna", event.antenna);
    members.text("zone", event.zone);
    members.text("technology", technology);
    if (!technology.empty()) {
        if (auto parsed_technology = parse_technology(technology))
            event.technology = *parsed_technology;
        else
            members.wrong("technology");
    }
    Bytes tag;
    members.hex("tag", tag);
    if (tag.size() <= TagId::max_size)
        event.tag = TagId(tag);
    else
        members.wrong("tag");
    members.text("epc", event.epc);
    members.text("gs1", event.gs1);
    members.text("link", event.link);
    Bytes pc, xpc;
    members.hex("pc", pc);
    members.hex("xpc", xpc);
    if (pc.size() == 2)
        event.pc = static_cast<std::uint16_t>(pc[0] << 8 | pc[1]);
    else if (!pc.empty())
        members.wrong("pc");
    if (xpc.size() == 2 || xpc.size() == 4) {
        xpc.resize(4);  // XPC_W1 stands in the upper half
        for (auto byte : xpc)
            event.xpc = event.xpc << 8 | byte;
    } else if (!xpc.empty()) {
        members.wrong("xpc");
    }
    std::optional<double> rssi;
    members.number("rssi_dbm", rssi);
    if (rssi) {
        auto tenths = std::round(*rssi * 10);
        if (tenths >= -32768 && tenths <= 32767)
            event.rssi = static_cast<std::int16_t>(tenths);
        else
            members.wrong("rssi_dbm");
    }
    members.number("reads", reads);
    event.reads = reads.value_or(0);
    members.time("first_seen", event.first_seen);
    members.time("last_seen", event.last_seen);
    members.time("reader_time", event.reader_time);
    members.text("from", event.from);
    members.text("to", event.to);
    members.text("reason", event.reason);
    members.number("code", event.code);
    members.text("text", event.text);
    members.hex("bytes", event.bytes);
    members.number("input", event.input);
    members.boolean("state", event.state);
    members.text("scope", event.scope);
    members.number("count", event.count);
    members.time("since", event.since);
    members.text("by", event.by);
    std::optional<bool> repeat;
    members.boolean("possible_repeat", repeat);
    event.possible_repeat = repeat.value_or(false);
    if (const auto* data = members.find("data")) {
        if (const auto* banks = data->if_object()) {
            Members inner(*banks);
            inner.hex("tid", event.tid);
            inner.hex("user", event.user);
            if (!inner.first_wrong().empty()) members.wrong("data");
        } else {
            members.wrong("data");
        }
    }
    if (!members.first_wrong().empty())
        return fail(
            fmt::format("\"{}\" of the event is missing or not what it should be", members.first_wrong()));
    event.seq = *seq;
    event.type = *known;
    event.time = *time;
    return event;
}

}  // namespace gantry::event
