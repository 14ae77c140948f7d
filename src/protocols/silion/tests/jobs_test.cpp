#include "support.hpp"

// Jobs against a scripted reader (docs/protocols/silion.md section 9).
namespace gantry::silion::test {

using Status = JobResult::Status;

static SetOutputs outputs(std::initializer_list<OutputChange> changes) {
    return SetOutputs{changes};
}

struct Jobs : Ours {
    explicit Jobs(Given settings = {}) : Ours(std::move(settings)) { gets(heartbeat_0); }
    void run(JobId id, const Job& job, std::chrono::microseconds within = 10min) {
        driver.run({.id = id, .deadline = now.steady + within}, job, now);
        collect();
    }
    JobEnded last() const {
        auto all = ended();
        EXPECT_FALSE(all.empty());
        return all.empty() ? JobEnded{} : all.back();
    }
};

TEST(SilionJobs, InputsAreReadAndTyped) {
    Jobs jobs;
    jobs.run(7, GetInputs{});
    EXPECT_EQ(jobs.says(), "EE0000001601");
    jobs.gets("FF06000916000000000073696C696F6E040101020003010401");
    auto ended = jobs.last();
    EXPECT_EQ(ended.job, 7u);
    EXPECT_EQ(ended.result.status, Status::done);
    auto& list = *wire::find(ended.result.values, "inputs")->get<wire::Value::List>();
    ASSERT_EQ(list.size(), 4u);
    auto& second = *list[1].get<wire::Fields>();
    EXPECT_EQ(*wire::find(second, "input"), wire::Value(2));
    EXPECT_EQ(*wire::find(second, "state"), wire::Value(false));
}

TEST(SilionJobs, AnAnswerThatCannotBeReadFails) {
    Jobs jobs;
    jobs.run(1, GetInputs{});
    jobs.gets("FF06000216000000000073696C696F6E0401");
    EXPECT_EQ(jobs.last().result.status, Status::failed);
}

TEST(SilionJobs, OutputsAreSetAndBothCodingsOfARefusalAreRead) {
    Jobs jobs;
    jobs.run(1, outputs({{1, true, 7000}}));
    EXPECT_EQ(jobs.says(), "EE000004170101010107");
    jobs.gets("FF06000017000000000073696C696F6E");
    EXPECT_EQ(jobs.last().result.status, Status::done);
    jobs.run(2, outputs({{1, true, 0}, {4, false, 254'000}}));
    EXPECT_EQ(jobs.says(),
              "EE00000717010201010004"
              "00FE");
    jobs.gets("FF0600001700000186A773696C696F6E");
    EXPECT_EQ(jobs.last().result.status, Status::failed);
    EXPECT_EQ(jobs.last().result.text, "the reader answered 7: invalid parameter");
    jobs.run(3, outputs({{1, true, 0}}));
    jobs.gets("FF06000017000000001073696C696F6E");
    EXPECT_EQ(jobs.last().result.text, "the reader answered 16: operation already running");
}

TEST(SilionJobs, WhatTheMakeCannotDoIsNeverSent) {
    Jobs jobs;
    for (auto& job :
         {outputs({}), outputs({{0, true, 0}}), outputs({{6, true, 0}}), outputs({{1, true, 1500}}),
          outputs({{1, true, 255'000}}), outputs({{1, true, 0}, {1, false, 0}})}) {
        jobs.run(1, job);
        EXPECT_EQ(jobs.last().result.status, Status::unsupported);
        EXPECT_FALSE(jobs.last().result.text.empty());
    }
    EXPECT_EQ(jobs.ended().size(), 6u);
    EXPECT_EQ(jobs.says(), "");
}

TEST(SilionJobs, OneCommandOfEachKindIsUnderWay) {
    Jobs jobs;
    jobs.run(1, GetInputs{});
    jobs.run(2, GetInputs{});
    jobs.run(3, RestartReader{});
    EXPECT_EQ(jobs.says(),
              "EE0000001601"
              "EE0000001801");
    jobs.gets("FF06000018000000000073696C696F6E");
    EXPECT_EQ(jobs.last().job, 3u);
    jobs.gets("FF06000916000000000073696C696F6E040101020003010401");
    EXPECT_EQ(jobs.last().job, 1u);
    EXPECT_EQ(jobs.says(), "EE0000001601");
    jobs.gets("FF06000916000000000073696C696F6E040101020003010401");
    EXPECT_EQ(jobs.last().job, 2u);
}

TEST(SilionJobs, NoAnswerIsATimeOut) {
    Jobs jobs;
    jobs.run(1, GetInputs{});
    jobs.waits(4999ms);
    EXPECT_TRUE(jobs.ended().empty());
    jobs.waits(1ms);
    EXPECT_EQ(jobs.last().result.status, Status::timed_out);
    EXPECT_EQ(jobs.count(Count::timeouts), 1u);
}

TEST(SilionJobs, ATimedOutputMayTakeItsTimeAndFiveSecondsMore) {
    Jobs jobs;  // silence would end the connection after 30 s
    jobs.run(1, outputs({{1, true, 60'000}, {2, true, 10'000}}));
    jobs.waits(64'999ms);
    EXPECT_TRUE(jobs.ended().empty());
    EXPECT_FALSE(jobs.driver.finished());
    jobs.gets("FF06000017000000000073696C696F6E");
    EXPECT_EQ(jobs.last().result.status, Status::done);
    jobs.run(2, outputs({{1, true, 60'000}}));
    jobs.waits(65s);
    EXPECT_EQ(jobs.last().result.status, Status::timed_out);
    EXPECT_FALSE(jobs.driver.finished());
    jobs.waits(30s);
    EXPECT_TRUE(jobs.driver.finished());
}

TEST(SilionJobs, ALateAnswerIsNotTakenForTheNextJobs) {
    Jobs jobs;
    jobs.run(1, outputs({{1, true, 20'000}}), 1s);
    jobs.says();
    jobs.waits(1s);
    EXPECT_EQ(jobs.last().result.status, Status::timed_out);
    jobs.run(2, outputs({{2, true, 0}}));
    EXPECT_EQ(jobs.says(), "") << "the reader may still be busy with the first";
    jobs.gets("FF0600001700000186A773696C696F6E");  // for the first
    EXPECT_EQ(jobs.ended().size(), 1u);
    EXPECT_EQ(jobs.says(),
              "EE00000417010102"
              "0100");
    jobs.gets("FF06000017000000000073696C696F6E");
    EXPECT_EQ(jobs.last().job, 2u);
    EXPECT_EQ(jobs.last().result.status, Status::done);
}

TEST(SilionJobs, WhatWasNeverSentIsCancelled) {
    Jobs jobs;
    jobs.run(1, GetInputs{});
    jobs.run(2, GetInputs{}, 2s);
    jobs.run(3, GetInputs{});
    jobs.waits(2s);
    EXPECT_EQ(jobs.last().job, 2u);
    EXPECT_EQ(jobs.last().result.status, Status::cancelled);
    jobs.driver.cancel(3, jobs.now);
    jobs.collect();
    EXPECT_EQ(jobs.last().job, 3u);
    EXPECT_EQ(jobs.last().result.status, Status::cancelled);
    jobs.driver.cancel(1, jobs.now);
    jobs.collect();
    EXPECT_EQ(jobs.last().job, 1u);
    EXPECT_EQ(jobs.last().result.status, Status::unknown);
    EXPECT_EQ(jobs.says(), "EE0000001601");
    jobs.driver.cancel(99, jobs.now);
    EXPECT_EQ(jobs.ended().size(), 3u);
}

TEST(SilionJobs, ALostLinkEndsThemAll) {
    Jobs jobs;
    jobs.run(1, RestartReader{});
    jobs.run(2, RestartReader{});
    jobs.driver.link_lost(jobs.now);
    jobs.collect();
    auto ended = jobs.ended();
    ASSERT_EQ(ended.size(), 2u);
    EXPECT_EQ(ended[0].result.status, Status::unknown);
    EXPECT_EQ(ended[1].result.status, Status::cancelled);
    jobs.run(3, RestartReader{});
    EXPECT_EQ(jobs.last().result.status, Status::cancelled);
}

TEST(SilionJobs, AJobWaitsUntilTheReaderIsAdmitted) {
    Ours ours;
    ours.driver.run({.id = 1, .deadline = ours.now.steady + 60s}, GetInputs{}, ours.now);
    EXPECT_EQ(ours.says(), "");
    ours.gets(heartbeat_0);
    EXPECT_EQ(ours.says(), "EE0000001601");
}

TEST(SilionJobs, AnswersThatNobodyWaitsForAreIgnored) {
    Jobs jobs;
    jobs.gets("FF06000018000000000073696C696F6E");
    EXPECT_TRUE(jobs.ended().empty());
    EXPECT_FALSE(jobs.driver.finished());
}

}  // namespace gantry::silion::test
