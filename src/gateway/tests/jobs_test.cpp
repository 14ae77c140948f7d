// The life of a job, without sockets, disks and clocks.
#include "gateway/jobs.hpp"

#include <algorithm>

#include <gtest/gtest.h>

namespace gantry::gateway {
namespace {

class Bench : public JobHost {
public:
    Jobs jobs{*this};
    Now now{Steady{} + 1h, from_us(1'800'000'000'000'000)};
    std::vector<journal::JobRow> rows;  // on their way to the disk
    std::map<std::uint32_t, bool> is_reading, kept;
    Steady wakes = Steady::max();
    std::vector<JobOrder> sent;
    std::vector<JobId> cancelled;

    void store(const journal::JobRow& row) override { rows.push_back(row); }
    bool reading(std::uint32_t reader) const override {
        auto it = is_reading.find(reader);
        return it == is_reading.end() || it->second;
    }
    void set_reading(std::uint32_t reader, bool reading) override { is_reading[reader] = reading; }
    void keep_reading(std::uint32_t reader, bool reading) override { kept[reader] = reading; }
    void wake_at(Steady when) override { wakes = std::min(wakes, when); }

    JobId submit(Job job, std::chrono::milliseconds timeout = 10s) {
        auto id = jobs.submit({0, "dock-1"}, std::move(job), timeout, now);
        EXPECT_TRUE(id) << (id ? "" : id.error().text());
        return id.value_or(0);
    }
    std::vector<journal::JobRow> commit() {
        auto done = std::exchange(rows, {});
        std::vector<JobId> ids;
        for (auto& row : done)
            ids.push_back(row.id);
        jobs.stored(ids, now);
        return done;
    }
    void up(std::uint64_t line) {
        jobs.reader_up(
            0, {line,
                [this](const JobOrder& order, const std::shared_ptr<const Job>&) { sent.push_back(order); },
                [this](JobId id) { cancelled.push_back(id); }});
    }
    void pass(std::chrono::milliseconds time) {
        now = now + time;
        jobs.time_passed(now);
    }
    void ended(JobId id, JobResult::Status status, bool link_broke = false) {
        jobs.ended(id, {status, "", {}}, link_broke, now);
    }
    JobState state(JobId id) const { return jobs.find(id)->state; }
};

using Status = JobResult::Status;

TEST(Jobs, AreOnDiskAsRunningBeforeTheReaderHearsOfThem) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(GetInputs{});
    EXPECT_TRUE(bench.sent.empty());
    ASSERT_EQ(bench.rows.size(), 1u);
    EXPECT_EQ(bench.rows[0].state, "running");
    bench.commit();
    ASSERT_EQ(bench.sent.size(), 1u);
    EXPECT_EQ(bench.sent[0].id, id);
    EXPECT_FALSE(bench.sent[0].again);
    bench.ended(id, Status::done);
    EXPECT_EQ(bench.commit().at(0).state, "done");
    EXPECT_EQ(bench.state(id), JobState::done);
}

TEST(Jobs, ThatTheStoreDoesNotTakeAreNeverSent) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(GetInputs{}, 1s);
    EXPECT_LE(bench.wakes, bench.now.steady + 1s);
    bench.pass(1s);
    EXPECT_EQ(bench.state(id), JobState::cancelled);
    EXPECT_EQ(bench.jobs.find(id)->text, "the store took no data before the deadline; it was never sent");
    bench.commit();
    EXPECT_TRUE(bench.sent.empty());
}

TEST(Jobs, ADriverThatForgetsItsDeadlineDoesNotKeepThemForEver) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(GetInputs{}, 1s);
    bench.commit();
    bench.pass(2s);
    EXPECT_EQ(bench.state(id), JobState::running) << "the driver's own word is awaited for a moment";
    bench.pass(5s);
    EXPECT_EQ(bench.state(id), JobState::timed_out);
    bench.ended(id, Status::done);
    EXPECT_EQ(bench.state(id), JobState::timed_out) << "too late";
}

TEST(Jobs, AreSentAgainOnTheNextLinkAndTheDiskNeverForgetsThatTheyWereSent) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(WriteTag{});
    bench.commit();
    bench.ended(id, Status::unknown, true);
    bench.jobs.reader_down(0, 1);
    EXPECT_EQ(bench.state(id), JobState::queued);
    EXPECT_TRUE(bench.rows.empty()) << "it stays running there";
    bench.up(2);
    bench.commit();
    ASSERT_EQ(bench.sent.size(), 2u);
    EXPECT_TRUE(bench.sent[1].again);
    bench.ended(id, Status::unknown, true);
    bench.jobs.reader_down(0, 2);
    bench.pass(20s);
    EXPECT_EQ(bench.state(id), JobState::unknown) << "it was sent, so nobody may say that it was not";
}

