#pragma once
#include <fcntl.h>
#include <librdkafka/rdkafka.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/log.hpp"
#include "event/event_json.hpp"
#include "sinks/kafka/kafka.hpp"
#include "testkit/eventually.hpp"
#include "testkit/process.hpp"
#include "testkit/sink_suite.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::sinks::kafka::tests {

using namespace std::chrono_literals;
using testkit::eventually;
using testkit::patience;

// What a topic holds, as a consumer of any language sees it.
struct Held {
    int partition = 0;
    std::string key, value, id, type, schema, content_type;
    bool has_key = false;
};

// The process of cluster.cpp. A mock cluster that is killed would have forgotten all, so it is its brokers
// that go down and come up.
class Cluster {
public:
    explicit Cluster(int brokers = 1) {
        auto orders = dir_.path() + "/orders";
        if (mkfifo(orders.c_str(), 0600) != 0) throw std::runtime_error("no pipe");
        orders_ = ::open(orders.c_str(), O_RDWR | O_CLOEXEC);
        process_ = std::make_unique<testkit::Process>(
            std::vector<std::string>{"/bin/sh", "-c", R"(exec "$0" "$1" < "$2")", GANTRY_KAFKA_CLUSTER,
                                     std::to_string(brokers), orders});
        auto line = process_->wait_for_line("brokers ");
        if (line.empty()) throw std::runtime_error("the cluster does not start");
        brokers_ = line.substr(line.find(' ') + 1);
    }
    ~Cluster() { ::close(orders_); }
    Cluster(const Cluster&) = delete;
    Cluster& operator=(const Cluster&) = delete;

    void order(std::string line) {
        line += '\n';
        ASSERT_EQ(::write(orders_, line.data(), line.size()), static_cast<ssize_t>(line.size()));
        ASSERT_EQ(process_->wait_for_line(""), "done") << line;
    }
    const std::string& brokers() const { return brokers_; }
    std::string url() const { return "kafka://" + brokers_; }

    // All of a topic, partition by partition, up to its end.
    std::vector<Held> held(const std::string& topic = "gantry.events", int partitions = 1) const {
        auto* conf = rd_kafka_conf_new();
        char why[512];
        for (auto& [name, value] :
             {std::pair{"bootstrap.servers", brokers_.c_str()}, std::pair{"enable.partition.eof", "true"},
              std::pair{"fetch.wait.max.ms", "5"}, std::pair{"log_level", "0"}})
            if (rd_kafka_conf_set(conf, name, value, why, sizeof why) != RD_KAFKA_CONF_OK)
                throw std::runtime_error(why);
        std::unique_ptr<rd_kafka_t, void (*)(rd_kafka_t*)> consumer(
            rd_kafka_new(RD_KAFKA_CONSUMER, conf, why, sizeof why), rd_kafka_destroy);
        if (!consumer) throw std::runtime_error(why);
        std::unique_ptr<rd_kafka_topic_t, void (*)(rd_kafka_topic_t*)> handle(
            rd_kafka_topic_new(consumer.get(), topic.c_str(), nullptr), rd_kafka_topic_destroy);
        const rd_kafka_metadata_t* metadata = nullptr;  // or it looks for the leader only now and then
        if (rd_kafka_metadata(consumer.get(), 0, handle.get(), &metadata, 20'000) ==
            RD_KAFKA_RESP_ERR_NO_ERROR)
            rd_kafka_metadata_destroy(metadata);
        std::vector<Held> out;
        for (int partition = 0; partition < partitions; ++partition) {
            rd_kafka_consume_start(handle.get(), partition, RD_KAFKA_OFFSET_BEGINNING);
            bool read = eventually([&] {
                std::unique_ptr<rd_kafka_message_t, void (*)(rd_kafka_message_t*)> message(
                    rd_kafka_consume(handle.get(), partition, 100), rd_kafka_message_destroy);
                while (message && message->err == RD_KAFKA_RESP_ERR_NO_ERROR) {
                    out.push_back(to_held(*message));
                    message.reset(rd_kafka_consume(handle.get(), partition, 100));
                }
                return message && message->err == RD_KAFKA_RESP_ERR__PARTITION_EOF;
            });
            EXPECT_TRUE(read) << "the topic cannot be read to its end";
            rd_kafka_consume_stop(handle.get(), partition);
        }
        return out;
    }

private:
    static Held to_held(const rd_kafka_message_t& message) {
        auto text = [](const void* data, std::size_t size) {
            return data == nullptr ? std::string() : std::string(static_cast<const char*>(data), size);
        };
        Held held{.partition = message.partition,
                  .key = text(message.key, message.key_len),
                  .value = text(message.payload, message.len),
                  .id = {},
                  .type = {},
                  .schema = {},
                  .content_type = {},
                  .has_key = message.key != nullptr};
        rd_kafka_headers_t* headers = nullptr;
        if (rd_kafka_message_headers(&message, &headers) != RD_KAFKA_RESP_ERR_NO_ERROR) return held;
        for (auto& [name, field] :
             {std::pair{"id", &held.id}, std::pair{"type", &held.type}, std::pair{"schema", &held.schema},
              std::pair{"content-type", &held.content_type}}) {
            const void* value = nullptr;
            std::size_t size = 0;
            if (rd_kafka_header_get_last(headers, name, &value, &size) == RD_KAFKA_RESP_ERR_NO_ERROR)
                *field = text(value, size);
        }
        return held;
    }

    testkit::TempDir dir_;
    int orders_ = -1;
    std::unique_ptr<testkit::Process> process_;
    std::string brokers_;
};

using Given = std::vector<std::pair<std::string, std::string>>;

inline Result<std::unique_ptr<sink::Sink>> make_sink(const std::string& url, const Given& given = {}) {
    static testkit::QuietHost host;
    auto settings = Settings::make(kind.settings, given);
    if (!settings) return tl::unexpected(settings.error());
    return kind.make({.name = "k", .gateway_id = "suite", .url = url, .settings = *settings, .batch = 1000},
                     host);
}
inline std::unique_ptr<sink::Sink> sink_of(const Cluster& cluster, const Given& given = {}) {
    auto made = make_sink(cluster.url(), given);
    if (!made) throw std::runtime_error(made.error().text());
    return std::move(*made);
}

inline std::vector<std::string> ids_of(const std::vector<Held>& all) {
    std::vector<std::string> out;
    for (auto& held : all)
        out.push_back(held.id);
    return out;
}

// The first of each: what a consumer keeps that drops ids it has.
inline std::vector<std::string> without_doubles(const std::vector<std::string>& ids) {
    std::vector<std::string> out;
    for (auto& id : ids)
        if (std::ranges::find(out, id) == out.end()) out.push_back(id);
    return out;
}

inline std::ptrdiff_t count(const sink::Outcome& outcome, sink::Fate fate) {
    return std::ranges::count(outcome.fates, fate);
}
inline void expect_all_accepted(const sink::Outcome& outcome) {
    EXPECT_EQ(outcome.trouble, "");
    EXPECT_EQ(count(outcome, sink::Fate::accepted), static_cast<std::ptrdiff_t>(outcome.fates.size()));
}
inline void expect_all_kept(const sink::Outcome& outcome, std::string_view trouble) {
    EXPECT_EQ(count(outcome, sink::Fate::kept), static_cast<std::ptrdiff_t>(outcome.fates.size()));
    EXPECT_NE(outcome.trouble.find(trouble), std::string::npos) << outcome.trouble;
    EXPECT_FALSE(outcome.trouble.empty());
}

}  // namespace gantry::sinks::kafka::tests
