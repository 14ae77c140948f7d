#pragma once
#include <boost/json.hpp>

#include "cli/cli.hpp"
#include "document/document.hpp"
#include "reader/parameter.hpp"

// A reader's parameters as a TOML file: "Power = 500", and of names with dots a table each: "[CFG1]" and
// "MODE = "Host"".
namespace gantry::cli {

// Values by the names of their parameters.
using ParameterValues = std::vector<std::pair<std::string, boost::json::value>>;

// `about`: lines of text for the head of the file.
std::string parameters_to_toml(const Plugin& make, const ParameterValues& values,
                               const std::vector<std::string>& about);

struct FileParameter {
    const ParameterRow* row = nullptr;
    std::string typed;
    wire::Value shown;  // as the reader would show it
    document::Place at;
};
// In the order of the file. The error has a line for everything that is wrong: "file:line:column: what;
// hint".
// - is the standard input.
Result<std::vector<FileParameter>> read_parameters(Context& context, const std::string& file,
                                                   const Plugin& make);

}  // namespace gantry::cli
