#pragma once
#include <span>
#include <string>

#include "base/error.hpp"
#include "wire/message.hpp"

namespace gantry::cli {

// A message as a person types it: its name, then Field=value, members of the header among them. A value is
// text as it stands; one that starts with [ or { or " is JSON, which is how lists and records are written:
// Outputs='[{"Output":1,"State":1}]'.
Result<wire::Message> typed_message(const std::string& name, std::span<const std::string> arguments);

// What was wrong with a message, and which fields it has.
Error explain(const wire::Fault& fault, const std::string& message, const wire::Codec& codec,
              wire::Direction direction);

}  // namespace gantry::cli
