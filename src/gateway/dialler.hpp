#pragma once
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <string_view>

#include "gateway/config.hpp"
#include "link/link.hpp"

namespace gantry::gateway {

// Keeps up the link to one reader that the gateway opens itself: opens it, and when it fails or ends, waits
// and opens it again. Lives on its loop.
class Dialler {
public:
    using Opened = std::function<void(link::Socket)>;
    // `seed` spreads the waits of readers that lost their power together. `reader` must outlive this.
    Dialler(link::Loop& loop, const ReaderConfig& reader, std::uint64_t seed, Opened opened);
    ~Dialler();

    void start();
    // The link that was opened has ended, and why. `answered`: the reader did answer on it. `lasted`: so long
    // that it may be opened anew at once.
    void ended(bool answered, bool lasted, std::string_view reason);
    // For people, while the reader is not connected: "cannot connect: connection refused; next try in 4 s".
    std::string state(Steady now) const;

private:
    void open();
    void open_serial();
    void taken(Result<link::Socket> socket);
    void wait();
    bool is_new_trouble();

    link::Loop& loop_;
    const ReaderConfig& reader_;
    Opened opened_;
    link::Backoff backoff_;
    link::Timer timer_;
    std::unique_ptr<link::Dial> dial_;
    bool connected_ = false;
    std::optional<Steady> next_try_;  // while it waits
    std::string trouble_;             // why the last try failed or the last link ended
    std::set<std::string> said_;      // of it, in the log, since the reader last answered
};

}  // namespace gantry::gateway
