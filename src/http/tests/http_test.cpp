// Requests and their answers, the bad and the slow among them.
#include "base/log.hpp"
#include "http_fixture.hpp"

namespace gantry::http {
namespace {

TEST_F(Http, ARequestGetsItsAnswer) {
    serve_echo();
    auto answer = request(path, "POST", "/api/v1/readers/dock%201?since=1h&tag=a+b%26c&flag", "{\"x\":1}");
    ASSERT_TRUE(answer) << answer.error().text();
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->content_type, "text/plain");
    EXPECT_EQ(answer->body, "POST /api/v1/readers/dock 1 since=1h tag=a b&c flag= {\"x\":1}");
}

TEST_F(Http, StatusAndHeadersAreTheHandlersOwn) {
    serve([](const Request& request) {
        auto response = refusal(404, {"there is no such reader", "see `gantry reader list`"});
        response.headers.emplace_back("X-Seen", std::string(request.header("HOST").value_or("none")));
        return response;
    });
    auto answer = get("/x");
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 404);
    EXPECT_EQ(
        answer->body,
        "{\"status\":404,\"title\":\"there is no such reader\",\"detail\":\"see `gantry reader list`\"}\n");
    bool seen = false;
    for (auto& [name, value] : answer->headers)
        seen = seen || (name == "X-Seen" && value == "gantry");
    EXPECT_TRUE(seen);
}

TEST_F(Http, AHandlerThatThrowsIsAnErrorOfTheGateway) {
    log::Capture capture;
    serve([](const Request&) -> Response { throw std::runtime_error("deep inside"); });
    auto answer = get("/x");
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->status, 500);
    EXPECT_NE(answer->body.find("deep inside"), std::string::npos);
    EXPECT_NE(capture.take().find("GET /x: deep inside"), std::string::npos);
}

TEST_F(Http, BigBodiesGoBothWays) {
    serve([](const Request& request) {
        Response response;
        response.body = request.body + request.body;
        return response;
    });
    std::string body(1024 * 1024, 'b');
    auto answer = request(path, "PUT", "/", body);
    ASSERT_TRUE(answer) << answer.error().text();
    EXPECT_EQ(answer->body.size(), 2 * body.size());
}

TEST_F(Http, AConnectionServesManyRequestsAlsoWhenTheyComeAtOnce) {
    serve_echo();
    auto peer = Peer::to(path);
    peer.send("GET /1 HTTP/1.1\r\nHost: x\r\n\r\nGET /2 HTTP/1.1\r\nHost: x\r\n\r\n");
    EXPECT_NE(peer.until("GET /1").find("200 OK"), std::string::npos);
    EXPECT_NE(peer.until("GET /2").find("200 OK"), std::string::npos);
    peer.send("GET /3 HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
    EXPECT_NE(peer.rest().find("GET /3"), std::string::npos);
}

TEST_F(Http, AHeadRequestGetsNoBody) {
    serve_echo();
    auto answer = request(path, "HEAD", "/abc");
    ASSERT_TRUE(answer) << answer.error().text();
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->body, "");
    auto peer = Peer::to(path);
    peer.send("HEAD /abc HTTP/1.1\r\nConnection: close\r\n\r\n");
    auto text = peer.rest();
    EXPECT_NE(text.find("Content-Length: 9"), std::string::npos) << text;
    EXPECT_TRUE(text.ends_with("\r\n\r\n")) << text;
}

struct BadCase {
    std::string request;
    std::string_view status;
};

