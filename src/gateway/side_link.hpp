#pragma once
#include <functional>
#include <memory>
#include <string>

#include "link/link.hpp"
#include "reader/driver.hpp"

namespace gantry::gateway {

// The second link of a session, on which its reader dials in with notifications. One at a time; on the
// session's loop.
class SideLink {
public:
    SideLink(link::Loop& loop, Driver& driver) : loop_(loop), driver_(driver) {}

    // Takes the place of the one before. `after_turn` is the session's and keeps it alive; `ended` is called
    // once with the reason, when the driver has been told.
    void start(link::Socket socket, std::function<void()> after_turn,
               std::function<void(std::string_view reason)> ended);
    void wake();  // the driver was changed from outside
    void close(std::string_view reason);

private:
    void closed();

    link::Loop& loop_;
    Driver& driver_;
    std::shared_ptr<link::Link> link_;
};

}  // namespace gantry::gateway
