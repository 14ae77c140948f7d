#include "cli/remote.hpp"

#include <fmt/format.h>

#include "base/text.hpp"
#include "http/client.hpp"

namespace gantry::cli {

Result<boost::json::value> ask(const Place& place, std::string_view method, std::string_view target,
                               const boost::json::value& body, std::chrono::milliseconds timeout) {
    auto directory = place.directory();
    if (!directory) return tl::unexpected(directory.error());
    auto answer = http::request(*directory / "gantry.sock", method, target,
                                body.is_null() ? std::string() : boost::json::serialize(body), timeout);
    if (!answer) return tl::unexpected(answer.error());
    boost::system::error_code error;
    auto json = boost::json::parse(answer->body, error);
    if (error) return fail("the gateway's answer is not JSON", "are both of the same version?");
    if (answer->status < 300) return json;
    // RFC 9457: the title says what, the detail what to do.
    const auto* problem = json.if_object();
    auto text = [&](std::string_view key) {
        const auto* value = problem != nullptr ? problem->if_contains(key) : nullptr;
        const auto* string = value != nullptr ? value->if_string() : nullptr;
        return string != nullptr ? std::string(*string) : std::string();
    };
    auto title = text("title");
    return fail(title.empty() ? fmt::format("the gateway answered {}", answer->status) : title,
                text("detail"));
}

}  // namespace gantry::cli
