// The verbs for jobs as programs use them, with a reader behind them.
#include <gtest/gtest.h>
#include <atomic>
#include <boost/json.hpp>
#include <thread>

#include "api/handlers.hpp"
#include "gateway/config_makes.hpp"
#include "gateway/tests/toy_dial.hpp"
#include "journal/sqlite.hpp"
#include "testkit/eventually.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::api {
namespace {

namespace json = boost::json;

struct Answer {
    int status = 0;
    json::object body;
};

class JobsHttp : public testing::Test {
protected:
    void SetUp() override {
        auto config = gateway::parse_config(
            fmt::format("[gateway]\ndata_dir = \"{}\"\n[[reader]]\nname = \"d 1\"\naddress = "
                        "\"ding://127.0.0.1:{}\"\n",
                        dir_.path(), reader_.port()),
            "test.toml", gateway::test::ding_makes);
        ASSERT_TRUE(config) << config.error().text();
        auto started = gateway::Gateway::start(*config);
        ASSERT_TRUE(started) << started.error().text();
        gateway_ = std::move(*started);
    }
    Answer ask(std::string_view method, std::string_view target, std::string_view body = "") {
        auto parsed = http::parse_target(target);
        EXPECT_TRUE(parsed);
        http::Request request;
        request.method = method;
        request.path = parsed->path;
        request.query = parsed->query;
        request.body = body;
        auto response = handle(*gateway_, waiters_, request);
        return {response.status, json::parse(response.body).as_object()};
    }
    std::string status_of(std::int64_t id) {
        return std::string(ask("GET", fmt::format("/api/v1/jobs/{}", id)).body.at("status").as_string());
    }
    // The reader's side of one job.
    static std::int64_t take_job(testkit::Peer& peer, std::string_view op) {
        auto line = peer.until("\n");
        EXPECT_NE(line.find(fmt::format(" {} again=0", op)), std::string::npos) << line;
        return line.starts_with("job ") ? std::stoll(line.substr(4)) : 0;
    }

    testkit::TempDir dir_;
    gateway::test::DingReader reader_;
    std::unique_ptr<gateway::Gateway> gateway_;
    Waiters waiters_;
};

TEST_F(JobsHttp, PostWaitsForTheEnd) {
    auto peer = reader_.accept();
    std::thread side([&] {
        auto id = take_job(peer, "tag.read");
        EXPECT_TRUE(peer.send(fmt::format("done {}\n", id)));
    });
    auto answer = ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"tag.read","tag":"E2"})");
    side.join();
    EXPECT_EQ(answer.status, 200);
    EXPECT_EQ(answer.body.at("status").as_string(), "done");
    EXPECT_EQ(answer.body.at("values").at("answer").as_int64(), 42);
    EXPECT_EQ(answer.body.at("reader").as_string(), "d 1");
    EXPECT_EQ(answer.body.at("detail").as_string(), "tag E2, user 0 to 0");
}

TEST_F(JobsHttp, PostThatDoesNotWaitGivesTheIdToAskWith) {
    auto peer = reader_.accept();
    auto answer = ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get","wait":false})");
    EXPECT_EQ(answer.status, 202);
    auto id = take_job(peer, "gpio.get");
    EXPECT_EQ(answer.body.at("id").to_number<std::int64_t>(), id);
    EXPECT_EQ(status_of(id), "running");
    EXPECT_TRUE(peer.send(fmt::format("failed {}\n", id)));
    EXPECT_TRUE(testkit::eventually([&] { return status_of(id) == "failed"; }));
    auto list = ask("GET", "/api/v1/jobs?reader=d%201&limit=10");
    EXPECT_EQ(list.status, 200);
    ASSERT_EQ(list.body.at("jobs").as_array().size(), 1u);
    EXPECT_EQ(ask("GET", "/api/v1/jobs?reader=other").body.at("jobs").as_array().size(), 0u);
}

TEST_F(JobsHttp, AJobIsCancelledByPost) {
    auto peer = reader_.accept();
    ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get","wait":false})");
    auto id = take_job(peer, "gpio.get");
    EXPECT_EQ(ask("GET", fmt::format("/api/v1/jobs/{}/cancel", id)).status, 405);
    EXPECT_EQ(ask("POST", fmt::format("/api/v1/jobs/{}/cancel", id)).status, 200);
    EXPECT_EQ(peer.until("\n"), fmt::format("cancel {}\n", id));
    EXPECT_TRUE(testkit::eventually([&] { return status_of(id) == "cancelled"; }));
    EXPECT_EQ(ask("POST", fmt::format("/api/v1/jobs/{}/cancel", id)).body.at("status").as_string(),
              "cancelled");
}

