#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>

#include "field/field.hpp"
#include "link/memory_link.hpp"
#include "protocols/dagprog/device.hpp"
#include "protocols/dagprog/driver.hpp"
#include "protocols/dagprog/plugin.hpp"
#include "testkit/script.hpp"
#include "testkit/vectors.hpp"

// What the tests of this make share: lines, a field with HF tags, a driver with a hand on each of its faces,
// a unit likewise, and both joined in memory.
namespace gantry::dagprog::test {

using testkit::hex;
using Given = std::vector<std::pair<std::string, std::string>>;  // settings
using Status = JobResult::Status;

// What a unit says: "SO" as STX S O CR, several one after another; \t stands for itself.
inline std::string said(std::initializer_list<std::string_view> lines) {
    std::string out;
    for (auto line : lines)
        out += "\x02" + std::string(line) + "\r";
    return out;
}
inline Bytes bytes_of(std::string_view text) {
    auto view = as_bytes(text);
    return {view.begin(), view.end()};
}
inline std::string take_text(Party& party) {
    std::string out(as_text(party.output()));
    party.output_sent(out.size());
    return out;
}

inline Settings driver_with(const Given& given = {}) {
    auto settings = Settings::make(plugin.driver_settings, given);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return *settings;
}
inline Settings device_with(const Given& given = {}) {
    auto settings = Settings::make(plugin.device_settings, given);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return *settings;
}
inline bool is_icode1(const Given& device) {
    return std::ranges::find(device, std::pair<std::string, std::string>{"family", "icode1"}) != device.end();
}

inline constexpr std::string_view tag_a = "E004010012345678", tag_b = "E0040100AABBCCDD",
                                  icode_a = "0102030405060708";
inline event::TagId id(std::string_view text) {
    return event::TagId(hex(text));
}

// A field with one antenna.
struct Hf {
    explicit Hf(event::Technology kind = event::Technology::iso15693) : technology(kind) {}
    void put(std::string_view tag, Bytes blocks = {}) {
        field::PlacedTag placed;
        placed.tag.id = id(tag);
        placed.tag.technology = technology;
        placed.tag.user = std::move(blocks);
        placed.rssi_dbm = -50;
        field.place(air, placed);
    }
    void take(std::string_view tag) { field.remove(air, id(tag)); }
    std::string block(std::string_view tag, std::uint32_t block, Now now) {
        auto data = air.read({.carrier = {}, .tag = id(tag), .now = now.steady}, Bank::user, block * 2, 2);
        return data ? to_hex(*data) : "-";
    }

    event::Technology technology;
    field::Field field;
    Air& air = field.add_reader("desk", 1, 20);
};

// A virtual unit and what it says.
struct Unit {
    explicit Unit(const Given& settings = {}, bool starts = true)
        : hf(is_icode1(settings) ? event::Technology::icode1 : event::Technology::iso15693),
          device({"desk", 3, device_with(settings)}, hf.air) {
        device.power_on(now);
        device.start(now);
        if (!starts) return;
        waits(1s);
        text();
    }
    std::string text() { return take_text(device); }
    // What it answers to a line, which may lack its CR.
    std::string ask(std::string line) {
        if (!line.ends_with('\r')) line += '\r';
        device.received(as_bytes(line), now);
        return text();
    }
    // The same once it is at rest.
    std::string at_rest(const std::string& line) {
        ask("SO");
        return ask(line);
    }
    std::string waits(std::chrono::microseconds time) {
        auto end = now + time;
        for (auto due = device.deadline(); due && *due <= end.steady; due = device.deadline()) {
            now = now + std::chrono::ceil<std::chrono::microseconds>(std::max(*due, now.steady) - now.steady);
            device.time_passed(now);
        }
        now = end;
        device.time_passed(now);
        return text();
    }
    std::int64_t state(std::string_view name) const {
        auto fields = device.state();
        auto* value = wire::find(fields, name);
        EXPECT_NE(value, nullptr) << name;
        if (auto* yes = value->get<bool>()) return *yes ? 1 : 0;
        return *value->get<std::int64_t>();
    }

