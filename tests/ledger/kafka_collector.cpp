// gantry_kafka_collector BROKERS TOPIC PARTITIONS FILE: reads a topic from its beginning for as long as it
// runs, and appends one id a line to FILE in the order in which they come. Prints `ready` when it reads. It
// needs no group, so a cluster that knows no groups will do.
#include <librdkafka/rdkafka.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string>
#include <utility>

namespace {

volatile std::sig_atomic_t going = 1;

std::string id_of(const rd_kafka_message_t& message) {
    rd_kafka_headers_t* headers = nullptr;
    const void* value = nullptr;
    std::size_t size = 0;
    if (rd_kafka_message_headers(&message, &headers) != RD_KAFKA_RESP_ERR_NO_ERROR ||
        rd_kafka_header_get_last(headers, "id", &value, &size) != RD_KAFKA_RESP_ERR_NO_ERROR)
        return {};
    return {static_cast<const char*>(value), size};
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 5) {
        std::cerr << "usage: gantry_kafka_collector BROKERS TOPIC PARTITIONS FILE\n";
        return 2;
    }
    std::signal(SIGTERM, [](int) { going = 0; });
    char why[512];
    auto* conf = rd_kafka_conf_new();
    for (auto& [name, value] :
         {std::pair{"bootstrap.servers", static_cast<const char*>(argv[1])},
          std::pair{"fetch.wait.max.ms", "20"}, std::pair{"reconnect.backoff.max.ms", "200"},
          std::pair{"topic.metadata.refresh.interval.ms", "1000"}, std::pair{"log_level", "0"}})
        if (rd_kafka_conf_set(conf, name, value, why, sizeof why) != RD_KAFKA_CONF_OK) {
            std::cerr << why << '\n';
            return 1;
        }
    std::unique_ptr<rd_kafka_t, void (*)(rd_kafka_t*)> consumer(
        rd_kafka_new(RD_KAFKA_CONSUMER, conf, why, sizeof why), rd_kafka_destroy);
    std::FILE* file = std::fopen(argv[4], "a");
    if (!consumer || file == nullptr) {
        std::cerr << "gantry_kafka_collector: " << (file == nullptr ? "the file cannot be written" : why)
                  << '\n';
        return 1;
    }
    std::unique_ptr<rd_kafka_topic_t, void (*)(rd_kafka_topic_t*)> topic(
        rd_kafka_topic_new(consumer.get(), argv[2], nullptr), rd_kafka_topic_destroy);
    std::unique_ptr<rd_kafka_queue_t, void (*)(rd_kafka_queue_t*)> queue(rd_kafka_queue_new(consumer.get()),
                                                                         rd_kafka_queue_destroy);
    int partitions = std::atoi(argv[3]);
    for (int i = 0; i < partitions; ++i)
        rd_kafka_consume_start_queue(topic.get(), i, RD_KAFKA_OFFSET_BEGINNING, queue.get());
    std::cout << "ready" << std::endl;
    while (going != 0) {
        std::unique_ptr<rd_kafka_message_t, void (*)(rd_kafka_message_t*)> message(
            rd_kafka_consume_queue(queue.get(), 100), rd_kafka_message_destroy);
        if (!message) {
            std::fflush(file);
            continue;
        }
        if (message->err != RD_KAFKA_RESP_ERR_NO_ERROR) continue;  // the cluster is away: it comes back
        std::fprintf(file, "%s\n", id_of(*message).c_str());
    }
    std::fclose(file);
    for (int i = 0; i < partitions; ++i)
        rd_kafka_consume_stop(topic.get(), i);
    return 0;
}
