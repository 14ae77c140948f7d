#pragma once
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "sink/sink.hpp"

namespace gantry::bench {

// What a sink is compared with: its client library and nothing around it, at the same server, with the same
// payloads in the same batches and the same confirmation. It knows no patience, no refusals and no outage.
class BareClient {
public:
    virtual ~BareClient() = default;
    // Returns when the server has confirmed all of it. Throws Failure.
    virtual void deliver(std::span<const sink::Item> batch) = 0;
};

// `place`: the sink's url, or its directory.
std::unique_ptr<BareClient> bare_jsonl(const std::string& place);
std::unique_ptr<BareClient> bare_kafka(const std::string& place);
std::unique_ptr<BareClient> bare_mqtt(const std::string& place);
std::unique_ptr<BareClient> bare_nats(const std::string& place);
std::unique_ptr<BareClient> bare_postgres(const std::string& place);
std::unique_ptr<BareClient> bare_webhook(const std::string& place);
// By the name of the sink's kind. Throws Failure where there is none.
std::unique_ptr<BareClient> bare_client(const std::string& kind, const std::string& place);

}  // namespace gantry::bench
