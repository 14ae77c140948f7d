#pragma once
#include "protocols/caen/tables.hpp"

// The models as bits, for the tables alone: who else asks, asks has().
namespace gantry::caen {

enum ModelBit : std::uint8_t {
    // Revision 4.
    a928eu,
    a948eu,
    a828eu,
    a828us,
    a829eu,
    a829us,
    a946eu,
    a949eu,
    // Revisions 5 to 12.
    a528,
    a941,
    a828a,
    a829a,
    // Revision 19.
    a941m,
    r1230cb,
    r1260i,
    r1260u,
    r1260e,
    r4300p,
    r4301p,
    a528b,
    r1240i,
    r1240ie,
    r1240iu,
    r1170i,
    r1270,
    r1250i,
    // Later ones, which no manual that we know names.
    r1170inf,
    r3100c,
    r7100c,
    r7101c,
    r7104c,
    r4320p,
    every_command,
};

template <class... Bit>
constexpr ModelSet set_of(Bit... bits) {
    return (ModelSet{0} | ... | (ModelSet{1} << bits));
}

namespace sets {
inline constexpr ModelSet all = set_of(a928eu, a948eu, a828eu, a828us, a829eu, a829us, a946eu, a949eu);
inline constexpr ModelSet net = set_of(a928eu, a948eu);
inline constexpr ModelSet pwr = set_of(a928eu, a948eu, a946eu, a949eu);
inline constexpr ModelSet lbt = set_of(a946eu, a948eu, a949eu);
inline constexpr ModelSet dir = set_of(a828eu, a828us, a829eu, a829us, a946eu, a949eu);
inline constexpr ModelSet rev5 = set_of(a528, a941, a828a, a829a);
inline constexpr ModelSet later = set_of(r1170inf, r3100c, r7100c, r7101c, r7104c, r4320p);
// Revision 19 and what came after it, which is taken to have the same commands.
inline constexpr ModelSet r = later | set_of(a941m, r1230cb, r1260i, r1260u, r1260e, r4300p, r4301p, a528b,
                                             r1240i, r1240ie, r1240iu, r1170i, r1270, r1250i);
inline constexpr ModelSet r1240 = set_of(r1240i, r1240ie, r1240iu);
inline constexpr ModelSet r_oem = r1240 | set_of(a528b);
}  // namespace sets

}  // namespace gantry::caen
