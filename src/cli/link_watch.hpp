#pragma once
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "base/time.hpp"
#include "link/device_host.hpp"

namespace gantry::cli {

// Says in the log when virtual readers cannot reach their gateway or are turned away: once, then rarely,
// however many readers there are. Any thread.
class LinkWatch {
public:
    LinkWatch(std::string place, std::size_t readers) : place_(std::move(place)), readers_(readers) {}

    void told(std::size_t reader, const std::string& name, const link::LinkNews& news, Steady now);
    // How many readers no gateway ever took. To be turned away at once is not to be taken.
    std::size_t never_taken(Steady now) const;
    std::string last_reason() const;
    const std::string& place() const { return place_; }
    std::size_t readers() const { return readers_.size(); }

private:
    struct Reader {
        bool taken = false, turned_away = false;
        std::optional<Steady> up_since;
    };
    struct Complaint {
        std::uint64_t count = 0;
        Steady next{};
    };
    bool due(Complaint& complaint, Steady now);

    mutable std::mutex mutex_;
    std::string place_, last_reason_;
    std::vector<Reader> readers_;
    Complaint not_reached_, turned_away_;
};

}  // namespace gantry::cli
