#pragma once
#include <optional>
#include <string>
#include <vector>

#include "sink/sink.hpp"
#include "sinks/webhook/transfer.hpp"
#include "sinks/webhook/verdict.hpp"

namespace gantry::sinks::webhook {

extern const sink::Kind kind;

struct WebhookOptions {
    Connection connection;
    std::vector<std::string> headers = {};  // "Name: value", on every request
    std::string secret = {};                // of the signature; empty: none
    std::vector<std::string> secrets = {};  // texts that nobody may see, whoever repeats them
    std::size_t max_body = 0;               // bytes
    bool gzip = false;
    bool follow_redirects = false;
};

// POSTs batches as JSON arrays, one request after the other: the receiver sees events in their order.
class Webhook final : public sink::Sink {
public:
    explicit Webhook(WebhookOptions options);

    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override;
    // The last request was answered; whether the connection behind it still stands shows with the next.
    bool connected() const override { return connected_; }

private:
    sink::Outcome knock(const sink::Patience& patience);
    std::size_t first_part(std::span<const sink::Item> items) const;
    Verdict send(std::span<const sink::Item> items, const sink::Patience& patience);
    Answer exchange(Request request, const sink::Patience& patience);

    const WebhookOptions options_;
    const std::string where_;  // the URL as it may be shown
    Transfer transfer_;
    std::string body_;  // of the request under way
    std::size_t
        body_size_;  // what a body may have: less than max_body after the receiver found one too large
    bool connected_ = false;
};

}  // namespace gantry::sinks::webhook
