#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <deque>

#include "driver_support.hpp"

namespace gantry::caen::driver_test {

// Bytes of no sense, and good messages with a few bytes changed, in any pieces: no crash, no time that stands
// still, nothing that grows.
static void play(CaenDriver& driver, SideParty* side, const std::vector<Bytes>& pieces) {
    Now now = testkit::script_start;
    driver.start(now);
    if (side != nullptr) side->start(now);
    unsigned number = 0;
    for (auto& piece : pieces) {
        ++number;
        if (number % 5 == 0) driver.run({.id = number, .deadline = now.steady + 3s}, GetInputs{}, now);
        if (side != nullptr && number % 3 == 0)
            side->received(piece, now);
        else if (driver.wants_input())
            driver.received(piece, now);
        now = now + 300ms;
        auto due = driver.deadline();
        if (due && *due <= now.steady) driver.time_passed(now);
        auto again = driver.deadline();
        RC_ASSERT(!again || *again > now.steady || driver.finished());
        RC_ASSERT(driver.output().size() < 10'000u);
        driver.output_sent(driver.output().size());
        driver.reports().clear();
        driver.signals().clear();
    }
    driver.link_lost(now);
    unsigned ends = 0;
    for (auto& signal : driver.signals())
        ends += std::holds_alternative<JobEnded>(signal) ? 1 : 0;
    RC_ASSERT(ends <= pieces.size());
}

RC_GTEST_PROP(CaenDriverProperty, RandomBytesDoNoHarm, (const std::vector<Bytes>& pieces)) {
    CaenDriver driver(options_with({}, "all", "127.0.0.1:3000"));
    play(driver, driver.notifications(), pieces);
}

RC_GTEST_PROP(CaenDriverProperty, AlmostGoodMessagesDoNoHarm, ()) {
    auto count = *rc::gen::inRange(1, 40);
    std::vector<Bytes> pieces;
    for (int i = 0; i < count; ++i) {
        Bytes message;
        Builder builder(message, to_host_head, static_cast<std::uint16_t>(*rc::gen::inRange(0, count)));
        builder.command(*rc::gen::element(std::uint16_t{0x13}, std::uint16_t{0x12}, std::uint16_t{0x9E},
                                          std::uint16_t{0x7C}, std::uint16_t{0x79}, std::uint16_t{0x8A},
                                          std::uint16_t{0x8B}, std::uint16_t{0x86}));
        auto pairs = tag_pairs("3074257BF7194E4000001A85");
        message.insert(message.end(), pairs.begin(), pairs.end());
        builder.result(static_cast<ResultCode>(*rc::gen::element(0, 0, 0, 127, 200, 202, 206, 120)));
        RC_ASSERT(builder.finish());
        if (*rc::gen::inRange(0, 4) == 0) message[8] = message[9] = 0;  // a stream
        auto changes = *rc::gen::inRange(0, 3);
        for (int j = 0; j < changes; ++j)
            message[*rc::gen::inRange(std::size_t{0}, message.size())] = *rc::gen::arbitrary<std::uint8_t>();
        auto cut = *rc::gen::inRange(std::size_t{0}, message.size());
        auto at = message.begin() + static_cast<std::ptrdiff_t>(cut);
        pieces.emplace_back(message.begin(), at);
        pieces.emplace_back(at, message.end());
    }
    CaenDriver driver(
        options_with({}, *rc::gen::element(std::string("all"), std::string("R1260I")), "127.0.0.1:3000"));
    play(driver, driver.notifications(), pieces);
}

// A reader that does one thing after another and takes its time for inventories, in bytes that come in any
// pieces: each tag that it sends is reported once.
struct SlowReader {
    struct Said {
        Steady at;
        Bytes bytes;
    };
    explicit SlowReader(std::string_view mode) : ours(Given{{"mode", std::string(mode)}}) {
        ours.answers[Command::get_io] = [](auto&, Bytes& pairs) {
            append_number(pairs, Attribute::io_register, 1);
            return ResultCode::success;
        };
        for (auto& [command, answer] : ours.answers) {
            bool inventory = command == Command::inventory_tag;
            answer = [this, inventory, plain = answer](auto& heard, Bytes& pairs) {
                return inventory ? inventories(heard) : later(heard, plain, pairs);
            };
        }
        ours.answers[Command::set_source_config] = [this](auto& heard, Bytes& pairs) {
            return later(
                heard, [](auto&, Bytes&) { return ResultCode::success; }, pairs);
        };
        ours.on_abort = [this] {
            if (!std::exchange(streaming, false)) return;
            if (*rc::gen::arbitrary<bool>()) say(0ms, tags());
            if (ends_with_code) say(0ms, result_pair(ResultCode::success));
        };
    }
    Bytes tags() {
        Bytes pairs;
        for (auto left = *rc::gen::inRange(1, 5); left > 0; --left) {
            ++sent;
            append_tag(pairs, "3074257BF7194E4000001A85");
            append_number(pairs, Attribute::rssi, 0xFDF0);
        }
        return pairs;
    }
    void say(std::chrono::microseconds takes, Bytes bytes) {
        free_at = std::max(free_at, ours.now.steady) + takes;
        queue.push_back({free_at, std::move(bytes)});
    }
    static Bytes whole(const Ours::Heard& heard, const Bytes& pairs) {
        Bytes message;
        Builder builder(message, to_host_head, heard.id);
        builder.command(heard.command);
        message.insert(message.end(), pairs.begin(), pairs.end());
        EXPECT_TRUE(builder.result(ResultCode::success).finish());
        return message;
    }
    std::optional<ResultCode> later(const Ours::Heard& heard, const Ours::Answer& plain, Bytes& pairs) {
        plain(heard, pairs);
        say(0ms, whole(heard, pairs));
        return {};
    }
    std::optional<ResultCode> inventories(const Ours::Heard& heard) {
        auto takes = std::chrono::milliseconds{*rc::gen::element(5, 5, 5, 50, 4990, 5010, 12'000, 20'000)};
        if ((std::max(heard.number(Attribute::bitmask), std::int64_t{0}) & flag_framed) == 0) {
            say(takes, whole(heard, tags()));
            return {};
        }
        streaming = true;
        say(5ms, Ours::stream_head(heard.id));
        if (starts_with_code) say(0ms, result_pair(ResultCode::success));
        return {};
    }
    void run(std::chrono::milliseconds time) {
        for (auto end = ours.now.steady + time; ours.now.steady < end && !ours.driver.finished();) {
            if (streaming && *rc::gen::inRange(0, 4) == 0) say(0ms, tags());
            ours.waits(5ms);
            while (!queue.empty() && queue.front().at <= ours.now.steady) {
                auto said = std::move(queue.front());
                queue.pop_front();
                auto cut = *rc::gen::inRange(std::size_t{0}, said.bytes.size());
                ours.gets(ByteView(said.bytes).first(cut));
                ours.gets(ByteView(said.bytes).subspan(cut));
            }
        }
    }

    Ours ours;
    std::deque<Said> queue;
    Steady free_at{};
    std::size_t sent = 0;
    bool streaming = false;
    bool starts_with_code = *rc::gen::arbitrary<bool>(), ends_with_code = *rc::gen::arbitrary<bool>();
};

static void every_read_comes_out_once(std::string_view mode, std::chrono::milliseconds time) {
    SlowReader reader(mode);
    auto& ours = reader.ours;
    ours.starts();
    unsigned jobs = 0;
    for (int i = 0; i < 3; ++i) {
        reader.run(time);
        for (auto more = *rc::gen::inRange(0, 4); more > 0; --more, ++jobs)
            ours.runs(GetInputs{}, false, 300s);
    }
    reader.run(time);
    ours.silences(Command::inventory_tag);  // and what was asked before is brought to its end
    for (int i = 0; i < 200 && (!reader.queue.empty() || reader.streaming || ours.ended.size() < jobs); ++i) {
        if (reader.streaming) {  // a job ends the stream
            ours.runs(GetInputs{});
            ++jobs;
        }
        reader.run(500ms);
    }
    reader.run(1s);
    ours.driver.link_lost(ours.now);
    ours.collect();
    RC_ASSERT(ours.driver.finish_reason() == "the link is gone");
    RC_ASSERT(ours.seen.size() == reader.sent);
    RC_ASSERT(ours.count(Count::reads) == reader.sent);
    RC_ASSERT(ours.count(Count::skipped_bytes) == 0u);
    RC_ASSERT(ours.ended.size() == jobs);
    for (auto& each : ours.seen)
        RC_ASSERT(each.tag == epc("3074257BF7194E4000001A85"));
}

RC_GTEST_PROP(CaenDriverProperty, EveryReadOfARoundComesOutOnce, ()) {
    every_read_comes_out_once("inventory", 20s);
}

RC_GTEST_PROP(CaenDriverProperty, EveryReadOfAStreamComesOutOnce, ()) {
    every_read_comes_out_once("framed", 300ms);
}

}  // namespace gantry::caen::driver_test
