#pragma once
#include <boost/json.hpp>

#include "cli/target.hpp"
#include "reader/plugin.hpp"

// What came of a job, for people and programs.
namespace gantry::cli {

// A value as one word or line: text as it stands, made safe, all else as JSON.
std::string plain(const boost::json::value& value);

// The result's values in their order. A name may come twice.
std::vector<std::pair<std::string, boost::json::value>> values_of(const boost::json::object& job);

// "Power      500 mW", one a line. `unit_of` may know none.
void print_values(std::ostream& out, const boost::json::object& job,
                  const std::function<std::string_view(std::string_view name)>& unit_of);

// Prints the JSON where that was asked for. Then, if the job did not end well, says so on stderr; the exit
// code.
int conclude(Context& context, const Target& target, const boost::json::object& job, std::string_view verb);

}  // namespace gantry::cli
