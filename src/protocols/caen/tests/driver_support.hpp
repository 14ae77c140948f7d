#pragma once
#include <gtest/gtest.h>

#include <functional>
#include <map>

#include "protocols/caen/driver.hpp"
#include "protocols/caen/driver_settings.hpp"
#include "testkit/script.hpp"
#include "testkit/vectors.hpp"

// What the tests of the driver share: a driver with a hand on each of its faces, and a reader of a few lines
// that answers as it is told.
namespace gantry::caen::driver_test {

using testkit::hex;
using Given = std::vector<std::pair<std::string, std::string>>;  // settings

inline DriverOptions options_with(const Given& given = {}, std::string model = {},
                                  std::string notify_at = {}) {
    auto settings = Settings::make(driver_settings, given);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return {.settings = *settings,
            .name = "dock-1",
            .model = std::move(model),
            .notify_at = std::move(notify_at)};
}

inline event::TagId epc(std::string_view text) {
    return event::TagId(hex(text));
}

inline Bytes take_output(Party& party) {
    Bytes out(party.output().begin(), party.output().end());
    party.output_sent(out.size());
    return out;
}

// The pairs of one tag as InventoryTag sends them (section 7).
inline void append_tag(Bytes& out, std::string_view id, std::string_view point = "Ant0",
                       std::int64_t time_us = 0, std::string_view source = "Source_0") {
    append_text(out, Attribute::source_name, source);
    append_text(out, Attribute::read_point_name, point);
    append_time(out, Attribute::time_stamp, time_us);
    append_number(out, Attribute::tag_type, 3);
    append_number(out, Attribute::tag_id_len, id.size() / 2);
    append_bytes(out, Attribute::tag_id, hex(id));
}
inline Bytes tag_pairs(std::string_view id, std::string_view point = "Ant0", std::int64_t time_us = 0) {
    Bytes out;
    append_tag(out, id, point, time_us);
    return out;
}
inline Bytes result_pair(ResultCode code) {
    Bytes out;
    append_number(out, Attribute::result_code, static_cast<std::uint64_t>(code));
    return out;
}

struct Ours {
    // What the reader is asked, kept.
    struct Heard {
        std::uint16_t id = 0;
        Command command{};
        Bytes bytes;
        Parsed parsed() const { return parse(bytes); }
        std::string text(Attribute attribute) const {
            return std::string(parsed().text(attribute).value_or("-"));
        }
        std::int64_t number(Attribute attribute) const {
            return parsed().number(attribute) ? std::int64_t{*parsed().number(attribute)} : -1;
        }
    };
    // Appends the pairs of the answer and says its result; nothing: no answer.
    using Answer = std::function<std::optional<ResultCode>(const Heard&, Bytes& pairs)>;

    explicit Ours(const Given& settings = {}, std::string model = "R1260I", std::string notify_at = {})
        : driver(options_with(settings, std::move(model), std::move(notify_at))) {
        info = "R1260I 0000123";
        answers[Command::get_reader_info] = [this](auto&, Bytes& pairs) {
            append_text(pairs, Attribute::reader_info, info);
            return ResultCode::success;
        };
        answers[Command::get_firmware_release] = [](auto&, Bytes& pairs) {
            append_text(pairs, Attribute::fw_release, "4.1.0");
            return ResultCode::success;
        };
        answers[Command::get_protocol] = [](auto&, Bytes& pairs) {
            append_number(pairs, Attribute::protocol, 3);
            return ResultCode::success;
        };
        auto inventory = [this](auto& asked_for, Bytes& pairs) -> std::optional<ResultCode> {
            auto flags = asked_for.number(Attribute::bitmask);
            if (flags > 0 && (flags & flag_framed) != 0) {
                says(stream_head(asked_for.id));
                return {};
            }
            pairs = tags;
            return ResultCode::success;
        };
        answers[Command::inventory_tag] = answers[Command::raw_read_ids] = inventory;
    }
    void starts() {
        driver.start(now);
        turn();
    }
    static Bytes stream_head(std::uint16_t id) {
        Bytes head;
        Builder(head, to_host_head, id).command(Command::inventory_tag).finish_undefined();
        return head;
    }
    void refuses(Command command, ResultCode code = ResultCode::invalid_function) {
        answers[command] = [code](auto&, Bytes&) { return code; };
    }
    void silences(Command command) {
        answers[command] = [](auto&, Bytes&) { return std::nullopt; };
    }
    // The driver gets these bytes when it has no more to say.
    void says(const Bytes& bytes) { to_say.insert(to_say.end(), bytes.begin(), bytes.end()); }