    Now now = testkit::script_start;
    Hf hf;
    DagprogDevice device;
};

// A driver whose unit is this test.
struct Ours {
    explicit Ours(const Given& settings = {}, const Known& known = {})
        : driver({.settings = driver_with(settings)}) {
        driver.admitted(known, now);
        driver.start(now);
    }
    void gets(std::string_view text) {
        driver.received(as_bytes(text), now);
        collect();
    }
    void collect() {
        for (auto& report : driver.reports()) {
            EXPECT_EQ(report.ticket, last_ticket + 1);
            last_ticket = report.ticket;
            if (commits) driver.committed(report.ticket, now);
            reports.push_back(std::move(report));
        }
        driver.reports().clear();
        for (auto& signal : driver.signals())
            signals.push_back(std::move(signal));
        driver.signals().clear();
    }
    std::string says() { return take_text(driver); }
    void waits(std::chrono::microseconds time) {
        auto end = now + time;
        for (auto due = driver.deadline(); due && *due <= end.steady && !driver.finished();
             due = driver.deadline()) {
            now = now + std::chrono::ceil<std::chrono::microseconds>(std::max(*due, now.steady) - now.steady);
            driver.time_passed(now);
            collect();
            auto again = driver.deadline();
            ASSERT_TRUE(!again || *again > now.steady || !driver.output().empty())
                << "a deadline that does not move on";
        }
        now = end;
        driver.time_passed(now);
        collect();
    }
    // The dialog of a unit that says what it is, and takes any form.
    void identifies(std::string_view family = "iso15693") {
        gets(said({"#0\tDAGProg", "#6"}));
        answers(registers(family), 40);
    }
    using Answers = std::vector<std::pair<std::string, std::string>>;  // the first that fits
    static Answers registers(std::string_view family) {
        bool icode1 = family == "icode1";
        return {{"v?\r", said({"V=\tV1.00A"})},
                {"SO\r", said({"SO"})},
                {"tl\r", icode1 ? said({"??"}) : said({"TL\t00000"})},
                {"bk\r", "bk"},
                {"nb\r", said({"NB\t00000"})},
                {"tx\r", icode1 ? said({"TX\t00001"}) : said({"TX\t00005"})},
                {"BK\t", "echo"},
                {"NB\t", "echo"},
                {"TX\t", "echo"},
                {"TL\t", "echo"},
                {"SV\r", said({"SV\t00001"})},
                {"UR\r", said({"UR"})},
                {"SR\r", said({"SR"})},
                {"RC\r", said({"RC"})},
                {"AP0\r", said({"AP0"})},
                {"AP1\r", said({"AP1"})}};
    }
    // Answers what the driver says until it is silent; its empty lines are met with time.
    void answers(const Answers& table, unsigned most) {
        for (unsigned i = 0; i < most; ++i) {
            auto line = says();
            if (line.empty()) return;
            heard.push_back(line);
            if (line == "\r") {
                waits(200ms);
                continue;
            }
            for (auto& [begin, answer] : table) {
                if (!line.starts_with(begin)) continue;
                if (answer == "echo") {
                    if (begin == "BK\t") first_block = line.substr(3, line.size() - 4);
                    gets("\x02" + line);
                } else if (answer == "echo any") {
                    gets(said({"BK\t" + line.substr(line.size() - 6, 5)}));
                } else if (answer == "bk") {
                    gets(said({"BK\t" + first_block}));
                } else {
                    gets(answer);
                }
                break;
            }
        }
    }
    std::vector<Observation> observations() const {
        std::vector<Observation> all;
        for (auto& report : reports)
            all.insert(all.end(), report.observations.begin(), report.observations.end());
        return all;
    }
    std::string faults() const {
        std::string text;
        for (auto& report : reports)
            for (auto& each : report.notices)
                if (auto* fault = std::get_if<FaultNotice>(&each)) text += fault->text + "\n";
        return text;
    }
    std::vector<JobEnded> ended() const {
        std::vector<JobEnded> out;
        for (auto& signal : signals)
            if (auto* job = std::get_if<JobEnded>(&signal)) out.push_back(*job);
        return out;
    }
    std::string detail() const {
        std::string text;
        for (auto& signal : signals)
            if (auto* told = std::get_if<Described>(&signal))
                text = told->model + ", " + told->firmware + ", " + told->detail;
        return text;
    }
    Bytes mark() const {
        Bytes mark;
        for (auto& report : reports)
            if (report.mark) mark = *report.mark;
        return mark;
    }
    std::uint64_t count(Count which) const { return driver.counters()[static_cast<std::size_t>(which)]; }
    void run(JobId number, const Job& job, std::chrono::seconds time = 10s) {
        driver.run({.id = number, .deadline = now.steady + time}, job, now);
        collect();
    }

