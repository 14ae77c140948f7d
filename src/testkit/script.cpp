#include "testkit/script.hpp"

#include <gtest/gtest.h>

#include "testkit/vectors.hpp"

namespace gantry::testkit {

Step sends(std::string_view hex) {
    return {.kind = Step::Kind::sends, .hex = std::string(hex)};
}
Step gets(std::string_view hex) {
    return {.kind = Step::Kind::gets, .hex = std::string(hex)};
}
Step waits(std::chrono::microseconds time) {
    return {.kind = Step::Kind::waits, .time = time};
}
Step does(std::function<void(Party&, Now)> action) {
    return {.kind = Step::Kind::does, .action = std::move(action)};
}

static Bytes take_output(Party& party) {
    Bytes out(party.output().begin(), party.output().end());
    party.output_sent(out.size());
    return out;
}

static void let_time_pass(Party& party, Now& now, std::chrono::microseconds time) {
    auto end = now + time;
    for (int i = 0; i < 100'000; ++i) {
        auto due = party.deadline();
        if (!due || *due > end.steady) break;
        now = now + std::chrono::ceil<std::chrono::microseconds>(std::max(*due, now.steady) - now.steady);
        party.time_passed(now);
        auto again = party.deadline();
        ASSERT_TRUE(!again || *again > now.steady || party.finished()) << "a deadline that does not move on";
        if (party.finished()) break;
    }
    now = end;
    party.time_passed(now);
}

static Now play(Party& party, std::span<const Step> script, bool check) {
    Now now = script_start;
    party.start(now);
    int number = 0;
    for (auto& step : script) {
        ++number;
        switch (step.kind) {
            case Step::Kind::sends: {
                auto said = take_output(party);
                if (check) {
                    EXPECT_EQ(to_hex(said), to_hex(hex(step.hex))) << "step " << number;
                }
                break;
            }
            case Step::Kind::gets:
                party.received(hex(step.hex), now);
                break;
            case Step::Kind::waits:
                let_time_pass(party, now, step.time);
                break;
            case Step::Kind::does:
                step.action(party, now);
                break;
        }
    }
    return now;
}

Now play(Party& party, std::span<const Step> script) {
    return play(party, script, true);
}

bool ends_in_silence(Party& party, Now now) {
    for (int i = 0; i < 1000 && !party.finished(); ++i) {
        auto due = party.deadline();
        if (!due) return false;
        now = now + std::chrono::ceil<std::chrono::microseconds>(std::max(*due, now.steady) - now.steady);
        party.time_passed(now);
        take_output(party);
    }
    return party.finished();
}

void survives_every_reply_missing(const std::function<std::unique_ptr<Party>()>& make, const Script& script) {
    for (std::size_t i = 0; i < script.size(); ++i) {
        if (script[i].kind != Step::Kind::gets) continue;
        for (bool garbage : {false, true}) {
            SCOPED_TRACE(testing::Message() << "step " << i + 1 << (garbage ? ": garbage" : ": silence"));
            auto party = make();
            auto now = play(*party, std::span(script).first(i), false);
            if (garbage) party->received(Bytes(64, 0xA5), now);
            let_time_pass(*party, now, 1h);
            EXPECT_LT(take_output(*party).size(), 1'000'000u);
        }
    }
}

}  // namespace gantry::testkit
