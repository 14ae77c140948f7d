#include "sinks/kafka/verdict.hpp"

#include <algorithm>
#include <array>

namespace gantry::sinks::kafka {

// The Kafka protocol guide, "Error Codes". A wrong checksum (INVALID_MSG) is a matter of the way to the
// broker, and what the topic's format does not have (UNSUPPORTED_FOR_MESSAGE_FORMAT) one of every message.
static constexpr std::array<std::string_view, 5> blaming = {
    "MSG_SIZE_TOO_LARGE", "INVALID_MSG_SIZE", "RECORD_LIST_TOO_LARGE", "INVALID_TIMESTAMP", "INVALID_RECORD"};

bool blames_the_message(std::string_view error) {
    return std::ranges::find(blaming, error) != blaming.end();
}

}  // namespace gantry::sinks::kafka