TEST_F(JobsHttp, WhoeverWaitsForManyJobsKeepsNobodyElseOut) {
    auto peer = reader_.accept();
    std::atomic<unsigned> ended{0};
    std::vector<std::thread> waiting;
    for (unsigned i = 0; i < Waiters::most; ++i)
        waiting.emplace_back([&] {
            auto answer =
                ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get","timeout_ms":60000})");
            if (answer.status == 200) ++ended;
        });
    std::vector<std::int64_t> ids;
    for (unsigned i = 0; i < Waiters::most; ++i)
        ids.push_back(take_job(peer, "gpio.get"));
    auto refused = ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get"})");
    EXPECT_EQ(refused.status, 503);
    EXPECT_NE(refused.body.at("detail").as_string().find("\"wait\":false"), json::string::npos);
    auto taken = ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get","wait":false})");
    EXPECT_EQ(taken.status, 202);
    EXPECT_EQ(ask("GET", "/api/v1/readers").status, 200);
    for (auto id : ids)
        EXPECT_EQ(ask("POST", fmt::format("/api/v1/jobs/{}/cancel", id)).status, 200);
    for (auto& thread : waiting)
        thread.join();
    EXPECT_EQ(ended, Waiters::most);
    // The places are free again.
    std::thread side([&] {
        for (std::string line = peer.until("\n"); !line.empty(); line = peer.until("\n"))
            if (line.find(" restart ") != std::string::npos) break;
        auto list = ask("GET", "/api/v1/jobs?limit=1").body.at("jobs").as_array();
        EXPECT_TRUE(peer.send(fmt::format("done {}\n", list.at(0).at("id").to_number<std::int64_t>())));
    });
    EXPECT_EQ(ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"restart"})").status, 200);
    side.join();
}

TEST_F(JobsHttp, AJobThatNobodyWaitsForIsTakenSoonThoughTheStoreIsStuck) {
    auto peer = reader_.accept();
    auto db = journal::Database::open(dir_.path() + "/gantry.db", journal::Database::Access::write);
    ASSERT_TRUE(db);
    // The gateway may be in the middle of a commit.
    ASSERT_TRUE(testkit::eventually([&] { return db->run("BEGIN IMMEDIATE").has_value(); }));
    auto taken =
        ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get","wait":false,"timeout_ms":60000})");
    EXPECT_EQ(taken.status, 202);
    // The store is still stuck: whoever waited for it would hear of the end at the deadline instead.
    EXPECT_EQ(taken.body.at("status").as_string(), "running");
    ASSERT_TRUE(db->run("ROLLBACK"));
    EXPECT_EQ(take_job(peer, "gpio.get"), taken.body.at("id").to_number<std::int64_t>());
}

TEST_F(JobsHttp, ValuesAreShownToWhoAsksForTheirJobAlone) {
    auto peer = reader_.accept();
    auto run = [&](std::string_view request) {
        std::thread side([&] {
            auto id = take_job(peer, "tag.read");
            EXPECT_TRUE(peer.send(fmt::format("done {}\n", id)));
        });
        auto answer = ask("POST", "/api/v1/jobs", request);
        side.join();
        return answer.body;
    };
    auto plain = run(R"({"reader":"d 1","op":"tag.read","tag":"E2"})");
    EXPECT_TRUE(plain.contains("values"));
    auto of = [&](const json::object& job) {
        return ask("GET", fmt::format("/api/v1/jobs/{}", job.at("id").to_number<std::int64_t>())).body;
    };
    EXPECT_TRUE(of(plain).contains("values"));
    auto secret = run(R"({"reader":"d 1","op":"tag.read","tag":"E2","bank":"reserved"})");
    EXPECT_EQ(secret.at("values").at("answer").as_int64(), 42);
    EXPECT_FALSE(of(secret).contains("values")) << "told once";
    auto list = ask("GET", "/api/v1/jobs").body;
    for (auto& job : list.at("jobs").as_array())
        EXPECT_FALSE(job.as_object().contains("values")) << json::serialize(job);
}

TEST_F(JobsHttp, WhatIsWrongHasItsStatus) {
    EXPECT_EQ(ask("POST", "/api/v1/jobs", "[1]").status, 400);
    EXPECT_EQ(ask("POST", "/api/v1/jobs", R"({"op":"gpio.get"})").status, 400);
    EXPECT_EQ(ask("POST", "/api/v1/jobs", R"({"reader":"nobody","op":"gpio.get"})").status, 404);
    EXPECT_EQ(ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"fly"})").status, 400);
    EXPECT_EQ(ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get","timeout_ms":0})").status, 400);
    EXPECT_EQ(ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"gpio.get","wait":1})").status, 400);
    EXPECT_EQ(ask("PUT", "/api/v1/jobs").status, 405);
    EXPECT_EQ(ask("GET", "/api/v1/jobs?limit=0").status, 400);
    EXPECT_EQ(ask("GET", "/api/v1/jobs/77").status, 404);
    EXPECT_EQ(ask("GET", "/api/v1/jobs/7x").status, 404);
    EXPECT_EQ(ask("GET", "/api/v1/jobs/").status, 404);
    EXPECT_EQ(ask("POST", "/api/v1/jobs/77/cancel").status, 404);
    auto refused =
        ask("POST", "/api/v1/jobs", R"({"reader":"d 1","op":"tag.kill","tag":"E2","kill_password":"1"})");
    EXPECT_EQ(refused.status, 400);
    EXPECT_EQ(refused.body.at("detail").as_string(), "add \"confirm\":true");
}

TEST_F(JobsHttp, AReaderSaysWhatItCanBeAsked) {
    auto reader = ask("GET", "/api/v1/readers/d%201");
    EXPECT_EQ(reader.status, 200);
    EXPECT_EQ(json::serialize(reader.body.at("parameters")), R"(["Power","Serial","Mode"])");
    EXPECT_EQ(json::serialize(reader.body.at("commands")), R"(["Ping","SetPower","Kill"])");
}

}  // namespace
}  // namespace gantry::api
