#include <sqlite3.h>

#include <cstdio>
#include <fstream>
#include <random>
#include <sstream>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "journal/tests/fixtures.hpp"

namespace gantry::journal::tests {
namespace {

constexpr const char* columns[] = {"schema",    "id",          "seq",
                                   "type",      "time",        "reader",
                                   "antenna",   "zone",        "technology",
                                   "tag",       "epc",         "gs1",
                                   "link",      "pc",          "xpc",
                                   "rssi_dbm",  "reads",       "first_seen",
                                   "last_seen", "reader_time", "\"from\"",
                                   "\"to\"",    "reason",      "code",
                                   "text",      "bytes",       "input",
                                   "state",     "scope",       "count",
                                   "since",     "\"by\"",      "possible_repeat",
                                   "data"};

std::string quoted_line(const std::string& view, std::span<const char* const> names,
                        const std::string& order) {
    std::string sql = "SELECT ";
    for (auto* name : names)
        sql += std::string(name == names[0] ? "" : " || '|' || ") + "quote(" + name + ")";
    return sql + " FROM " + view + " ORDER BY " + order;
}

std::string sql_text(std::string_view text) {
    std::string out = "'";
    for (char c : text)
        out += c == '\'' ? "''" : std::string(1, c);
    return out + "'";
}
std::string sql_text_or_null(std::string_view text) {
    return text.empty() ? "NULL" : sql_text(text);
}
std::string data_text(const event::Event& e) {
    if (e.tid.empty() && e.user.empty()) return "NULL";
    std::string text;
    if (!e.tid.empty()) text += ",\"tid\":\"" + to_hex(e.tid) + "\"";
    if (!e.user.empty()) text += ",\"user\":\"" + to_hex(e.user) + "\"";
    return sql_text("{" + text.substr(1) + "}");
}
std::string tenths(const event::Rssi& rssi) {
    if (!rssi) return "NULL";
    auto value = static_cast<int>(*rssi);
    return (value < 0 ? "-" : "") + std::to_string(std::abs(value) / 10) + "." +
           std::to_string(std::abs(value) % 10);
}

// The event as the view must show it, in SQL's own notation.
std::string expected_line(const event::Event& e, const std::string& prefix) {
    auto time = [](const std::optional<Wall>& t) { return t ? sql_text(to_rfc3339(*t)) : "NULL"; };
    auto number = [](const auto& n) { return n ? std::to_string(*n) : "NULL"; };
    bool tag = event::is_tag(e.type);
    std::string parts[] = {"1",
                           sql_text(prefix + std::to_string(e.seq)),
                           std::to_string(e.seq),
                           sql_text(to_text(e.type)),
                           sql_text(to_rfc3339(e.time)),
                           sql_text_or_null(e.reader),
                           sql_text_or_null(e.antenna),
                           sql_text_or_null(e.zone),
                           tag ? sql_text(to_text(e.technology)) : "NULL",
                           sql_text_or_null(to_hex(e.tag.view())),
                           sql_text_or_null(e.epc),
                           sql_text_or_null(e.gs1),
                           sql_text_or_null(e.link),
                           sql_text_or_null(to_hex(event::pc_words(e.pc).view())),
                           sql_text_or_null(to_hex(event::xpc_words(e.xpc).view())),
                           tenths(e.rssi),
                           e.reads == 0 ? "NULL" : std::to_string(e.reads),
                           time(e.first_seen),
                           time(e.last_seen),
                           time(e.reader_time),
                           sql_text_or_null(e.from),
                           sql_text_or_null(e.to),
                           sql_text_or_null(e.reason),
                           number(e.code),
                           sql_text_or_null(e.text),
                           sql_text_or_null(to_hex(e.bytes)),
                           number(e.input),
                           number(e.state),
                           sql_text_or_null(e.scope),
                           number(e.count),
                           time(e.since),
                           sql_text_or_null(e.by),
                           e.possible_repeat ? "1" : "NULL",
                           data_text(e)};
    std::string line;
    for (auto& part : parts)
        line += (&part == parts ? "" : "|") + part;
    return line;
}

std::vector<std::string> lines_of_api(const std::filesystem::path& path, const std::string& sql) {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
    sqlite3_stmt* statement = nullptr;
    EXPECT_EQ(sqlite3_prepare_v2(db, sql.c_str(), -1, &statement, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    std::vector<std::string> lines;
    while (sqlite3_step(statement) == SQLITE_ROW)
        lines.emplace_back(reinterpret_cast<const char*>(sqlite3_column_text(statement, 0)));
    EXPECT_EQ(sqlite3_finalize(statement), SQLITE_OK);
    sqlite3_close(db);
    return lines;
}

std::vector<std::string> lines_of_shell(const Folder& folder, const std::string& sql) {
    auto script = folder.path() / "query.sql", result = folder.path() / "result.txt";
    std::ofstream(script) << sql << ";\n";
    auto command = "sqlite3 -readonly '" + folder.store().string() + "' < '" + script.string() + "' > '" +
                   result.string() + "' 2>&1";
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::vector<std::string> lines;
    std::ifstream in(result);
    for (std::string line; std::getline(in, line);)
        lines.push_back(line);
    return lines;
}

struct Dice {
    std::mt19937_64 engine;
    std::int64_t roll(std::int64_t low, std::int64_t high) {
        return std::uniform_int_distribution<std::int64_t>(low, high)(engine);
    }
    bool maybe() { return roll(0, 1) == 1; }
    std::string text() {
        static const std::string some[] = {"",    "a",        "dock/left", "it's", "\"q\"",
                                           "ä€😀", "%s {} \\", "--;",       "\x7F"};
        return some[roll(0, std::ssize(some) - 1)];
    }
    Wall time() {
        return from_us(roll(0, 1) == 0 ? roll(0, 253'402'300'799'999'999)
                                       : to_us(start_time) + roll(0, 9'999'999));
    }
    Bytes bytes(std::int64_t most) {
        Bytes out(static_cast<std::size_t>(roll(0, most)));
        for (auto& byte : out)
            byte = static_cast<std::uint8_t>(roll(0, 255));
        return out;
    }
    event::TagId tag() {
        return maybe() ? tag_number(static_cast<std::uint64_t>(roll(0, 50))) : event::TagId(bytes(62));
    }
    event::Technology technology() { return static_cast<event::Technology>(roll(0, 7)); }
    std::uint16_t pc() { return maybe() ? 0 : static_cast<std::uint16_t>(roll(0, 0xFFFF)); }
    // Often of one word, XPC_W1.
    std::uint32_t xpc() {
        return maybe() ? 0
                       : static_cast<std::uint32_t>(roll(0, 0xFFFF) << 16 | (maybe() ? 0 : roll(0, 0xFFFF)));
    }
};

void add_random(Dice& dice, Journal& journal, Batch& batch) {
    if (dice.maybe()) {
        auto& read = batch.reads.emplace_back();
        read.seq = batch.take_seq();
        read.time = dice.time();
        read.read_point = dice.maybe() ? journal.read_point(dice.text(), dice.text(), dice.text()) : 0;
        read.possible_repeat = dice.maybe();
        auto& o = read.observation;
        o.tag = dice.tag();
        o.technology = dice.technology();
        o.pc = dice.pc();
        o.xpc = dice.maybe() ? Observation::no_xpc : dice.xpc();
        o.rssi = static_cast<std::int16_t>(dice.roll(-32768, 32767));
        o.reads = static_cast<std::uint16_t>(dice.roll(1, 65535));
        o.reader_time_us = dice.maybe() ? 0 : dice.roll(1, 253'402'300'799'999'999);
        return;
    }
    auto types = event::all_types();
    auto& e = add_event(batch, types[static_cast<std::size_t>(dice.roll(0, std::ssize(types) - 1))].type,
                        dice.time());
    auto time = [&] { return dice.maybe() ? std::optional(dice.time()) : std::nullopt; };
    e.reader = dice.text();
    e.antenna = dice.text();
    e.zone = dice.text();
    if (event::is_tag(e.type)) {
        e.tag = dice.tag();
        e.technology = dice.technology();
        e.pc = dice.pc();
        e.xpc = dice.xpc();
    }
    if (dice.maybe()) e.rssi = static_cast<std::int16_t>(dice.roll(-32768, 32767));
    e.reads = static_cast<std::uint64_t>(dice.roll(0, 3));
    e.first_seen = time();
    e.last_seen = time();
    e.reader_time = time();
    if (dice.maybe()) return;
    e.from = dice.text();
    e.to = dice.text();
    e.reason = dice.text();
    e.text = dice.text();
    if (dice.maybe())
        e.code =
            dice.roll(std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max());
    e.bytes = dice.bytes(20);
    if (dice.maybe()) e.input = dice.roll(0, 8);
    if (dice.maybe()) e.state = dice.maybe();
    e.scope = dice.text();
    if (dice.maybe()) e.count = static_cast<std::uint64_t>(dice.roll(0, 1'000'000));
    e.since = time();
    e.by = dice.text();
    e.possible_repeat = dice.maybe();
    e.user = dice.bytes(64);
    e.tid = dice.bytes(12);
}

RC_GTEST_PROP(Views, EventsShowsExactlyWhatAReaderGives, (std::uint64_t seed)) {
    Folder folder;
    Dice dice{std::mt19937_64(seed)};
    auto journal = open_store(folder.store());
    for (auto commits = dice.roll(1, 4); commits > 0; --commits) {
        auto batch = next_batch(*journal);
        for (auto count = dice.roll(1, 60); count > 0; --count)
            add_random(dice, *journal, batch);
        RC_ASSERT(journal->commit(batch).has_value());
    }
    std::vector<std::string> expected;
    for (auto& event : read_all(folder.store()))
        expected.push_back(expected_line(event, journal->id_prefix()));
    RC_ASSERT(expected.size() == journal->last_seq());
    auto sql = quoted_line("events", columns, "seq");
    RC_ASSERT(lines_of_api(folder.store(), sql) == expected);
    RC_ASSERT(lines_of_shell(folder, sql) == expected);
    RC_ASSERT(journal->check() == "");
}

// What is committed and what is read differ in nothing but the names of the EPC.
RC_GTEST_PROP(Views, WhatIsReadIsWhatWasCommitted, (std::uint64_t seed)) {
    Folder folder;
    Dice dice{std::mt19937_64(seed)};
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    for (auto count = dice.roll(1, 400); count > 0; --count)
        add_random(dice, *journal, batch);
    auto events = batch.events;
    auto reads = batch.reads;
    RC_ASSERT(journal->commit(batch).has_value());
    auto back = read_all(folder.store());
    std::vector<std::string> expected_events, got_events;
    std::size_t read = 0;
    for (auto& event : events)
        expected_events.push_back(describe(event));
    for (auto& event : back) {
        event.epc.clear();
        event.gs1.clear();
        event.link.clear();
        if (read < reads.size() && reads[read].seq == event.seq) {
            auto& o = reads[read].observation;
            RC_ASSERT(event.time == reads[read].time);
            RC_ASSERT(event.tag == o.tag);
            RC_ASSERT(event.technology == o.technology);
            RC_ASSERT(event.rssi == (o.rssi == Observation::no_rssi ? event::Rssi{} : event::Rssi{o.rssi}));
            RC_ASSERT(event.pc == o.pc);
            RC_ASSERT(event.xpc == (o.xpc == Observation::no_xpc ? 0 : o.xpc));
            RC_ASSERT(event.reads == o.reads);
            RC_ASSERT((event.reader_time ? to_us(*event.reader_time) : 0) == o.reader_time_us);
            RC_ASSERT(event.possible_repeat == reads[read].possible_repeat);
            ++read;
        } else {
            got_events.push_back(describe(event));
        }
    }
    RC_ASSERT(read == reads.size());
    RC_ASSERT(got_events == expected_events);
}

// A filter gives what looking at every event would give, from either end.
RC_GTEST_PROP(Views, AFilterLeavesOutExactlyTheRest, (std::uint64_t seed)) {
    static Folder folder;
    static const auto events = [] {
        Dice dice{std::mt19937_64(1)};
        auto journal = open_store(folder.store());
        for (int commit = 0; commit < 30; ++commit) {
            auto batch = next_batch(*journal);
            for (auto count = dice.roll(1, 600); count > 0; --count)
                add_random(dice, *journal, batch);
            if (!journal->commit(batch)) throw std::runtime_error("commit failed");
        }
        return read_all(folder.store());
    }();
    Dice dice{std::mt19937_64(seed)};
    Filter filter;
    auto last = std::ssize(events);
    if (dice.maybe()) filter.after = static_cast<Seq>(dice.roll(0, last + 1));
    if (dice.maybe()) filter.up_to = static_cast<Seq>(dice.roll(1, last + 1));
    if (dice.maybe()) filter.types = {event::Type::tag_read};
    if (dice.maybe()) filter.types.push_back(event::Type::tag_lost);
    if (dice.maybe()) filter.reader = dice.maybe() ? "*a*" : "dock/left";
    if (dice.maybe()) filter.zone = dice.maybe() ? "*" : "it's";
    if (dice.maybe()) filter.tag = dice.maybe() ? "30742" : "0";
    if (dice.maybe()) filter.since = start_time + std::chrono::microseconds(dice.roll(0, 9'999'999));
    if (dice.maybe()) filter.until = start_time + std::chrono::microseconds(dice.roll(0, 9'999'999));
    filter.newest_first = dice.maybe();

    std::vector<Seq> expected;
    for (auto& e : events) {
        bool wanted = e.seq > filter.after && (filter.up_to == 0 || e.seq <= filter.up_to) &&
                      (filter.types.empty() || std::ranges::find(filter.types, e.type) != filter.types.end());
        if (!filter.reader.empty())
            wanted = wanted && (filter.reader == "*a*" ? e.reader.find('a') != std::string::npos
                                                       : e.reader == filter.reader);
        if (filter.zone == "it's") wanted = wanted && e.zone == "it's";
        wanted = wanted && to_hex(e.tag.view()).starts_with(filter.tag) &&
                 (!filter.since || e.time >= *filter.since) && (!filter.until || e.time < *filter.until);
        if (wanted) expected.push_back(e.seq);
    }
    auto newest = (*Reader::open(folder.store()))->newest(filter, 10);
    RC_ASSERT(newest.has_value());
    auto tail =
        std::vector(expected.end() - std::min<std::ptrdiff_t>(10, std::ssize(expected)), expected.end());
    RC_ASSERT(seqs_of(*newest) == tail);
    if (filter.newest_first) std::ranges::reverse(expected);
    RC_ASSERT(seqs_of(read_all(folder.store(), filter)) == expected);
}

TEST(Views, PresentTagsShowsTagsThatAreThereNow) {
    Folder folder;
    auto journal = open_store(folder.store());
    auto batch = next_batch(*journal);
    for (std::uint8_t state = 1; state <= 3; ++state) {
        PresenceRow row;
        row.id = state;
        row.tag = tag_number(state);
        row.technology = event::Technology::epc_gen2;
        row.state = state;
        row.zone = state == 2 ? "" : "dock";
        row.reader = "dock-1";
        row.antenna = "Ant0";
        row.reads = 7;
        row.first_seen = start_time;
        row.last_seen = start_time + 1s;
        if (state == 1) {
            row.rssi = static_cast<std::int16_t>(-505);
            row.pc = 0x0800;
            row.xpc = 0x80010000;
        }
        batch.presence.push_back(row);
    }
    ASSERT_TRUE(journal->commit(batch));
    constexpr const char* names[] = {"tag",       "epc",   "zone",     "reader", "antenna", "first_seen",
                                     "last_seen", "reads", "rssi_dbm", "pc",     "xpc"};
    auto sql = quoted_line("present_tags", names, "tag");
    std::vector<std::string> expected = {
        "'3074257BF7194E4000000001'|'urn:epc:id:sgtin:0614141.812345.1'|'dock'|'dock-1'|'Ant0'|"
        "'2026-11-21T23:04:00.123456Z'|'2026-11-21T23:04:01.123456Z'|7|-50.5|'0800'|'8001'",
        "'3074257BF7194E4000000002'|'urn:epc:id:sgtin:0614141.812345.2'|NULL|'dock-1'|'Ant0'|"
        "'2026-11-21T23:04:00.123456Z'|'2026-11-21T23:04:01.123456Z'|7|NULL|NULL|NULL"};
    EXPECT_EQ(lines_of_api(folder.store(), sql), expected);
    EXPECT_EQ(lines_of_shell(folder, sql), expected);
    std::vector<std::string> read;
    ASSERT_TRUE((*Reader::open(folder.store()))->present_tags([&](const PresentTag& tag) {
        read.push_back(tag.epc + "|" + tag.zone + "|" + tag.reader + "|" + tag.antenna + "|" +
                       tenths(tag.rssi) + "|" + to_hex(event::pc_words(tag.pc).view()) +
                       to_hex(event::xpc_words(tag.xpc).view()));
        return true;
    }));
    EXPECT_EQ(read,
              (std::vector<std::string>{"urn:epc:id:sgtin:0614141.812345.1|dock|dock-1|Ant0|-50.5|08008001",
                                        "urn:epc:id:sgtin:0614141.812345.2||dock-1|Ant0|NULL|"}));
}

}  // namespace
}  // namespace gantry::journal::tests
