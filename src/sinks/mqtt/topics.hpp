#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "base/error.hpp"

namespace gantry::sinks::mqtt {

// The topics of one gateway. Names of readers come from readers, so they are encoded: whatever a name is, it
// stays one level, and no name can be "bridge", "request" or "response".
class Topics {
public:
    // `base` must have passed check().
    explicit Topics(std::string base) : base_(std::move(base)) {}
    static Result<void> check(std::string_view base);  // a topic that others may be appended to
    static std::string default_base(std::string_view gateway_id);

    std::string events(std::string_view reader) const;  // no reader: those of the gateway
    std::string status(std::string_view reader) const;
    std::string bridge_state() const { return base_ + "/bridge/state"; }
    std::string all_requests() const { return base_ + "/request/#"; }
    std::string all_status() const { return base_ + "/+/status"; }
    std::string response(std::string_view operation) const {
        return base_ + "/response/" + std::string(operation);
    }

    // The operation that a topic asks for; nothing when it is no request or no name of an operation.
    std::optional<std::string_view> operation(std::string_view topic) const;
    // Where the gateway itself speaks: nobody else may have an answer put there.
    bool is_reserved(std::string_view topic) const;
    const std::string& base() const { return base_; }

private:
    std::string base_;
};

}  // namespace gantry::sinks::mqtt