TEST(Jobs, ThatTheDriverHadNotSentYetAreNotSentAgainButForTheFirstTime) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(RestartReader{});
    bench.commit();
    bench.ended(id, Status::cancelled, true);
    bench.jobs.reader_down(0, 1);
    EXPECT_EQ(bench.state(id), JobState::queued);
    bench.up(2);
    bench.commit();
    ASSERT_EQ(bench.sent.size(), 2u);
    EXPECT_FALSE(bench.sent[1].again);
}

TEST(Jobs, ALateEndOnTheOldLinkMeetsTheNewOne) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(GetInputs{});
    bench.commit();
    bench.jobs.reader_down(0, 1);
    bench.up(2);
    bench.commit();
    EXPECT_EQ(bench.sent.size(), 1u) << "the old link has not said yet what became of it";
    bench.ended(id, Status::unknown, true);
    bench.commit();
    EXPECT_EQ(bench.sent.size(), 2u);
    bench.jobs.reader_down(0, 1);
    bench.ended(id, Status::done);
    EXPECT_EQ(bench.state(id), JobState::done);
}

TEST(Jobs, ThatWereSentOverAnEarlierLinkAreNeverCalledUnsent) {
    Bench bench;
    bench.up(1);
    auto asked = bench.submit(GetInputs{}), late = bench.submit(GetInputs{});
    bench.commit();
    for (auto id : {asked, late})
        bench.ended(id, Status::unknown, true);
    bench.jobs.reader_down(0, 1);
    bench.up(2);
    bench.commit();
    ASSERT_EQ(bench.sent.size(), 4u);
    EXPECT_TRUE(bench.jobs.cancel(asked, bench.now));
    bench.ended(asked, Status::cancelled);
    EXPECT_EQ(bench.state(asked), JobState::unknown);
    EXPECT_EQ(bench.jobs.find(asked)->text,
              "cancelled after the link broke: what the reader did is not known");
    bench.now = bench.now + 20s;
    bench.ended(late, Status::cancelled, true);
    EXPECT_EQ(bench.state(late), JobState::unknown);
    EXPECT_EQ(bench.jobs.find(late)->text, "the link broke under it: what the reader did is not known");
}

TEST(Jobs, OverlappingStopsThatAreAllCancelledLeaveTheReaderReading) {
    Bench bench;
    auto first = bench.submit(StopReading{}), second = bench.submit(StopReading{});
    EXPECT_FALSE(bench.reading(0));
    bench.jobs.cancel(first, bench.now);
    EXPECT_FALSE(bench.reading(0)) << "the second is still wanted";
    bench.jobs.cancel(second, bench.now);
    EXPECT_TRUE(bench.reading(0));
    EXPECT_TRUE(bench.kept.empty());
}

TEST(Jobs, OfOverlappingStopsAndStartsTheNewestThatCountsDecides) {
    Bench bench;
    bench.up(1);
    auto stop = bench.submit(StopReading{}), start = bench.submit(StartReading{});
    auto refused = bench.submit(StopReading{});
    bench.commit();
    EXPECT_FALSE(bench.reading(0));
    bench.ended(stop, Status::done);
    EXPECT_FALSE(bench.kept.at(0)) << "its own wish, not that of a later job";
    bench.ended(start, Status::done);
    EXPECT_TRUE(bench.kept.at(0));
    EXPECT_FALSE(bench.reading(0)) << "one is still open";
    bench.ended(refused, Status::failed);
    EXPECT_TRUE(bench.reading(0));
    // An older one that ends late changes nothing.
    stop = bench.submit(StopReading{});
    start = bench.submit(StartReading{});
    bench.commit();
    bench.ended(start, Status::done);
    bench.ended(stop, Status::timed_out);
    EXPECT_TRUE(bench.reading(0));
    EXPECT_TRUE(bench.kept.at(0));
}

TEST(Jobs, AnOutputThatIsSetForAWhileIsNotSetAgain) {
    Bench bench;
    bench.up(1);
    auto opens = bench.submit(SetOutputs{{{1, true, 0}, {2, true, 3000}}});
    auto stays = bench.submit(SetOutputs{{{1, true, 0}}});
    bench.commit();
    bench.ended(opens, Status::unknown, true);
    bench.ended(stays, Status::unknown, true);
    EXPECT_EQ(bench.state(opens), JobState::unknown);
    EXPECT_EQ(bench.state(stays), JobState::queued);
}

