#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>

namespace gantry::testkit {

// What becomes of the bytes of one direction. By default they pass as they come. Places count the bytes of a
// connection from its start.
struct Faults {
    using Time = std::chrono::microseconds;
    enum class Ending : std::uint8_t {
        close,      // both ends see an orderly close
        reset,      // both ends see a reset; what they had not read yet is gone
        half_open,  // neither end sees anything: all that they say from then on is swallowed
    };

    Time delay{};             // every byte arrives this much later; the order holds
    std::size_t segment = 0;  // so many bytes a send; 0: as they come
    Time gap{};               // from one send to the next: with `segment`, a slow line
    // Bytes are held until so many are there, and then leave in one send. What came earlier leaves when
    // `gather_for` has passed since its first byte (zero: never), or with the end of the stream.
    std::size_t gather = 0;
    Time gather_for{};
    std::optional<std::uint64_t> stall_after = {};  // once so many have passed nothing does for `stall_for`
    Time stall_for{};
    std::optional<std::uint64_t> cut_after = {};  // so many pass, then `ending`
    Ending ending = Ending::close;
    std::optional<std::uint64_t> flip_at = {};  // the lowest bit of the byte at this place comes out wrong
    std::uint64_t flip_every = 0;               // one bit of every so manyth byte; 0: none
    bool stall = false;    // nothing is read: bytes pile up at the sender, as behind a congested line
    bool swallow = false;  // everything is read and nothing passes, the end of the stream included
};

// What a bad network does to TCP connections, in user space, because the kernel's own tool for it (netem) is
// not everywhere. It listens on a port of 127.0.0.1 and has a thread of its own. Any thread may call it; what
// a call sets holds from the moment it returns, for open connections, too.
class FaultProxy {
public:
    // `target` is a port of 127.0.0.1. Throws where no socket can be had.
    explicit FaultProxy(std::uint16_t target);
    ~FaultProxy();  // closes what is open

    std::uint16_t port() const;
    void set_target(std::uint16_t port);  // for the connections to come
    void set(const Faults& to_target, const Faults& to_client);
    void set(const Faults& both) { set(both, both); }
    void end_all(Faults::Ending how);  // all open connections, now; half-open ones as well
    void refuse(bool on);              // new connections find nobody listening

    // A client whose target cannot be reached sees a close.
    std::size_t open_connections() const;
    std::uint64_t accepted() const;
    struct Passed {
        std::uint64_t to_target = 0, to_client = 0;
    };
    Passed passed() const;  // bytes handed on, of all connections so far

private:
    class Loop;
    std::unique_ptr<Loop> loop_;
};

}  // namespace gantry::testkit
