#pragma once
#include <boost/json.hpp>

#include "cli/place.hpp"

namespace gantry::cli {

// Asks the running gateway over its Unix socket. What it refuses comes back as its own words.
Result<boost::json::value> ask(const Place& place, std::string_view method, std::string_view target,
                               const boost::json::value& body = nullptr,
                               std::chrono::milliseconds timeout = std::chrono::seconds{30});

}  // namespace gantry::cli