TEST(Jobs, SecretsOfATagGoOnceToWhoWaitsAndAreNotKept) {
    Bench bench;
    bench.up(1);
    ReadTag read;
    read.access.tag = event::TagId(Bytes{0xE2});
    read.bank = Bank::reserved;
    auto waits = bench.submit(read);
    auto alone = bench.jobs.submit({0, "dock-1"}, read, 10s, bench.now, false);
    ASSERT_TRUE(alone);
    bench.commit();
    for (auto id : {waits, *alone})
        bench.jobs.ended(id, {Status::done, "", {{"data", 7}}}, false, bench.now);
    EXPECT_TRUE(bench.jobs.find(waits)->values.empty());
    for (auto& job : bench.jobs.list("", 10))
        EXPECT_TRUE(job.values.empty());
    EXPECT_EQ(bench.jobs.wait(waits)->values.size(), 1u);
    EXPECT_TRUE(bench.jobs.wait(waits)->values.empty());
    EXPECT_TRUE(bench.jobs.wait(*alone)->values.empty());
    EXPECT_EQ(bench.jobs.find(*alone)->text, "what it read is secret and goes only to who waits for it");
}

TEST(Jobs, OneWhoseRowWasDamagedIsStoredWithATimeSoThatItGoes) {
    Bench bench;
    journal::JobRow damaged;
    damaged.id = 3;
    damaged.state = "unknown";
    bench.jobs.restore({damaged}, bench.now.wall);
    ASSERT_EQ(bench.rows.size(), 1u);
    EXPECT_EQ(bench.rows[0].state, "unknown");
    EXPECT_EQ(bench.rows[0].ended, bench.now.wall);
    EXPECT_EQ(bench.jobs.find(3)->ended, bench.now.wall);
}

TEST(Jobs, RestartAndExecAreNotRepeated) {
    Bench bench;
    bench.up(1);
    auto restart = bench.submit(RestartReader{});
    auto exec = bench.submit(Execute{});
    bench.commit();
    bench.ended(restart, Status::unknown, true);
    bench.ended(exec, Status::unknown, true);
    EXPECT_EQ(bench.state(restart), JobState::unknown);
    EXPECT_EQ(bench.state(exec), JobState::unknown);
}

TEST(Jobs, AnAnswerThatCameWithTheEndOfTheLinkCounts) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(RestartReader{});
    bench.commit();
    bench.ended(id, Status::done, true);
    EXPECT_EQ(bench.state(id), JobState::done);
}

TEST(Jobs, WhatIsCancelledDoesNotComeBackWithTheNextLink) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(GetInputs{});
    bench.commit();
    EXPECT_TRUE(bench.jobs.cancel(id, bench.now));
    EXPECT_EQ(bench.cancelled, std::vector<JobId>{id});
    EXPECT_EQ(bench.state(id), JobState::running) << "until its driver has ended it";
    bench.ended(id, Status::unknown, true);
    EXPECT_EQ(bench.state(id), JobState::unknown);
}

TEST(Jobs, AWantedStateThatTheReaderRefusesIsTakenBack) {
    Bench bench;
    bench.up(1);
    auto id = bench.submit(StopReading{});
    EXPECT_FALSE(bench.reading(0));
    bench.commit();
    bench.ended(id, Status::unsupported);
    EXPECT_TRUE(bench.reading(0));
    EXPECT_TRUE(bench.kept.empty());
    bench.submit(StopReading{}, 1s);
    EXPECT_TRUE(bench.kept.empty()) << "not before it is over: until then a crash cancels it";
    bench.commit();
    bench.ended(id + 1, Status::timed_out);
    EXPECT_FALSE(bench.reading(0)) << "what the reader did is not known, what is wanted is";
    EXPECT_EQ(bench.kept, (std::map<std::uint32_t, bool>{{0, false}}));
}

TEST(Jobs, AreBoundedInNumber) {
    Bench bench;
    for (std::size_t i = 0; i < Jobs::max_open_of_a_reader; ++i)
        bench.submit(GetInputs{});
    auto more = bench.jobs.submit({0, "dock-1"}, GetInputs{}, 10s, bench.now);
    ASSERT_FALSE(more);
    EXPECT_EQ(more.error().text(),
              "too many jobs are waiting for dock-1; wait until some have ended, or cancel them");
    EXPECT_TRUE(bench.jobs.submit({1, "dock-2"}, GetInputs{}, 10s, bench.now));
    bench.pass(10s);
    EXPECT_TRUE(bench.jobs.submit({0, "dock-1"}, GetInputs{}, 10s, bench.now));
}

