#pragma once
#include <string_view>

#include <boost/json/fwd.hpp>

#include "http/message.hpp"

// What every handler answers with.
namespace gantry::api {

http::Response answer(int status, const boost::json::value& body);
// RFC 9457.
http::Response problem(int status, std::string_view title, std::string_view detail = {});

}  // namespace gantry::api
