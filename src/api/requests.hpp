#pragma once
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "api/handlers.hpp"

namespace gantry::api {

// Requests that come in over a sink (MQTT), served by the same handlers as those over HTTP.
// Operations: "status", "readers", "reader", "jobs", "sinks" read; every other is the `op` of a job, with the
// body that POST /api/v1/jobs takes. The answer is {"status":"ok","data":{…}} or
// {"status":"error","error":"…"}.
class Requests {
public:
    explicit Requests(gateway::Gateway& gateway);
    ~Requests();  // what is under way is finished, what waits is refused

    void take(std::string_view operation, std::string body, std::function<void(std::string)> answer);

private:
    struct Waiting {
        std::string operation, body;
        std::function<void(std::string)> answer;
    };
    void run();

    static constexpr std::size_t most_waiting = 256;
    static constexpr unsigned threads = 4;
    gateway::Gateway& gateway_;
    Waiters waiters_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::deque<Waiting> waiting_;
    bool stopping_ = false;
    std::vector<std::thread> workers_;
};

// One of them, for the tests.
std::string serve_request(gateway::Gateway& gateway, Waiters& waiters, std::string_view operation,
                          const std::string& body);

}  // namespace gantry::api