TEST_F(Http, BadRequestsAreRefusedAndTheConnectionCloses) {
    serve_echo();
    std::vector<BadCase> cases = {
        {"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03 hello\r\n\r\n", "400"},
        {"SSH-2.0-OpenSSH_9.2\r\n\r\n", "400"},
        {"GET nothing HTTP/1.1\r\n\r\n", "400"},
        {"GET /a%zz HTTP/1.1\r\n\r\n", "400"},
        {"GET /a%00b HTTP/1.1\r\n\r\n", "400"},
        {"GET /a?b=%f HTTP/1.1\r\n\r\n", "400"},
        {"GET / HTTP/9.9\r\n\r\n", "400"},
        {"POST / HTTP/1.1\r\nContent-Length: ten\r\n\r\n", "400"},
        {"POST / HTTP/1.1\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\nabcdef", "400"},
        {"POST / HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", "400"},
        {"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\nabc\r\n", "400"},
        {"GET / HTTP/1.1\r\nX: " + std::string(17 * 1024, 'x') + "\r\n\r\n", "431"},
        {"GET /" + std::string(20 * 1024, 'x'), "431"},
        {"POST / HTTP/1.1\r\nContent-Length: 1048577\r\n\r\n", "413"},
        {"POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n" + std::string(300'000, 'b'), "413"},
        {"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n7fffffff\r\n" + std::string(1100'000, 'b'),
         "413"},
    };
    for (auto& [text, status] : cases) {
        auto peer = Peer::to(path);
        peer.send(text);
        auto answer = peer.rest();
        EXPECT_TRUE(answer.starts_with("HTTP/1.1 " + std::string(status))) << text.substr(0, 60) << "\n"
                                                                           << answer;
        EXPECT_NE(answer.find("Connection: close"), std::string::npos) << answer;
        EXPECT_NE(answer.find("{\"status\":"), std::string::npos) << answer;
    }
    auto after = get("/after");
    ASSERT_TRUE(after);
    EXPECT_EQ(after->body, "GET /after");
}

TEST_F(Http, AClientThatDribblesIsClosedInTime) {
    limits.wait = 100ms;
    serve_echo();
    auto idle = Peer::to(path), dribble = Peer::to(path), body = Peer::to(path), kept = Peer::to(path);
    dribble.send("GET / HT");
    body.send("POST / HTTP/1.1\r\nContent-Length: 10\r\n\r\nabc");
    kept.send("GET / HTTP/1.1\r\n\r\n");
    kept.until("GET /");
    std::atomic<bool> over = false;
    std::thread dribbling([&] {  // each byte alone does not buy more time
        while (!over && dribble.send("x"))
            std::this_thread::sleep_for(5ms);
    });
    EXPECT_EQ(idle.rest(), "");
    EXPECT_EQ(dribble.rest(), "");
    EXPECT_EQ(body.rest(), "");
    EXPECT_EQ(kept.rest(), "");
    over = true;
    dribbling.join();
    EXPECT_TRUE(eventually([&] { return server->connections() == 0; }));
}

TEST_F(Http, AClientThatDoesNotReadIsClosedInTime) {
    limits.wait = 2s;
    std::atomic<bool> asked = false;
    serve([&](const Request&) {
        asked = true;
        Response response;
        response.body.assign(20'000'000, 'o');
        return response;
    });
    auto peer = Peer::to(path);
    peer.send("GET / HTTP/1.1\r\n\r\n");
    EXPECT_TRUE(eventually([&] { return asked.load(); }));
    EXPECT_TRUE(eventually([&] { return server->connections() == 0; }));
    server.reset();  // before what its handler refers to
}

TEST_F(Http, ASlowHandlerDoesNotHoldUpTheOthers) {
    Gate gate;
    std::atomic<int> inside = 0;
    serve([&](const Request& request) {
        if (request.path == "/slow") {
            ++inside;
            EXPECT_TRUE(gate.pass());
        }
        Response response;
        response.body = request.path;
        return response;
    });
    std::thread slow([&] {
        auto answer = get("/slow");
        EXPECT_TRUE(answer && answer->body == "/slow");
    });
    EXPECT_TRUE(eventually([&] { return inside == 1; }));
    for (int i = 0; i < 20; ++i) {
        auto answer = get("/quick");
        ASSERT_TRUE(answer) << answer.error().text();
        EXPECT_EQ(answer->body, "/quick");
    }
    gate.open();
    slow.join();
    server.reset();  // before what its handler refers to
}

TEST_F(Http, ManyClientsAreServedAtOnce) {
    serve_echo();
    std::vector<std::thread> clients;
    std::atomic<int> good = 0;
    for (int c = 0; c < 8; ++c)
        clients.emplace_back([&, c] {
            for (int i = 0; i < 25; ++i) {
                auto target = "/" + std::to_string(c) + "/" + std::to_string(i);
                auto answer = get(target);
                if (answer && answer->body == "GET " + target) ++good;
            }
        });
    for (auto& client : clients)
        client.join();
    EXPECT_EQ(good, 200);
}

TEST_F(Http, OneConnectionTooManyIsTold) {
    limits.connections = 3;
    serve_echo();
    {
        std::vector<Peer> peers;
        for (int i = 0; i < 3; ++i)
            peers.push_back(Peer::to(path));
        ASSERT_TRUE(eventually([&] { return server->connections() == 3; }));
        auto answer = get("/");
        ASSERT_TRUE(answer) << answer.error().text();
        EXPECT_EQ(answer->status, 503);
        EXPECT_NE(answer->body.find("3 connections are open already"), std::string::npos);
    }
    ASSERT_TRUE(eventually([&] { return server->connections() == 0; }));
    EXPECT_EQ(get("/")->status, 200);
}

TEST_F(Http, AGatewayThatDoesNotAnswerIsGivenUp) {
    Gate gate;
    serve([&](const Request&) {
        EXPECT_TRUE(gate.pass());
        return Response{};
    });
    auto answer = get("/", 50ms);
    ASSERT_FALSE(answer);
    EXPECT_EQ(answer.error().what, "the gateway in " + folder.string() + " did not answer within 50ms");
    gate.open();
    server.reset();  // before what its handler refers to
}

}  // namespace
}  // namespace gantry::http