    void gets(ByteView bytes) {
        driver.received(bytes, now);
        collect();
        turn();
    }
    // Carries bytes both ways until nobody says more.
    void turn() {
        collect();
        for (int i = 0; i < 10'000; ++i) {
            auto said = take_output(driver);
            if (said.empty() && to_say.empty()) return;
            framer.add(said);
            while (auto item = framer.next()) {
                if (item->what == Framer::What::abort) {
                    ++aborts;
                    if (on_abort) on_abort();
                } else if (item->what == Framer::What::message) {
                    answer(item->bytes);
                }
            }
            auto bytes = std::exchange(to_say, {});
            if (!bytes.empty()) driver.received(bytes, now);
            collect();
        }
        ADD_FAILURE() << "it never ends";
    }
    void answer(ByteView bytes) {
        auto parsed = parse(bytes);
        ASSERT_TRUE(parsed.command) << to_hex(bytes);
        heard.push_back(
            {parsed.header.id, static_cast<Command>(*parsed.command), Bytes(bytes.begin(), bytes.end())});
        auto found = answers.find(heard.back().command);
        Bytes pairs;
        std::optional<ResultCode> result = ResultCode::success;
        if (found != answers.end()) result = found->second(heard.back(), pairs);
        if (!result) return;
        Builder builder(to_say, to_host_head, heard.back().id);
        builder.command(heard.back().command);
        to_say.insert(to_say.end(), pairs.begin(), pairs.end());
        builder.result(*result);
        ASSERT_TRUE(builder.finish());
    }
    void collect() {
        for (auto& signal : driver.signals()) {
            if (auto* job = std::get_if<JobEnded>(&signal))
                ended.push_back(*job);
            else if (auto* said = std::get_if<Described>(&signal))
                described.push_back(*said);
        }
        driver.signals().clear();
        for (auto& report : driver.reports()) {
            EXPECT_EQ(report.ticket, ++tickets) << "tickets grow by one";
            for (auto& each : report.observations)
                seen.push_back(each);
            for (auto& notice : report.notices)
                faults.push_back(std::get<FaultNotice>(notice));
            reports.push_back(std::move(report));
        }
        driver.reports().clear();
        if (commits && tickets > 0) driver.committed(tickets, now);
    }
    void waits(std::chrono::microseconds time) {
        auto end = now + time;
        for (auto due = driver.deadline(); due && *due <= end.steady && !driver.finished();
             due = driver.deadline()) {
            now = now + std::chrono::ceil<std::chrono::microseconds>(std::max(*due, now.steady) - now.steady);
            driver.time_passed(now);
            turn();
            auto again = driver.deadline();
            ASSERT_TRUE(!again || *again > now.steady || driver.finished())
                << "a deadline that does not move on";
        }
        now = end;
        driver.time_passed(now);
        turn();
    }
    JobId runs(const Job& job, bool again = false, std::chrono::seconds within = 30s) {
        driver.run({.id = ++last_job, .deadline = now.steady + within, .again = again}, job, now);
        turn();
        return last_job;
    }
    // Runs it to its end.
    JobResult does(const Job& job, bool again = false) {
        auto id = runs(job, again);
        for (int i = 0; i < 1000; ++i) {
            for (auto& each : ended)
                if (each.job == id) return each.result;
            waits(50ms);
        }
        ADD_FAILURE() << "the job never ends";
        return {};
    }
    std::vector<std::string> asked(std::size_t from = 0) const {
        std::vector<std::string> names;
        for (auto i = from; i < heard.size(); ++i)
            names.emplace_back(row_of(heard[i].command).name);
        return names;
    }
    // Stays until the same is asked again, so that what parsed() points into is there.
    const std::vector<Heard>& all(Command command) const {
        auto& found = found_[command];
        found.clear();
        for (auto& each : heard)
            if (each.command == command) found.push_back(each);
        return found;
    }
    std::size_t streams() const { return all(Command::inventory_tag).size(); }
    std::uint64_t count(Count which) const { return driver.counters()[static_cast<std::size_t>(which)]; }
    std::string detail() const { return described.empty() ? "-" : described.back().detail; }

    Now now = testkit::script_start;
    CaenDriver driver;
    std::string info;
    Bytes tags;  // the pairs that an inventory brings
    std::map<Command, Answer> answers;
    std::function<void()> on_abort;
    unsigned aborts = 0;
    bool commits = true;
    Framer framer{to_reader_head};
    Bytes to_say;
    std::vector<Heard> heard;
    std::vector<Report> reports;
    std::vector<Observation> seen;
    std::vector<FaultNotice> faults;
    std::vector<JobEnded> ended;
    std::vector<Described> described;
    Ticket tickets = 0;
    JobId last_job = 0;

private:
    mutable std::map<Command, std::vector<Heard>> found_;
};

}  // namespace gantry::caen::driver_test
