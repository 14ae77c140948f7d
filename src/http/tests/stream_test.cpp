// Answers that come piece by piece.
#include "base/log.hpp"
#include "http_fixture.hpp"

namespace gantry::http {
namespace {

TEST_F(Http, AStreamArrivesPieceByPiece) {
    Gate gate;
    serve([&](const Request&) {
        Response response;
        response.content_type = "application/x-ndjson";
        response.stream = [&, i = 0](std::string& chunk) mutable {
            EXPECT_TRUE(i != 1 || gate.pass());  // the first must arrive before the second is made
            chunk = "line " + std::to_string(i) + "\n";
            return ++i < 3;
        };
        return response;
    });
    std::string got;
    auto answer = request(path, "GET", "/", {}, 10s, [&](std::string_view piece) {
        got += piece;
        if (got == "line 0\n") gate.open();
        return true;
    });
    ASSERT_TRUE(answer) << answer.error().text();
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->content_type, "application/x-ndjson");
    EXPECT_EQ(answer->body, "");
    EXPECT_EQ(got, "line 0\nline 1\nline 2\n");
    server.reset();  // before what its handler refers to
}

TEST_F(Http, AStreamIsWholeWithoutACallbackAndForAnOldClient) {
    serve([&](const Request&) {
        Response response;
        response.stream = [i = 0](std::string& chunk) mutable {
            chunk.assign(10'000, static_cast<char>('a' + i));
            return ++i < 20;
        };
        return response;
    });
    auto answer = get("/");
    ASSERT_TRUE(answer) << answer.error().text();
    EXPECT_EQ(answer->body.size(), 200'000u);
    auto old = Peer::to(path);
    old.send("GET / HTTP/1.0\r\n\r\n");
    auto text = old.rest();
    EXPECT_EQ(text.find("chunked"), std::string::npos);
    EXPECT_EQ(text.substr(text.find("\r\n\r\n") + 4), answer->body);
    server.reset();  // before what its handler refers to
}

TEST_F(Http, AQuietStreamIsAskedAgainAndHoldsNoWorker) {
    limits.poll = 2ms;
    limits.wait = 2s;  // nor does its quiet count as a client that is too slow
    auto begin = std::chrono::steady_clock::now();
    std::atomic<int> asked = 0;
    std::atomic<bool> more = true;
    serve([&](const Request& request) {
        Response response;
        response.body = "quick";
        if (request.path == "/tail") {
            response.body.clear();
            response.stream = [&](std::string& chunk) {
                ++asked;
                if (!more) chunk = "end";
                return more.load();
            };
        }
        return response;
    });
    std::vector<std::thread> tails;
    for (int i = 0; i < 5; ++i)
        tails.emplace_back([&] {
            std::string got;
            auto answer = request(path, "GET", "/tail", {}, 10s, [&](std::string_view piece) {
                got += piece;
                return true;
            });
            EXPECT_TRUE(answer) << answer.error().text();
            EXPECT_EQ(got, "end");
        });
    EXPECT_TRUE(eventually(
        [&] { return asked > 200 && std::chrono::steady_clock::now() - begin > limits.wait + 1s; }));
    EXPECT_EQ(get("/quick")->body, "quick");
    more = false;
    for (auto& tail : tails)
        tail.join();
    server.reset();  // before what its handler refers to
}

TEST_F(Http, AStreamEndsWhenItsClientGoesAway) {
    limits.poll = 1ms;
    struct Alive {
        std::atomic<int>& count;
        explicit Alive(std::atomic<int>& all) : count(all) { ++count; }
        ~Alive() { --count; }
        Alive(const Alive&) = delete;
        Alive& operator=(const Alive&) = delete;
    };
    std::atomic<int> alive = 0;
    serve([&](const Request& request) {
        Response response;
        bool loud = request.path == "/loud";
        response.stream = [loud, life = std::make_shared<Alive>(alive)](std::string& chunk) {
            if (loud) chunk.assign(100'000, 'x');
            return true;
        };
        return response;
    });
    // By its own wish, while quiet, while it does not read.
    auto answer = request(path, "GET", "/loud", {}, 10s, [](std::string_view) { return false; });
    EXPECT_TRUE(answer) << answer.error().text();
    {
        auto quiet = Peer::to(path), loud = Peer::to(path);
        quiet.send("GET /quiet HTTP/1.1\r\n\r\n");
        quiet.until("\r\n\r\n");
        loud.send("GET /loud HTTP/1.1\r\n\r\n");
        loud.until("xxx");
        EXPECT_GE(alive, 2);
    }
    EXPECT_TRUE(eventually([&] { return alive == 0; }));
    EXPECT_TRUE(eventually([&] { return server->connections() == 0; }));
    server.reset();  // before what its handler refers to
}

TEST_F(Http, AStreamThatThrowsIsCutNotEnded) {
    log::Capture capture;
    serve([](const Request&) {
        Response response;
        response.stream = [first = true](std::string& chunk) mutable {
            if (!first) throw std::runtime_error("the disk went away");
            first = false;
            chunk = "part";
            return true;
        };
        return response;
    });
    auto answer = get("/");
    ASSERT_FALSE(answer);
    EXPECT_NE(answer.error().what.find("closed the connection before its answer was whole"),
              std::string::npos);
    EXPECT_NE(capture.take().find("the disk went away"), std::string::npos);
}

TEST_F(Http, ClosingTheServerEndsStreamsAndWaitsForHandlers) {
    Gate gate;
    std::atomic<int> inside = 0, left = 0;
    serve([&](const Request& request) {
        Response response;
        if (request.path == "/tail") {
            response.stream = [](std::string&) { return true; };
            return response;
        }
        ++inside;
        EXPECT_TRUE(gate.pass());
        ++left;
        return response;
    });
    auto tail = Peer::to(path), slow = Peer::to(path), idle = Peer::to(path);
    tail.send("GET /tail HTTP/1.1\r\n\r\n");
    tail.until("\r\n\r\n");
    slow.send("GET /slow HTTP/1.1\r\n\r\n");
    ASSERT_TRUE(eventually([&] { return inside == 1; }));
    std::thread closing([&] { server.reset(); });
    EXPECT_EQ(idle.rest(), "");
    EXPECT_EQ(tail.rest(), "");
    EXPECT_EQ(left, 0);
    gate.open();
    closing.join();
    EXPECT_EQ(left, 1);
    EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace
}  // namespace gantry::http
