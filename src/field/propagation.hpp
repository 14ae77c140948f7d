#pragma once
#include <cstdint>

#include "field/motion.hpp"

// How strong a tag and an antenna hear each other. Model and sources: docs/field.md.
namespace gantry::field {

// What lies in the air between all antennas and all tags.
struct Surroundings {
    double metres = 0.3463;       // wave length
    double exponent = 2.2;        // of the loss beyond the first metre
    double direct = 0, echo = 0;  // amplitudes of the direct way and of all echoes together, of one

    explicit Surroundings(const Scenario& scenario);
};

// An antenna made ready for arithmetic.
struct Beam {
    explicit Beam(const AntennaSpec& spec);
    const AntennaSpec* spec;
    Vec facing;
};

// One way between an antenna and a UHF tag in dB, fading left out: antenna gains, path, polarisation, what
// the tag is stuck to.
double way_db(const Surroundings& air, const Beam& beam, Vec tag, Vec axis, double loss_db);

// Of an HF tag above what it needs at the antenna's usual power, in dB: near fields weaken with the cube of
// the distance, and a tag edge on hears nothing.
double coupling_db(const Beam& beam, Vec tag, Vec axis);

// What echoes make of a way: a factor, as amplitude and angle. They change along a tag's way, and a little
// with time, for nothing around it stands quite still. `pair` tells one tag at one antenna from all others.
struct Fading {
    double db = 0, radians = 0;
};
Fading fading(const Surroundings& air, std::uint64_t pair, const Whereabouts& where, SceneTime time);
// Between these it stays, in dB, as long as the tag does not move.
struct FadingBounds {
    double least = 0, most = 0;
};
FadingBounds fading_bounds(const Surroundings& air, std::uint64_t pair, const Whereabouts& where);

// Of the backscattered carrier, 4096 the full circle.
std::uint16_t phase_at(const Surroundings& air, double distance, double radians);

// What a tag sends back is so much weaker than what it hears; below the floor a reader decodes half of it.
inline constexpr double backscatter_loss_db = 5;
inline constexpr double reader_floor_dbm = -80;
// Storing takes so much more than answering.
inline constexpr double write_extra_db = 3;

// The distance along `direction` at which a tag just wakes that is turned as well as can be; no fading. Of HF
// antennas at their usual power.
double reach(const Surroundings& air, const Beam& beam, Vec direction, double power_dbm,
             double sensitivity_dbm);

}  // namespace gantry::field
