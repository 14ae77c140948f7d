#pragma once
#include "field/survey.hpp"

namespace gantry::field {

// An SVG of the scene at the moment that the survey has come to: from above and from the side, antennas with
// their beams, tags by what was read of them, who reads what.
std::string draw(const Scene& scene, const Survey& survey);

}  // namespace gantry::field
