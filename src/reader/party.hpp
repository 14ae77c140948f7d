#pragma once
#include <optional>

#include "base/bytes.hpp"
#include "base/time.hpp"

namespace gantry {

// One end of a protocol dialog, without sockets, threads or clocks. Tell it what happened (bytes, time), then
// take what it wants (bytes to send, its next deadline, whether it wants more input). Never call it from two
// threads at once. One pump drives any party over TCP, a serial line, a pseudo-terminal or memory.
class Party {
public:
    virtual ~Party() = default;
    Party() = default;
    Party(const Party&) = delete;
    Party& operator=(const Party&) = delete;

    virtual void start(Now now) = 0;                     // the link is up
    virtual void received(ByteView bytes, Now now) = 0;  // in the order of the wire, in any pieces
    virtual void time_passed(Now now) = 0;               // harmless when nothing is due
    virtual std::optional<Steady> deadline() const = 0;  // call time_passed then
    virtual bool wants_input() const { return true; }    // false: leave the bytes in the socket
    virtual bool finished() const = 0;                   // send what is left, then close the link

    // Bytes to send; the pump reports how many went out.
    ByteView output() const { return ByteView(out_).subspan(sent_); }
    void output_sent(std::size_t size) {
        sent_ += size;
        if (sent_ == out_.size()) {
            out_.clear();
            sent_ = 0;
            if (out_.capacity() > keep_capacity) out_.shrink_to_fit();
        } else if (sent_ > keep_capacity && sent_ > out_.size() / 2) {
            // A peer that reads slowly but steadily: what is sent must not pile up behind it.
            out_.erase(out_.begin(), out_.begin() + static_cast<std::ptrdiff_t>(sent_));
            sent_ = 0;
        }
    }

protected:
    Bytes& out() { return out_; }  // append here
    void drop_output() {
        out_.clear();
        sent_ = 0;
    }

private:
    static constexpr std::size_t keep_capacity = 4096;
    Bytes out_;
    std::size_t sent_ = 0;
};

// One end of a link that exists beside the first one: a channel for notifications.
class SideParty : public Party {
public:
    virtual void link_lost(Now now) = 0;
};

}  // namespace gantry
