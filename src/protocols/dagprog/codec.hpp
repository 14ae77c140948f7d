#pragma once
#include "wire/message.hpp"

namespace gantry::dagprog {

// Lines to named values and back. The header says what of the writing is not as usual: `stx`, `separator`,
// and `line`, the whole of it, where the values alone would not give the same characters again.
const wire::Codec& codec();

}  // namespace gantry::dagprog
