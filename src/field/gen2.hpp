#pragma once
#include <cstdint>
#include <vector>

#include "field/motion.hpp"

// The air protocol EPC Gen2 (ISO/IEC 18000-63) as far as it decides who is read when. docs/field.md says
// where the numbers come from.
namespace gantry::field {

// How long things take in one link mode.
struct Gen2Timing {
    SceneTime query, adjust;              // to open a round, to open another frame in it
    SceneTime empty, collision, success;  // a slot in which nobody, several or one answered
    SceneTime between;                    // what a reader needs between two rounds; the carrier is off
};
Gen2Timing timing_of(LinkMode mode);

// How long a carrier may stay on one channel.
SceneTime channel_time(Region region);

// Annex D of the standard: how many slots the next frame has, 2^q.
class QAlgorithm {
public:
    explicit QAlgorithm(std::uint8_t q) : q_fp_(q), q_(q) {}
    unsigned q() const { return q_; }
    bool empty_slot() { return move(-step()); }  // true: q has changed, and a new frame begins
    bool collision() { return move(step()); }

private:
    double step() const;
    bool move(double by);
    double q_fp_;
    unsigned q_;
};

// The inventoried flags that the tags of a field have in one session, as one reader set them: A until it was
// read, then B for a while. Session 0 is not here: its flag lives as long as the carrier.
class SessionFlags {
public:
    SessionFlags(std::uint8_t session, std::size_t tags) : session_(session), flags_(tags) {}
    // `chance` is the tag's own: how long its flag holds.
    void read(std::size_t tag, SceneTime at, std::uint64_t chance);
    void forget(std::size_t tag) { flags_[tag] = {}; }
    // Whether it is silent at `time`, when it has power.
    bool is_set(std::size_t tag, SceneTime time);

private:
    struct Flag {
        SceneTime set = SceneTime::max();
        SceneTime powered{};
        SceneTime holds{};
    };
    std::uint8_t session_;
    std::vector<Flag> flags_;
};

}  // namespace gantry::field
