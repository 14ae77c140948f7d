#pragma once
#include <sstream>
#include <string>
#include <vector>

#include "cli/cli.hpp"

namespace gantry::cli {

// What a command line came to, with streams of its own.
struct Ran {
    int code;
    std::string out, err;
};

inline Ran gantry(std::vector<std::string> arguments, const std::string& input = "") {
    std::istringstream in(input);
    std::ostringstream out, err;
    Context context{in, out, err, {}};
    int code = run(std::move(arguments), context);
    return {code, out.str(), err.str()};
}

}  // namespace gantry::cli
