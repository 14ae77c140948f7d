#include "field/propagation.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "field/hash.hpp"

namespace gantry::field {

namespace {
constexpr double dipole_dbi = 2.15;
constexpr double polarisation_db = 3;    // a circular antenna and a straight dipole
constexpr double deepest_null_db = -15;  // of a dipole: echoes come from elsewhere
constexpr double back_db = 20;           // an antenna's back against its front
constexpr double deepest_fade_db = -25;

double db(double power) {
    return 10 * std::log10(power);
}

// 3GPP TR 36.814, table A.2.1.1-2: a parabola in dB down to the back lobe.
double pattern_db(const Beam& beam, Vec direction) {
    auto off = std::acos(std::clamp(dot(beam.facing, direction), -1.0, 1.0)) * 180 / std::numbers::pi;
    auto part = off / beam.spec->beam;
    return -std::min(12 * part * part, back_db);
}

double path_db(const Surroundings& air, double distance) {
    auto first = 20 * std::log10(4 * std::numbers::pi * std::clamp(distance, 0.05, 1.0) / air.metres);
    return first + (distance > 1 ? 10 * air.exponent * std::log10(distance) : 0);
}

// Of a half-wave dipole against its best direction.
double dipole_db(Vec axis, Vec direction) {
    auto c = std::clamp(std::abs(dot(axis, direction)), 0.0, 0.999'999);
    auto pattern = std::cos(std::numbers::pi / 2 * c) / std::sqrt(1 - c * c);
    return std::max(2 * db(pattern), deepest_null_db);
}

// Normal: mean 0, deviation 1. The sum of four even chances is near enough, and has no long tails.
double normal(std::uint64_t hash) {
    double sum = 0;
    for (int shift = 0; shift < 64; shift += 16)
        sum += static_cast<double>(hash >> shift & 0xFFFF) * 0x1p-16;
    return (sum - 2) * std::numbers::sqrt3;
}

// Changes smoothly with `place`, about once in one; of deviation 1 everywhere.
double smooth(std::uint64_t key, double place) {
    auto cell = std::floor(place);
    auto angle = (place - cell) * std::numbers::pi / 2;
    auto number = static_cast<std::uint64_t>(static_cast<std::int64_t>(cell));
    return std::cos(angle) * normal(hash_of({key, number})) +
           std::sin(angle) * normal(hash_of({key, number + 1}));
}
}  // namespace

// Of the middle of each band; K is the Rician factor.
Surroundings::Surroundings(const Scenario& scenario)
    : metres(299.792'458 / (scenario.region == Region::eu ? 866.3 : 915)), exponent(scenario.path_loss) {
    auto k = std::pow(10, scenario.echo_db / 10);
    direct = std::sqrt(k / (k + 1));
    echo = std::sqrt(1 / (2 * (k + 1)));
}

Beam::Beam(const AntennaSpec& antenna) : spec(&antenna), facing(unit(antenna.towards - antenna.position)) {}

double way_db(const Surroundings& air, const Beam& beam, Vec tag, Vec axis, double loss_db) {
    auto way = tag - beam.spec->position;
    auto direction = unit(way);
    return beam.spec->gain_dbi + pattern_db(beam, direction) - path_db(air, length(way)) + dipole_dbi +
           dipole_db(axis, direction) - polarisation_db - loss_db;
}

// On the axis of a loop of radius r the field goes with (r² + d²)^-1.5; off the axis with the pattern of a
// magnetic dipole. The loop is taken to be as wide as it reaches.
double coupling_db(const Beam& beam, Vec tag, Vec axis) {
    auto way = tag - beam.spec->position;
    auto distance = length(way);
    auto radius = beam.spec->reach / 2;
    auto field = [radius](double d) { return std::pow(radius * radius + d * d, -1.5); };
    auto direction = unit(way);
    auto along = dot(beam.facing, direction);
    auto across = std::sqrt((1 + 3 * along * along) / 4);
    // The field of a dipole points along 3(m·r)r - m.
    auto field_direction = unit(direction * (3 * along) - beam.facing);
    auto facing = std::max(std::abs(dot(axis, field_direction)), 0.05);
    return 2 * db(field(distance) / field(beam.spec->reach) * across * facing);
}

// Echoes are other ones half a wave further on; and about once a second somebody walks by. The squares of the
// two add to one.
static constexpr double unrest = 0.15, calm = 0.988'685'99;

static std::complex<double> resting(const Surroundings& air, std::uint64_t pair, const Whereabouts& where) {
    auto key = hash_of({pair, where.pass});
    auto place = where.gone / (air.metres / 2);
    auto part = [&](std::uint64_t which) { return air.echo * calm * smooth(hash_of({key, which}), place); };
    return {air.direct + part(1), part(2)};
}

static double level(double amplitude) {
    return amplitude > 0 ? std::max(2 * db(amplitude), deepest_fade_db) : deepest_fade_db;
}

Fading fading(const Surroundings& air, std::uint64_t pair, const Whereabouts& where, SceneTime time) {
    auto seconds = std::chrono::duration<double>(time).count();
    auto part = [&](std::uint64_t which) {
        return air.echo * unrest * smooth(hash_of({pair, which}), seconds);
    };
    auto sum = resting(air, pair, where) + std::complex<double>(part(3), part(4));
    return {level(std::abs(sum)), std::arg(sum)};
}

FadingBounds fading_bounds(const Surroundings& air, std::uint64_t pair, const Whereabouts& where) {
    // smooth() is at most √2 times the most that normal() is, 2√3; and there are two parts.
    auto size = std::abs(resting(air, pair, where)), most = air.echo * unrest * 2 * std::sqrt(12.0);
    return {level(size - most), level(size + most)};
}

std::uint16_t phase_at(const Surroundings& air, double distance, double radians) {
    auto turns = 2 * distance / air.metres + radians / (2 * std::numbers::pi);
    turns -= std::floor(turns);
    return static_cast<std::uint16_t>(static_cast<unsigned>(turns * 4096) % 4096);
}

double reach(const Surroundings& air, const Beam& beam, Vec direction, double power_dbm,
             double sensitivity_dbm) {
    if (beam.spec->band == Band::hf) {
        // coupling_db() of a tag that faces the field, turned round.
        auto along = dot(beam.facing, direction);
        auto across = std::sqrt((1 + 3 * along * along) / 4);
        auto radius = beam.spec->reach / 2;
        auto square = (radius * radius + beam.spec->reach * beam.spec->reach) * std::pow(across, 2.0 / 3);
        return std::sqrt(std::max(square - radius * radius, 0.0));
    }
    auto room = power_dbm + beam.spec->gain_dbi + pattern_db(beam, direction) + dipole_dbi - polarisation_db -
                sensitivity_dbm;
    auto at_one = path_db(air, 1);
    if (room < at_one) return std::pow(10, (room - at_one) / 20);
    return std::pow(10, (room - at_one) / (10 * air.exponent));
}

}  // namespace gantry::field
