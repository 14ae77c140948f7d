#include "event/event_json.hpp"

#include <algorithm>
#include <charconv>
#include <memory>

#include "base/text.hpp"

namespace gantry::event {

namespace {

// True when a JSON string can hold these eight characters as they are: printable ASCII, no quote, no
// backslash. The usual trick: a byte's top bit in each term tells of that byte.
bool is_plain(std::uint64_t eight) {
    constexpr std::uint64_t ones = 0x0101010101010101u, tops = ones * 0x80;
    auto below = [](std::uint64_t x, std::uint64_t n) { return (x - ones * n) & ~x; };
    auto equal = [&](char c) { return below(eight ^ ones * static_cast<std::uint8_t>(c), 1); };
    auto is_del = (eight & ~tops) + ones;
    return ((eight | below(eight, 0x20) | equal('"') | equal('\\') | is_del) & tops) == 0;
}

bool is_plain(char c) {
    return c >= 0x20 && c < 0x7F && c != '"' && c != '\\';
}

// Digits and memcpy into room that is known to suffice: five times faster than any general writer.
class JsonWriter {
public:
    explicit JsonWriter(char* at) : at_(at) {}
    char* end() const { return at_; }

    template <std::size_t size>
    void literal(const char (&text)[size]) {
        std::memcpy(at_, text, size - 1);
        at_ += size - 1;
    }
    void raw(std::string_view text) {
        std::memcpy(at_, text.data(), text.size());
        at_ += text.size();
    }
    template <class Integer>
    void number(Integer value) {
        at_ = std::to_chars(at_, at_ + 20, value).ptr;
    }
    // Without quotes. Eight characters are copied at a time and looked at in the register.
    void text(std::string_view text) {
        const char* from = text.data();
        char* to = at_;
        auto left = text.size();
        std::uint64_t eight = 0;
        for (; left >= 8; left -= 8, from += 8, to += 8) {
            std::memcpy(&eight, from, 8);
            if (!is_plain(eight)) return escaped(text);
            std::memcpy(to, &eight, 8);
        }
        for (; left > 0; --left) {
            if (!is_plain(*from)) return escaped(text);
            *to++ = *from++;
        }
        at_ = to;
    }
    void hex(ByteView bytes) { at_ = write_hex(bytes, at_); }
    void tenths(std::int16_t value) {
        int magnitude = value;
        if (magnitude < 0) {
            *at_++ = '-';
            magnitude = -magnitude;
        }
        number(magnitude / 10);
        *at_++ = '.';
        *at_++ = static_cast<char>('0' + magnitude % 10);
    }
    void time(Wall time) {
        // The times of a batch lie in a few seconds: of a second that was written lately only the fraction is
        // written anew.
        constexpr std::size_t to_the_point = 20;  // "2026-11-21T23:04:00."
        struct Known {
            std::int64_t second;
            char text[to_the_point];
        };
        static thread_local std::array<Known, 16> lately{};
        auto second = std::chrono::floor<std::chrono::seconds>(time);
        auto count = second.time_since_epoch().count();
        auto& known = lately[static_cast<std::uint64_t>(count) % lately.size()];
        if (known.second != count || known.text[0] == '\0') {
            at_ = write_rfc3339(time, at_);
            if (!in_range(second)) return;
            known.second = count;
            std::memcpy(known.text, at_ - rfc3339_size, to_the_point);
            return;
        }
        char* at = at_;
        std::memcpy(at, known.text, to_the_point);
        auto fraction = static_cast<unsigned>((time - second).count());
        for (std::size_t i = to_the_point + 6; i-- > to_the_point; fraction /= 10)
            at[i] = static_cast<char>('0' + fraction % 10);
        at[to_the_point + 6] = 'Z';
        at_ = at + rfc3339_size;
    }

private:
    [[gnu::cold]] void escaped(std::string_view text) {
        std::string out;
        append_json_string(out, text);
        raw(std::string_view(out).substr(1, out.size() - 2));
    }
    // write_rfc3339 clamps what lies outside; such a text says nothing about its neighbours.
    static bool in_range(std::chrono::sys_seconds second) {
        using namespace std::chrono;
        return second >= sys_days{year{0} / 1 / 1} && second < sys_days{year{9999} / 12 / 31} + days{1};
    }

