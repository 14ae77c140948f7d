#include "cli/csv.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::cli {

namespace {
using event::Event;

bool is_control(unsigned char c) {
    return (c < 0x20 && c != '\t' && c != '\n' && c != '\r') || c == 0x7F;
}

std::string without_controls(std::string_view text) {
    constexpr std::string_view replacement = "\xEF\xBF\xBD";
    std::string out;
    for (std::size_t i = 0; i < text.size();) {
        auto left = text.substr(i);
        // One character: its length is in its first byte; what is none is replaced byte by byte.
        auto first = static_cast<unsigned char>(left.front());
        std::size_t size = first < 0x80 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
        auto character = left.substr(0, size);
        bool second_set =
            character.size() == 2 && first == 0xC2 && static_cast<unsigned char>(character[1]) < 0xA0;
        if (!is_utf8(character) || is_control(first) || second_set) {
            out += replacement;
            i += is_utf8(character) ? size : 1;
        } else {
            out += character;
            i += size;
        }
    }
    return out;
}

// One line, cell by cell.
class Line {
public:
    Line(std::string& out, Cells cells) : out_(out), cells_(cells) {}

    void text(std::string_view text) {
        if (cells_ == Cells::raw) return quoted(text);
        auto is_plain = [](char c) { return c >= 0x20 && c < 0x7F; };
        auto safe = std::ranges::all_of(text, is_plain) ? std::string(text) : without_controls(text);
        if (!safe.empty() && std::string_view("=+-@\t\r").find(safe.front()) != std::string_view::npos)
            safe.insert(0, "'");
        quoted(safe);
    }
    // What is a number, or made by us.
    void plain(std::string_view text) {
        separate();
        out_ += text;
    }
    template <class Number>
    void number(const std::optional<Number>& value) {
        separate();
        if (value) out_ += fmt::format("{:d}", *value);
    }
    void time(const std::optional<Wall>& time) { plain(time ? to_rfc3339(*time) : std::string()); }
    void hex(ByteView bytes) { plain(to_hex(bytes)); }

private:
    void separate() {
        if (!first_) out_ += ',';
        first_ = false;
    }
    void quoted(std::string_view text) {
        separate();
        if (text.find_first_of(",\"\r\n") == std::string_view::npos) {
            out_ += text;
            return;
        }
        out_ += '"';
        for (char c : text) {
            if (c == '"') out_ += '"';
            out_ += c;
        }
        out_ += '"';
    }

    std::string& out_;
    Cells cells_;
    bool first_ = true;
};

template <class Number>
std::optional<Number> unless_zero(Number number) {
    return number == 0 ? std::nullopt : std::optional(number);
}

void put_data(Line& line, const Event& e) {
    std::string data;
    if (!e.tid.empty()) data += fmt::format("\"tid\":\"{}\"", to_hex(e.tid));
    if (!e.user.empty()) data += fmt::format("{}\"user\":\"{}\"", data.empty() ? "" : ",", to_hex(e.user));
    line.text(data.empty() ? data : "{" + data + "}");
}

// All but the id, which is first.
struct Column {
    std::string_view name;
    void (*put)(Line& line, const Event& e);
};
constexpr std::array columns = {
    Column{"seq", [](Line& line, const Event& e) { line.number(std::optional(e.seq)); }},
    Column{"type", [](Line& line, const Event& e) { line.plain(to_text(e.type)); }},
    Column{"time", [](Line& line, const Event& e) { line.time(e.time); }},
    Column{"reader", [](Line& line, const Event& e) { line.text(e.reader); }},
    Column{"antenna", [](Line& line, const Event& e) { line.text(e.antenna); }},
    Column{"zone", [](Line& line, const Event& e) { line.text(e.zone); }},
    Column{
        "technology",
        [](Line& line, const Event& e) { line.plain(event::is_tag(e.type) ? to_text(e.technology) : ""); }},
    Column{"tag", [](Line& line, const Event& e) { line.hex(e.tag.view()); }},
    Column{"epc", [](Line& line, const Event& e) { line.text(e.epc); }},
    Column{"gs1", [](Line& line, const Event& e) { line.text(e.gs1); }},
    Column{"link", [](Line& line, const Event& e) { line.text(e.link); }},
    Column{"pc", [](Line& line, const Event& e) { line.hex(event::pc_words(e.pc).view()); }},
    Column{"xpc", [](Line& line, const Event& e) { line.hex(event::xpc_words(e.xpc).view()); }},
    Column{
        "rssi_dbm",
        [](Line& line, const Event& e) { line.plain(e.rssi ? fmt::format("{:.1f}", *e.rssi / 10.0) : ""); }},
    Column{"reads", [](Line& line, const Event& e) { line.number(unless_zero(e.reads)); }},
    Column{"first_seen", [](Line& line, const Event& e) { line.time(e.first_seen); }},
    Column{"last_seen", [](Line& line, const Event& e) { line.time(e.last_seen); }},
    Column{"reader_time", [](Line& line, const Event& e) { line.time(e.reader_time); }},
    Column{"from", [](Line& line, const Event& e) { line.text(e.from); }},
    Column{"to", [](Line& line, const Event& e) { line.text(e.to); }},
    Column{"reason", [](Line& line, const Event& e) { line.text(e.reason); }},
    Column{"code", [](Line& line, const Event& e) { line.number(e.code); }},
    Column{"text", [](Line& line, const Event& e) { line.text(e.text); }},
    Column{"bytes", [](Line& line, const Event& e) { line.hex(e.bytes); }},
    Column{"input", [](Line& line, const Event& e) { line.number(e.input); }},
    Column{"state", [](Line& line, const Event& e) { line.number(e.state); }},
    Column{"scope", [](Line& line, const Event& e) { line.text(e.scope); }},
    Column{"count", [](Line& line, const Event& e) { line.number(e.count); }},
    Column{"since", [](Line& line, const Event& e) { line.time(e.since); }},
    Column{"by", [](Line& line, const Event& e) { line.text(e.by); }},
    Column{"possible_repeat",
           [](Line& line, const Event& e) { line.number(unless_zero(int{e.possible_repeat})); }},
    Column{"data", put_data},
};
}  // namespace

std::string csv_header() {
    std::string out = "id";
    for (auto& column : columns)
        out += fmt::format(",{}", column.name);
    return out + "\n";
}

void append_csv(std::string& out, const Event& event, std::string_view id_prefix, Cells cells) {
    Line line(out, cells);
    line.text(fmt::format("{}{}", id_prefix, event.seq));
    for (auto& column : columns)
        column.put(line, event);
    out += '\n';
}

}  // namespace gantry::cli
