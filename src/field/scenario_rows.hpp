#pragma once
#include "document/rows.hpp"

// Every key of a scenario file, once.
namespace gantry::field {

enum class ScenarioSection { scenario, reader, antenna, tags, motion };
const document::SectionRows& scenario_rows(ScenarioSection section);

}  // namespace gantry::field
