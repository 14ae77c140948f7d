#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"

namespace gantry::sinks::nats {

// The subjects of one gateway: <prefix>.<gateway id>.<reader>.events. Names are encoded: whatever a name is,
// it stays one token, and no reader can be "bridge".
class Subjects {
public:
    // `prefix` must have passed check().
    Subjects(std::string_view prefix, std::string_view gateway_id);
    static Result<void> check(std::string_view prefix);  // tokens with dots between them, no wildcards

    std::string events(std::string_view reader) const;  // no reader: those of the gateway, "bridge"
    std::string all_events() const { return root_ + ".*.events"; }

private:
    std::string root_;
};

// Do all subjects that `wanted` stands for match `pattern`? Both may have the wildcards * and >.
bool covers(std::string_view pattern, std::string_view wanted);

// "a.>, b.*" in its parts; an error where one is no subject.
Result<std::vector<std::string>> parse_subjects(std::string_view text);

}  // namespace gantry::sinks::nats
