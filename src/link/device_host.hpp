#pragma once
#include <atomic>
#include <memory>
#include <optional>

#include "link/link.hpp"
#include "reader/device.hpp"

namespace gantry::link {

// What became of the link of a device that dials, told on the loop's thread.
struct LinkNews {
    enum class Kind : std::uint8_t { up, down, not_reached };
    Kind kind{};
    std::string_view reason = {};  // why it is down, or was not reached
    bool heard = false;            // down: the other side had sent something
    bool ours = false;             // down: the device ended it by itself
    std::chrono::milliseconds lasted{};
};

// Gives a virtual reader its link: dials for it whenever it wants, or listens for it, and lets its time pass
// with and without a link. One link at a time; a device that listens takes the newest. The channels that a
// device wants beside it (Device::dial_outs) are dialled for every kind of host.
class DeviceHost {
public:
    // Dials `endpoint` when the device asks for it. The device is owned. `air` of the device must outlive the
    // host, and so must what `news` uses.
    static std::unique_ptr<DeviceHost> dial(Loop& loop, std::unique_ptr<Device> device, Endpoint endpoint,
                                            std::function<void(const LinkNews&)> news = {});
    static Result<std::unique_ptr<DeviceHost>> listen(Loop& loop, std::unique_ptr<Device> device,
                                                      const Endpoint& endpoint);
    // The device's serial line is a pseudo-terminal, see Pty. The device gets its link when the first program
    // opens the line, and has it for good: a serial line does not tell who is at the other end, nor that he
    // has gone. A device that ends it gets a new one, in the same way.
    static Result<std::unique_ptr<DeviceHost>> pty(Loop& loop, std::unique_ptr<Device> device,
                                                   const std::string& link, std::uint32_t baud);
    virtual ~DeviceHost() = default;  // any thread; powers the device off at once

    virtual Endpoint local() const = 0;  // of the listener; meaningless for one that dials
    // Any thread: runs `work` with the device on the loop and waits; then the link is woken.
    virtual void with_device(const std::function<void(Device&, Now)>& work) = 0;
    virtual void
    cut() = 0;  // any thread: closes the link as if the cable was pulled; the device may dial again
    virtual bool connected() const = 0;  // on a serial line: a program has it open now
};

}  // namespace gantry::link
