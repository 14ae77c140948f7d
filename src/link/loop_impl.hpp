#pragma once
#include <array>
#include <mutex>
#include <unordered_set>
#include <vector>

#include "link/link.hpp"

namespace boost::asio {
class io_context;
}

namespace gantry::link {

// What lives on a loop and holds something of Asio's. It may outlive the loop: when the loop ends it is told
// to let go, and is inert from then on.
class Part {
public:
    explicit Part(Loop::Impl& loop);
    virtual ~Part();
    Part(const Part&) = delete;
    Part& operator=(const Part&) = delete;
    virtual void drop() = 0;  // the loop's thread has ended; nothing may call back any more

protected:
    boost::asio::io_context& io() const;
    Loop::Impl* loop_;  // null: the loop has ended

private:
    friend struct Loop::Impl;
};

struct Loop::Impl {
    explicit Impl(std::string name);
    ~Impl();
    void post(std::function<void()> work);
    void stop();
    void run_posted();
    Part* take_part();  // off the list; null: none left

    std::unique_ptr<boost::asio::io_context> io;
    std::array<std::uint8_t, 64 * 1024> buffer;  // one for all links: none keeps input of its own

    std::mutex mutex;  // of what follows
    std::vector<std::function<void()>> posted;
    std::unordered_set<Part*> parts;
    bool stopped = false;

    std::mutex stopping;  // two threads may both call stop()
    std::thread thread;
};

}  // namespace gantry::link
