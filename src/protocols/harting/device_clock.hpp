#pragma once
#include <array>
#include <optional>

#include "base/bytes.hpp"
#include "base/time.hpp"

// The clock of a virtual reader: it runs from power-on until a host sets it ([0x85] to [0x88]).
namespace gantry::harting {

// Time of day and date as they travel: hour, minute, milliseconds (2); century, year, month, day, timezone.
inline constexpr std::size_t timer_size = 4, date_size = 5;

class ReaderClock {
public:
    void start(Now now, bool true_time);
    Wall time_at(Steady at) const;
    void jump(std::chrono::microseconds by) { base_time_ += by; }

    // False: no such time; nothing has changed.
    bool set_timer(ByteView timer, Steady now);
    bool set_date_and_timer(ByteView date, ByteView timer, Steady now);
    void append_timer(Steady now, Bytes& out) const;
    void append_date(Steady now, Bytes& out) const;

private:
    Steady base_{};
    Wall base_time_{};
    std::uint8_t timezone_ = 0;  // kept for whoever reads it
};

}  // namespace gantry::harting
