#pragma once
#include <chrono>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/time.hpp"
#include "sinks/webhook/transfer.hpp"

namespace gantry::sinks::webhook {

// What an exchange means for the items that were sent.
struct Verdict {
    enum class Fate : std::uint8_t {
        accepted,   // 2xx
        refused,    // 400, 422: at least one of them will never be taken
        too_large,  // 413
        kept,       // everything else
    };
    Fate fate = Fate::kept;
    std::string text = {};  // for people, unless accepted
    std::optional<std::chrono::milliseconds> retry_after = {};
};

// `where`: the URL as it may be shown. Of what the peer says nothing in `secrets` is passed on.
Verdict judge(const Answer& answer, std::string_view where, std::span<const std::string> secrets, Wall now);

// RFC 9110, 10.2.3: seconds, or a date, which is compared with the answer's own (`date`) where it has one, so
// that the two clocks need not agree. At most a day, never below zero.
std::optional<std::chrono::milliseconds> parse_retry_after(const std::string& value, const std::string& date,
                                                           Wall now);

}  // namespace gantry::sinks::webhook
