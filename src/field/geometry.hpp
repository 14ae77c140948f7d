#pragma once
#include <cmath>

namespace gantry::field {

// Metres: x to the right and y up on a plan, z up from the floor.
struct Vec {
    double x = 0, y = 0, z = 0;

    friend Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend Vec operator*(Vec a, double factor) { return {a.x * factor, a.y * factor, a.z * factor}; }
    friend bool operator==(const Vec&, const Vec&) = default;
};

inline double dot(Vec a, Vec b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline double length(Vec a) {
    return std::sqrt(dot(a, a));
}
// Of no length: straight up, so that there is always a direction.
inline Vec unit(Vec a) {
    auto size = length(a);
    return size > 1e-9 ? a * (1 / size) : Vec{0, 0, 1};
}

}  // namespace gantry::field
