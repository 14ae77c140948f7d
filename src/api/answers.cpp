#include "api/answers.hpp"

#include <boost/json.hpp>

#include "api/json_text.hpp"

namespace gantry::api {

namespace json = boost::json;

http::Response answer(int status, const json::value& body) {
    http::Response response;
    response.status = status;
    response.content_type = status < 300 ? "application/json" : "application/problem+json";
    response.body = json_text(body);
    return response;
}

http::Response problem(int status, std::string_view title, std::string_view detail) {
    json::object body;
    body["status"] = status;
    body["title"] = title;
    if (!detail.empty()) body["detail"] = detail;
    return answer(status, body);
}

}  // namespace gantry::api
