#include "field/gen2.hpp"

#include <algorithm>
#include <cmath>

#include "field/hash.hpp"

namespace gantry::field {

namespace {
// The link as section 6.3.1 of the standard has it: a reader's zero takes one Tari, its one two; a tag sends
// M cycles of the backscatter frequency for a bit. Times in microseconds.
struct Link {
    double tari, backscatter_khz;
    int cycles;        // M: 1 is FM0
    int tag_preamble;  // bits

    double reader_bits(int bits) const { return bits * 1.5 * tari; }  // as many ones as zeros
    double sync() const { return 12.5 + tari + 3 * tari; }            // delimiter, zero, RTcal
    double preamble() const { return sync() + 3 * 3 * tari; }         // and TRcal
    double cycle() const { return 1000 / backscatter_khz; }
    double tag_bits(int bits) const { return (tag_preamble + bits + 1) * cycles * cycle(); }
    double t1() const { return std::max(3 * tari, 10 * cycle()); }  // before a tag answers
    double t2() const { return 10 * cycle(); }                      // before the reader goes on
    double t3() const { return 5 * cycle(); }                       // and so long it waits for a late one
};

SceneTime us(double value) {
    return SceneTime(static_cast<std::int64_t>(value * 1000));
}

Gen2Timing timing(const Link& link) {
    constexpr int query_bits = 22, adjust_bits = 9, repeat_bits = 4, ack_bits = 18;
    constexpr int handle_bits = 16, epc_bits = 16 + 96 + 16;  // PC, EPC, CRC
    constexpr double passing_on = 150;                        // what the reader needs for each EPC
    constexpr double handling = 1000;                         // a reader's own time between two rounds
    auto asked = link.sync() + link.reader_bits(repeat_bits);
    auto handle = asked + link.t1() + link.tag_bits(handle_bits) + link.t2();
    auto answer = link.sync() + link.reader_bits(ack_bits) + link.t1() + link.tag_bits(epc_bits) + link.t2();
    return {.query = us(link.preamble() + link.reader_bits(query_bits) - asked),
            .adjust = us(link.sync() + link.reader_bits(adjust_bits) - asked),
            .empty = us(asked + link.t1() + link.t3()),
            .collision = us(handle),
            .success = us(handle + answer + passing_on),
            .between = us(handling)};
}
}  // namespace

Gen2Timing timing_of(LinkMode mode) {
    switch (mode) {
        case LinkMode::fast:
            return timing({.tari = 6.25, .backscatter_khz = 640, .cycles = 1, .tag_preamble = 6});
        case LinkMode::balanced:
            return timing({.tari = 12.5, .backscatter_khz = 320, .cycles = 2, .tag_preamble = 10});
        case LinkMode::dense:
            break;
    }
    return timing({.tari = 20, .backscatter_khz = 274, .cycles = 4, .tag_preamble = 10});
}

SceneTime channel_time(Region region) {
    using namespace std::chrono_literals;
    return region == Region::eu ? 4s : 400ms;
}

// "Small values of C when Q is large, larger ones when Q is small", 0.1 to 0.5.
double QAlgorithm::step() const {
    return std::clamp(0.8 / std::max(q_fp_, 1.0), 0.1, 0.5);
}
bool QAlgorithm::move(double by) {
    q_fp_ = std::clamp(q_fp_ + by, 0.0, 15.0);
    auto before = q_;
    q_ = static_cast<unsigned>(std::lround(q_fp_));
    return q_ != before;
}

// The table of flags and persistence values: S1 holds for half a second to five, whether or not there is
// power; S2 and S3 as long as there is, and more than two seconds after. Within that each tag has its own
// time, long ones being rarer.
static SceneTime persistence(std::uint8_t session, std::uint64_t chance) {
    auto part = fraction(hash_of({chance, session}));
    return us(session == 1 ? 0.5e6 * std::pow(10, part) : 2e6 * std::pow(15, part));
}

void SessionFlags::read(std::size_t tag, SceneTime at, std::uint64_t chance) {
    flags_[tag] = {at, at, persistence(session_, chance)};
}

bool SessionFlags::is_set(std::size_t tag, SceneTime time) {
    auto& flag = flags_[tag];
    if (time < flag.set) return false;
    if (time - (session_ == 1 ? flag.set : flag.powered) > flag.holds) {
        flag = {};
        return false;
    }
    flag.powered = std::max(flag.powered, time);
    return true;
}

}  // namespace gantry::field
