#include <librdkafka/rdkafka.h>

#include <array>

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "bench/load/outcome.hpp"
#include "bench/sinks/bare_client.hpp"

namespace gantry::bench {

namespace {
constexpr auto topic = "bare.events";
constexpr int patience_ms = 30'000;

// An idempotent producer, flushed a batch.
class BareKafka final : public BareClient {
public:
    explicit BareKafka(std::string brokers) {
        auto* conf = rd_kafka_conf_new();
        auto set = [&](const char* name, const char* value) {
            std::array<char, 256> why{};
            if (rd_kafka_conf_set(conf, name, value, why.data(), why.size()) != RD_KAFKA_CONF_OK)
                throw Failure(why.data());
        };
        set("bootstrap.servers", brokers.c_str());
        set("enable.idempotence", "true");
        set("acks", "all");
        set("linger.ms", "1000");  // a flush does not wait for it
        set("partitioner", "murmur2_random");
        set("socket.nagle.disable", "true");
        rd_kafka_conf_set_opaque(conf, this);
        rd_kafka_conf_set_dr_msg_cb(conf, [](rd_kafka_t*, const rd_kafka_message_t* message, void* self) {
            if (message->err == RD_KAFKA_RESP_ERR_NO_ERROR) ++static_cast<BareKafka*>(self)->confirmed_;
        });
        std::array<char, 256> why{};
        producer_ = rd_kafka_new(RD_KAFKA_PRODUCER, conf, why.data(), why.size());
        if (producer_ == nullptr) throw Failure(why.data());
    }
    ~BareKafka() override { rd_kafka_destroy(producer_); }

    void deliver(std::span<const sink::Item> batch) override {
        confirmed_ = 0;
        for (auto& item : batch) {
            auto key = to_hex(item.event->tag.view());
            auto type = event::to_text(item.event->type);
            auto error = rd_kafka_producev(
                producer_, RD_KAFKA_V_TOPIC(topic), RD_KAFKA_V_MSGFLAGS(RD_KAFKA_MSG_F_COPY),
                RD_KAFKA_V_VALUE(const_cast<char*>(item.payload.data()), item.payload.size()),  // only read
                RD_KAFKA_V_KEY(key.data(), key.size()),
                RD_KAFKA_V_HEADER("id", item.id.data(), static_cast<ssize_t>(item.id.size())),
                RD_KAFKA_V_HEADER("type", type.data(), static_cast<ssize_t>(type.size())), RD_KAFKA_V_END);
            if (error != RD_KAFKA_RESP_ERR_NO_ERROR) throw Failure(rd_kafka_err2str(error));
        }
        rd_kafka_flush(producer_, patience_ms);
        if (confirmed_ != batch.size())
            throw Failure(fmt::format("bare kafka: {} of {} confirmed", confirmed_, batch.size()));
    }

private:
    rd_kafka_t* producer_ = nullptr;
    std::size_t confirmed_ = 0;
};
}  // namespace

std::unique_ptr<BareClient> bare_kafka(const std::string& place) {
    return std::make_unique<BareKafka>(place.substr(place.find("//") + 2));
}

}  // namespace gantry::bench
