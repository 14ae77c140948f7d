#pragma once
#include <functional>
#include <memory>
#include <vector>

#include "link/link.hpp"
#include "reader/device.hpp"

namespace gantry::link {

// Dials and pumps the channels that a virtual reader has beside its link. Lives on the loop.
class DialOuts {
public:
    // `turned` runs after every turn of a channel: it may have changed the device.
    DialOuts(Loop& loop, std::function<void()> turned);
    ~DialOuts();

    // After every turn of the device: takes up the channels that are new, ends those no longer wanted, sends
    // what the others have to say.
    void look(const std::vector<std::shared_ptr<DialOut>>& wanted);

private:
    class Channel;
    Loop& loop_;
    std::function<void()> turned_;
    std::vector<std::shared_ptr<Channel>> channels_;
};

}  // namespace gantry::link