    Now now = testkit::script_start;
    DagprogDriver driver;
    std::string first_block = "00003";
    std::vector<std::string> heard;
    std::vector<Report> reports;
    std::vector<Signal> signals;
    Ticket last_ticket = 0;
    bool commits = true;
};

// Driver and virtual unit on one line.
struct Pair {
    explicit Pair(const Given& device_settings = {}, const Given& driver_settings = {},
                  const Known& known = {})
        : hf(is_icode1(device_settings) ? event::Technology::icode1 : event::Technology::iso15693),
          device({"desk", 3, device_with(device_settings)}, hf.air),
          driver({.settings = driver_with(driver_settings)}),
          link(driver, device, testkit::script_start) {
        device.power_on(link.now());
        driver.admitted(known, link.now());
        link.piece = 0;
        link.after_turn = [this] { collect(); };
        link.connect();
    }
    void collect() {
        for (auto& report : driver.reports()) {
            driver.committed(report.ticket, link.now());
            reports.push_back(std::move(report));
        }
        driver.reports().clear();
        for (auto& signal : driver.signals())
            signals.push_back(std::move(signal));
        driver.signals().clear();
    }
    void run_for(std::chrono::microseconds time) { link.run_for(time); }
    JobResult does(const Job& job, std::chrono::seconds patience = 20s, bool again = false) {
        JobOrder order{.id = ++jobs, .deadline = link.now().steady + patience, .again = again};
        driver.run(order, job, link.now());
        collect();
        for (auto end = link.now().steady + patience + 1s; link.now().steady < end;) {
            for (auto& signal : signals)
                if (auto* ended = std::get_if<JobEnded>(&signal); ended != nullptr && ended->job == order.id)
                    return ended->result;
            link.run_for(20ms);
        }
        ADD_FAILURE() << "the job does not end";
        return {};
    }
    Bytes inject(std::string_view word) {
        EXPECT_TRUE(device.inject(word, link.now())) << word;
        return {};
    }
    std::uint64_t reads(std::string_view tag) const {
        std::uint64_t sum = 0;
        for (auto& report : reports)
            for (auto& each : report.observations)
                sum += each.tag == id(tag) ? 1u : 0u;
        return sum;
    }
    std::string faults() const {
        std::string text;
        for (auto& report : reports)
            for (auto& each : report.notices)
                if (auto* fault = std::get_if<FaultNotice>(&each)) text += fault->text + "\n";
        return text;
    }
    std::string detail() const {
        std::string text;
        for (auto& signal : signals)
            if (auto* told = std::get_if<Described>(&signal))
                text = told->model + ", " + told->firmware + ", " + told->detail;
        return text;
    }
    std::string state(std::string_view name) const {
        auto fields = device.state();
        auto* value = wire::find(fields, name);
        if (value == nullptr) return "-";
        if (auto* text = value->get<std::string>()) return *text;
        if (auto* yes = value->get<bool>()) return *yes ? "true" : "false";
        return std::to_string(*value->get<std::int64_t>());
    }
    std::string block(std::string_view tag, std::uint32_t number) {
        return hf.block(tag, number, link.now());
    }

    Hf hf;
    DagprogDevice device;
    DagprogDriver driver;
    link::MemoryLink link;
    std::vector<Report> reports;
    std::vector<Signal> signals;
    JobId jobs = 0;
};

inline std::string value_text(const JobResult& result, std::string_view name) {
    auto* value = wire::find(result.values, name);
    if (value == nullptr) return "-";
    if (auto* text = value->get<std::string>()) return *text;
    if (auto* data = value->get<Bytes>()) return to_hex(*data);
    return std::to_string(*value->get<std::int64_t>());
}
inline Execute command(std::string name, wire::Fields fields = {}) {
    return {{.name = std::move(name), .header = {}, .fields = std::move(fields)}};
}
inline wire::Value words(std::string_view text) {
    return wire::Value(std::string(text));
}
inline TagAccess access_to(std::string_view tag) {
    TagAccess access;
    access.tag = id(tag);
    access.technology = tag.starts_with("E0") ? event::Technology::iso15693 : event::Technology::icode1;
    return access;
}

}  // namespace gantry::dagprog::test