    char* at_;
};

// All keys, numbers and times together, with room to spare.
constexpr std::size_t fixed_room = 1024;
constexpr std::size_t most_growth = 6;  // one character to \u001F

std::size_t room_for(const Event& event, std::string_view id_prefix) {
    std::size_t text = id_prefix.size() + event.reader.size() + event.antenna.size() + event.zone.size() +
                       event.epc.size() + event.gs1.size() + event.link.size() + event.from.size() +
                       event.to.size() + event.reason.size() + event.text.size() + event.scope.size() +
                       event.by.size();
    return fixed_room + most_growth * text +
           2 * (event.tag.size + event.bytes.size() + event.tid.size() + event.user.size());
}

char* write(char* at, const Event& event, std::string_view id_prefix) {
    JsonWriter out(at);
    // Each takes the key with the comma before it and what opens the value; nothing is written for no value.
    auto text = [&](const auto& key, std::string_view value) {
        if (value.empty()) return;
        out.literal(key);
        out.text(value);
        out.literal("\"");
    };
    auto hex = [&](const auto& key, ByteView value) {
        if (value.empty()) return;
        out.literal(key);
        out.hex(value);
        out.literal("\"");
    };
    auto number = [&](const auto& key, const auto& value) {
        if (!value) return;
        out.literal(key);
        out.number(*value);
    };
    auto time = [&](const auto& key, const std::optional<Wall>& value) {
        if (!value) return;
        out.literal(key);
        out.time(*value);
        out.literal("\"");
    };

    out.literal(R"({"schema":1,"id":")");
    out.text(id_prefix);
    out.number(event.seq);
    out.literal(R"(","seq":)");
    out.number(event.seq);
    out.literal(R"(,"type":")");
    out.raw(to_text(event.type));
    out.literal(R"(","time":")");
    out.time(event.time);
    out.literal("\"");
    text(R"(,"reader":")", event.reader);
    text(R"(,"antenna":")", event.antenna);
    text(R"(,"zone":")", event.zone);
    if (is_tag(event.type)) text(R"(,"technology":")", to_text(event.technology));
    hex(R"(,"tag":")", event.tag.view());
    text(R"(,"epc":")", event.epc);
    text(R"(,"gs1":")", event.gs1);
    text(R"(,"link":")", event.link);
    if (event.pc != 0) hex(R"(,"pc":")", pc_words(event.pc).view());
    if (event.xpc != 0) hex(R"(,"xpc":")", xpc_words(event.xpc).view());
    if (event.rssi) {
        out.literal(R"(,"rssi_dbm":)");
        out.tenths(*event.rssi);
    }
    if (event.reads != 0) {
        out.literal(R"(,"reads":)");
        out.number(event.reads);
    }
    time(R"(,"first_seen":")", event.first_seen);
    time(R"(,"last_seen":")", event.last_seen);
    time(R"(,"reader_time":")", event.reader_time);
    text(R"(,"from":")", event.from);
    text(R"(,"to":")", event.to);
    text(R"(,"reason":")", event.reason);
    number(R"(,"code":)", event.code);
    text(R"(,"text":")", event.text);
    hex(R"(,"bytes":")", event.bytes);
    number(R"(,"input":)", event.input);
    if (event.state) out.raw(*event.state ? R"(,"state":true)" : R"(,"state":false)");
    text(R"(,"scope":")", event.scope);
    number(R"(,"count":)", event.count);
    time(R"(,"since":")", event.since);
    text(R"(,"by":")", event.by);
    if (event.possible_repeat) out.literal(R"(,"possible_repeat":true)");
    if (!event.tid.empty() || !event.user.empty()) {
        out.literal(R"(,"data":{)");
        hex(R"("tid":")", event.tid);
        if (!event.tid.empty() && !event.user.empty()) out.literal(",");
        hex(R"("user":")", event.user);
        out.literal("}");
    }
    out.literal("}");
    return out.end();
}

}  // namespace

void append_json(std::string& out, const Event& event, std::string_view id_prefix) {
    auto room = room_for(event, id_prefix);
    if (std::array<char, 4096> usual; room <= usual.size()) {  // not cleared: this is the hot path
        auto* end = write(usual.data(), event, id_prefix);
        out.append(usual.data(), end);
    } else {
        std::unique_ptr<char[]> large(new char[room]);
        auto* end = write(large.get(), event, id_prefix);
        out.append(large.get(), end);
    }
}

}  // namespace gantry::event
