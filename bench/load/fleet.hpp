#pragma once
#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "base/bytes.hpp"

namespace gantry::bench {

using Clock = std::chrono::steady_clock;

// Virtual Silion readers in acknowledge mode, as lean as they can be: one thread, one epoll, ready-made
// frames, at most one frame under way a reader. Reader i is called r-<i+1>. Its tags stand still: it has
// `turns` frames of tags of its own and sends them in turn; the signal strength counts the rounds, so that
// every stored read can be told from the one before and after it.
class Fleet {
public:
    struct Shape {
        std::uint32_t readers = 1000;
        std::uint16_t records = 20;  // a frame
        std::uint32_t turns = 1;
        bool new_tags = false;  // every read is a tag never seen before
    };
    Fleet(const Shape& shape, std::uint16_t port);  // connects; throws Failure
    ~Fleet();
    Fleet(const Fleet&) = delete;
    Fleet& operator=(const Fleet&) = delete;

    struct Phase {
        double seconds = 0;
        std::uint64_t reads = 0;         // acknowledged within
        std::vector<double> latency_ms;  // of each acknowledged frame
        std::uint64_t late = 0;          // frames that waited for the one before them
    };
    // For so long, so many reads a second (each reader at even distances) or, with 0, as fast as
    // acknowledgements come. Latency counts from when a frame was due to when its acknowledgement was there.
    // Ends when all are acknowledged.
    Phase run(std::chrono::milliseconds time, double reads_per_second);

    const Shape& shape() const { return shape_; }
    std::uint64_t frames_sent(std::uint32_t reader) const { return readers_[reader].sent; }
    std::uint64_t frames_acknowledged(std::uint32_t reader) const { return readers_[reader].acknowledged; }
    // What frame number `frame` of a reader carries.
    std::uint32_t first_tag(std::uint32_t reader, std::uint64_t frame) const;
    std::int8_t rssi(std::uint64_t frame) const;
    static std::string name(std::uint32_t reader);

private:
    struct Reader {
        int fd = -1;
        std::string name;
        std::vector<Bytes> frames;  // by turn
        std::uint64_t sent = 0, acknowledged = 0;
        std::uint64_t due = 0;       // frames of this phase that are due
        std::uint64_t begun = 0;     // frames of this phase that were sent
        Clock::time_point due_at{};  // when the frame under way was due
        std::uint8_t partial = 0;    // bytes of an acknowledgement that have come
    };

    void connect(Reader& reader, std::uint16_t port);
    void send(Reader& reader, std::uint32_t index, Clock::time_point due_at);
    void send_all(int fd, ByteView bytes);
    void receive(Reader& reader, std::uint32_t index);
    void acknowledged(Reader& reader, std::uint32_t index);
    void wait(Clock::time_point until);
    Clock::time_point due_time(std::uint32_t index, std::uint64_t frame) const;

    Shape shape_;
    Bytes acknowledgement_;
    std::vector<Reader> readers_;
    int epoll_ = -1;
    // Of the phase under way.
    Phase phase_;
    Clock::time_point start_{}, end_{};
    std::chrono::duration<double> interval_{};  // between two frames of the fleet; 0: closed loop
    std::uint64_t under_way_ = 0;
};

// A connected socket; throws Failure.
int connect_loopback(std::uint16_t port);

}  // namespace gantry::bench