TEST(Jobs, AStoreThatTakesNothingStopsNewOnesBeforeTheMemoryIsFull) {
    Bench bench;
    std::size_t taken = 0;
    for (std::size_t i = 0; i < 4 * Jobs::max_kept; ++i) {
        auto id = bench.jobs.submit({0, "dock-1"}, GetInputs{}, 1s, bench.now);
        if (!id) break;
        ++taken;
        bench.jobs.cancel(*id, bench.now);
    }
    EXPECT_GE(taken, Jobs::max_kept / 2);
    EXPECT_LE(taken, Jobs::max_kept);
    EXPECT_LE(bench.rows.size(), 2 * Jobs::max_kept);
    bench.commit();
    EXPECT_TRUE(bench.jobs.submit({0, "dock-1"}, GetInputs{}, 1s, bench.now));
}

TEST(Jobs, OnlyTheNewestAreRememberedAndOfTheseFewWithTheirValues) {
    Bench bench;
    bench.up(1);
    JobId first = 0;
    for (std::size_t i = 0; i < Jobs::max_kept + 10; ++i) {
        auto id = bench.submit(GetInputs{});
        if (first == 0) first = id;
        bench.commit();
        bench.jobs.ended(id, {Status::done, "", {{"n", 1}}}, false, bench.now);
        bench.commit();
    }
    EXPECT_FALSE(bench.jobs.find(first));
    auto all = bench.jobs.list("", 100'000);
    EXPECT_EQ(all.size(), Jobs::max_kept);
    EXPECT_EQ(std::ranges::count_if(all, [](auto& job) { return !job.values.empty(); }),
              static_cast<std::ptrdiff_t>(Jobs::max_values));
    EXPECT_FALSE(all.front().values.empty());
}

TEST(Jobs, StopEndsWhatWasNotSentAndTakesNoMore) {
    Bench bench;
    bench.up(1);
    auto sent = bench.submit(GetInputs{});
    bench.commit();
    auto unsent = bench.submit(GetInputs{});
    bench.jobs.stop(bench.now);
    EXPECT_EQ(bench.state(unsent), JobState::cancelled);
    EXPECT_EQ(bench.state(sent), JobState::running);
    bench.ended(sent, Status::unknown, true);
    EXPECT_EQ(bench.state(sent), JobState::unknown);
    EXPECT_FALSE(bench.jobs.submit({0, "dock-1"}, GetInputs{}, 1s, bench.now));
}

TEST(JobRecord, HidesPasswordsAndWhatIsWrittenOverThem) {
    WriteTag write;
    write.access.tag = event::TagId(Bytes{0xE2});
    write.access.password = 0xC0FFEE01;
    write.bank = Bank::reserved;
    write.data = {0xDE, 0xAD, 0xBE, 0xEF};
    EXPECT_EQ(describe(write), "tag E2, reserved from 0");
    write.bank = Bank::user;
    EXPECT_EQ(describe(write), "tag E2, user from 0: DEADBEEF");
    KillTag kill;
    kill.access = write.access;
    kill.kill_password = 0xC0FFEE02;
    EXPECT_EQ(describe(kill), "tag E2");
    EXPECT_EQ(describe(SetParameter{"Password", "hunter2"}), "Password = ***");
    EXPECT_EQ(describe(SetParameter{"Power", "5"}), "Power = 5");
    Execute exec;
    exec.command.name = "G2Kill";
    exec.command.fields.push_back({"Password", wire::Value(std::string("C0FFEE03"))});
    EXPECT_EQ(describe(exec), "G2Kill");
    SetParameter hostile{"a\x1B[31m", std::string(10'000, 'x')};
    EXPECT_LT(describe(hostile).size(), 400u);
    EXPECT_EQ(describe(hostile).find('\x1B'), std::string::npos);
}

TEST(JobRecord, KeepsItsNamesAcrossTheStore) {
    for (auto state : {JobState::queued, JobState::running, JobState::done, JobState::failed,
                       JobState::unsupported, JobState::timed_out, JobState::cancelled, JobState::unknown}) {
        JobStatus job;
        job.id = 5;
        job.reader = "dock-1";
        job.op = "tag.read";
        job.state = state;
        auto back = status_of(row_of(job));
        EXPECT_EQ(back.state, state);
        EXPECT_EQ(back.op, job.op);
        auto result = result_status(state);
        EXPECT_TRUE(!result || state_of(*result) == state);
    }
    EXPECT_EQ(op_name(GetInputs{}), "gpio.get");
    EXPECT_EQ(op_name(KillTag{}), "tag.kill");
    EXPECT_EQ(op_name(Execute{}), "exec");
}

}  // namespace
}  // namespace gantry::gateway
