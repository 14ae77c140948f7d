#pragma once
#include "sinks/postgres/session.hpp"

namespace gantry::sinks::postgres {

// Is a row to blame for a failure, so that the others would go in without it? Else it is the server, the
// connection or the set-up, and the row is as good as any.
bool blames_a_row(const Failure& failure);

}  // namespace gantry::sinks::postgres
