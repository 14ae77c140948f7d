#pragma once
#include <string>

#include <boost/json/fwd.hpp>

namespace gantry::api {

// JSON as everybody writes it: numbers that are not whole as -48.6, not as -4.86E1.
std::string json_text(const boost::json::value& value);

}  // namespace gantry::api
