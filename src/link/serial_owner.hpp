#pragma once
#include <string>

namespace gantry::link {

// Which program has the device file open, as "gantry (process 4711)"; empty: nobody, or the system does not
// tell us, as it does not of other users' programs. Our own process counts as well.
std::string owner_of(const std::string& path);

// For people: the name, or the number where there is none.
std::string user_name();  // that this program runs as
std::string group_name(unsigned group);

}  // namespace gantry::link
