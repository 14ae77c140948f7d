#pragma once
#include <atomic>
#include <optional>

#include "gateway/gateway.hpp"
#include "http/server.hpp"

namespace gantry::api {

// Requests that keep their worker until a job has ended. There are fewer places than workers, so that jobs
// for readers that are away never keep everybody else out.
class Waiters {
public:
    static constexpr unsigned workers = 16, most = 12;

    class Place {
    public:
        explicit Place(Waiters& waiters) : waiters_(waiters), taken_(waiters.waiting_.fetch_add(1) < most) {}
        ~Place() { waiters_.waiting_.fetch_sub(1); }
        Place(const Place&) = delete;
        Place& operator=(const Place&) = delete;
        bool taken() const { return taken_; }

    private:
        Waiters& waiters_;
        const bool taken_;
    };

private:
    std::atomic<unsigned> waiting_{0};
};

// One request to one answer; what every listener serves.
http::Response handle(gateway::Gateway& gateway, Waiters& waiters, const http::Request& request);

}  // namespace gantry::api
