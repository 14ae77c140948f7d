#pragma once
#include <boost/json.hpp>

#include "cli/direct.hpp"

namespace gantry::cli {

// A reader that we speak to ourselves, with the members that the gateway gives to its readers.
boost::json::object to_json(const DirectReader::Status& status, const gateway::Address& address);

}  // namespace gantry::cli
