#include "sinks/postgres/rows.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <limits>

#include "base/bytes.hpp"
#include "base/text.hpp"
#include "base/time.hpp"
#include "event/event_json.hpp"

namespace gantry::sinks::postgres {

namespace {

constexpr std::string_view nul_picture = "\xE2\x90\x80", replacement = "\xEF\xBF\xBD";
constexpr std::int64_t epoch_2000_us = 946'684'800'000'000;  // where timestamptz counts from

void append_storable(std::string& out, std::string_view text) {
    while (!text.empty()) {
        std::size_t size = 1;
        while (size < 4 && size < text.size() && !is_utf8(text.substr(0, size)))
            ++size;
        bool whole = is_utf8(text.substr(0, size));
        if (text.front() == '\0')
            out += nul_picture;
        else
            out += whole ? text.substr(0, size) : replacement;
        text.remove_prefix(whole ? size : 1);
    }
}

std::int64_t clamped(std::uint64_t value) {
    constexpr auto most = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
    return static_cast<std::int64_t>(std::min(value, most));
}

template <auto member>
void put_text(RowWriter& row, const sink::Item& item) {
    row.text(item.event->*member);
}
template <auto member>
void put_hex(RowWriter& row, const sink::Item& item) {
    row.text(to_hex(item.event->*member));
}
template <auto member>
void put_time(RowWriter& row, const sink::Item& item) {
    auto& value = item.event->*member;
    value ? row.time(*value) : row.null();
}
template <auto member>
void put_integer(RowWriter& row, const sink::Item& item) {
    auto& value = item.event->*member;
    value ? row.bigint(static_cast<std::int64_t>(*value)) : row.null();
}

void put_data(RowWriter& row, const sink::Item& item) {
    auto& event = *item.event;
    std::string json;
    for (auto& [name, bytes] : {std::pair{R"("tid":")", &event.tid}, std::pair{R"("user":")", &event.user}})
        if (!bytes->empty()) json += (json.empty() ? "{" : ",") + (name + to_hex(*bytes)) + '"';
    json.empty() ? row.null() : row.json(json + '}');
}

// Where a column does not show all, the JSON of the event does.
void put_exact(RowWriter& row, const sink::Item& item) {
    if (!row.has_nul()) return row.null();
    std::string json;
    event::append_json(json, *item.event, item.id.substr(0, item.id.rfind(':') + 1));
    row.raw(json);
}

using event::Event;
constexpr std::array all_columns = {
    Column{"schema", "smallint", [](RowWriter& row, const sink::Item&) { row.smallint(1); }},
    Column{"id", "text", [](RowWriter& row, const sink::Item& item) { row.text(item.id); }},
    Column{"seq", "bigint",
           [](RowWriter& row, const sink::Item& item) { row.bigint(clamped(item.event->seq)); }},
    Column{"type", "text",
           [](RowWriter& row, const sink::Item& item) { row.text(event::to_text(item.event->type)); }},
    Column{"time", "timestamptz", [](RowWriter& row, const sink::Item& item) { row.time(item.event->time); }},
    Column{"reader", "text", put_text<&Event::reader>},
    Column{"antenna", "text", put_text<&Event::antenna>},
    Column{"zone", "text", put_text<&Event::zone>},
    Column{"technology", "text",
           [](RowWriter& row, const sink::Item& item) {
               auto& event = *item.event;
               row.text(event::is_tag(event.type) ? event::to_text(event.technology) : std::string_view());
           }},
    Column{"tag", "text",
           [](RowWriter& row, const sink::Item& item) { row.text(to_hex(item.event->tag.view())); }},
    Column{"epc", "text", put_text<&Event::epc>},
    Column{"gs1", "text", put_text<&Event::gs1>},
    Column{"link", "text", put_text<&Event::link>},
    Column{"pc", "text",
           [](RowWriter& row, const sink::Item& item) {
               auto pc = item.event->pc;
               row.text(pc != 0 ? to_hex(event::pc_words(pc).view()) : std::string());
           }},
    Column{"xpc", "text",
           [](RowWriter& row, const sink::Item& item) {
               auto xpc = item.event->xpc;
               row.text(xpc != 0 ? to_hex(event::xpc_words(xpc).view()) : std::string());
           }},
    Column{"rssi_dbm", "double precision",
           [](RowWriter& row, const sink::Item& item) {
               auto& rssi = item.event->rssi;
               rssi ? row.number(*rssi / 10.0) : row.null();
           }},
    Column{"reads", "bigint",
           [](RowWriter& row, const sink::Item& item) {
               auto reads = item.event->reads;
               reads != 0 ? row.bigint(clamped(reads)) : row.null();
           }},
    Column{"first_seen", "timestamptz", put_time<&Event::first_seen>},
    Column{"last_seen", "timestamptz", put_time<&Event::last_seen>},
    Column{"reader_time", "timestamptz", put_time<&Event::reader_time>},
    Column{"from", "text", put_text<&Event::from>},
    Column{"to", "text", put_text<&Event::to>},
    Column{"reason", "text", put_text<&Event::reason>},
    Column{"code", "bigint", put_integer<&Event::code>},
    Column{"text", "text", put_text<&Event::text>},
    Column{"bytes", "text", put_hex<&Event::bytes>},
    Column{"input", "bigint", put_integer<&Event::input>},
    Column{"state", "boolean",
           [](RowWriter& row, const sink::Item& item) {
               auto& state = item.event->state;
               state ? row.boolean(*state) : row.null();
           }},
    Column{"scope", "text", put_text<&Event::scope>},
    Column{"count", "bigint",
           [](RowWriter& row, const sink::Item& item) {
               auto& count = item.event->count;
               count ? row.bigint(clamped(*count)) : row.null();
           }},
    Column{"since", "timestamptz", put_time<&Event::since>},
    Column{"by", "text", put_text<&Event::by>},
    Column{"possible_repeat", "boolean",
           [](RowWriter& row,
              const sink::Item& item) { item.event->possible_repeat ? row.boolean(true) : row.null(); }},
    Column{"data", "jsonb", put_data},
    Column{"exact", "bytea", put_exact},  // last: it looks at what the others were written as
};

void append_big_endian(std::string& out, std::uint64_t value, std::size_t bytes) {
    for (std::size_t at = bytes; at-- > 0;)
        out += static_cast<char>(value >> (8 * at));
}

}  // namespace

void RowWriter::big_endian(std::uint64_t value, std::size_t bytes) {
    append_big_endian(*out_, value, bytes);
}
void RowWriter::size(std::size_t bytes) {
    big_endian(bytes, 4);
}
void RowWriter::null() {
    big_endian(0xFFFFFFFF, 4);
}

void RowWriter::text(std::string_view value) {
    if (value.empty()) return null();
    bool nul = value.find('\0') != std::string_view::npos;
    has_nul_ = has_nul_ || nul;
    if (!nul && is_utf8(value)) return raw(value);
    std::string storable;
    append_storable(storable, value);
    raw(storable);
}

void RowWriter::raw(std::string_view value) {
    size(value.size());
    *out_ += value;
}

void RowWriter::smallint(std::int16_t value) {
    size(2);
    big_endian(static_cast<std::uint64_t>(value), 2);
}

void RowWriter::bigint(std::int64_t value) {
    size(8);
    big_endian(static_cast<std::uint64_t>(value), 8);
}

void RowWriter::boolean(bool value) {
    size(1);
    *out_ += value ? '\1' : '\0';
}

void RowWriter::number(double value) {
    size(8);
    big_endian(std::bit_cast<std::uint64_t>(value), 8);
}

void RowWriter::time(Wall value) {
    // JSON says the same of what lies outside the years 0 to 9999.
    using namespace std::chrono;
    constexpr Wall first = sys_days{year{0} / 1 / 1}, end = sys_days{year{10000} / 1 / 1};
    bigint(to_us(std::clamp(value, first, end - microseconds{1})) - epoch_2000_us);
}

void RowWriter::json(std::string_view value) {
    size(value.size() + 1);
    *out_ += '\1';  // the version of jsonb's binary format
    *out_ += value;
}

std::span<const Column> columns() {
    return all_columns;
}

std::uint64_t epoch_of(std::string_view id, std::string_view gateway) {
    if (!id.starts_with(gateway)) return 0;
    id.remove_prefix(gateway.size());
    std::uint64_t epoch = 0;
    const char* end = id.data() + id.size();
    if (id.size() < 2 || id.front() != ':') return 0;
    auto [at, error] = std::from_chars(id.data() + 1, end, epoch);
    return error == std::errc{} && at != end && *at == ':' ? epoch : 0;
}

void append_copy_header(std::string& out) {
    out += std::string_view("PGCOPY\n\xFF\r\n\0", 11);
    append_big_endian(out, 0, 4);  // flags
    append_big_endian(out, 0, 4);  // no extension of the header
}

void append_copy_row(std::string& out, const sink::Item& item, std::string_view gateway) {
    append_big_endian(out, all_columns.size() + 1, 2);
    RowWriter row(out);
    for (auto& column : all_columns)
        column.put(row, item);
    row.bigint(clamped(epoch_of(item.id, gateway)));
}

void append_copy_end(std::string& out) {
    append_big_endian(out, 0xFFFF, 2);
}

}  // namespace gantry::sinks::postgres
