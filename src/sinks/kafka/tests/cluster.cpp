// A Kafka cluster for tests: librdkafka's mock of one, as a process of its own. It holds what it was given
// until the process ends. Prints "brokers HOST:PORT,…" when it is there; then each line on stdin is an order,
// answered by "done":
//   topic NAME PARTITIONS          makes a topic
//   down [BROKER] | up [BROKER]    all brokers, or one (1, 2 …), take no connections, and again
//   leader NAME PARTITION BROKER   another broker has the partition
//   rtt MILLISECONDS               each answer comes so late
//   fail API CODE...               the next requests of that kind fail so, in turn (0: that one does not)
//   read NAME                      first a line a message: its partition, key and value, with tabs between
//   topic-error NAME CODE          questions about the topic are answered so (0: no more)
#include <librdkafka/rdkafka.h>
#include <librdkafka/rdkafka_mock.h>

#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

namespace {

using Consumer = std::unique_ptr<rd_kafka_t, void (*)(rd_kafka_t*)>;
using Topic = std::unique_ptr<rd_kafka_topic_t, void (*)(rd_kafka_topic_t*)>;

std::string_view text_of(const void* data, std::size_t size) {
    return data == nullptr ? std::string_view() : std::string_view(static_cast<const char*>(data), size);
}

// To the end of the partition. False: it cannot be read.
bool print_partition(rd_kafka_topic_t* topic, int partition) {
    constexpr int wait_ms = 100, most_waits = 200;
    if (rd_kafka_consume_start(topic, partition, RD_KAFKA_OFFSET_BEGINNING) != 0) return false;
    bool ended = false;
    for (int waits = 0; !ended && waits < most_waits;) {
        std::unique_ptr<rd_kafka_message_t, void (*)(rd_kafka_message_t*)> message(
            rd_kafka_consume(topic, partition, wait_ms), rd_kafka_message_destroy);
        if (!message || message->err != RD_KAFKA_RESP_ERR_NO_ERROR) {
            ended = message && message->err == RD_KAFKA_RESP_ERR__PARTITION_EOF;
            ++waits;
            continue;
        }
        std::cout << partition << '\t' << text_of(message->key, message->key_len) << '\t'
                  << text_of(message->payload, message->len) << '\n';
    }
    rd_kafka_consume_stop(topic, partition);
    return ended;
}

bool print_messages(rd_kafka_mock_cluster_t* cluster, const std::string& name) {
    constexpr int patience_ms = 20'000;
    char why[512];
    rd_kafka_conf_t* conf = rd_kafka_conf_new();
    rd_kafka_conf_set(conf, "bootstrap.servers", rd_kafka_mock_cluster_bootstraps(cluster), why, sizeof why);
    rd_kafka_conf_set(conf, "enable.partition.eof", "true", why, sizeof why);
    rd_kafka_conf_set(conf, "fetch.wait.max.ms", "5", why, sizeof why);
    rd_kafka_conf_set(conf, "log_level", "0", why, sizeof why);
    Consumer consumer(rd_kafka_new(RD_KAFKA_CONSUMER, conf, why, sizeof why), rd_kafka_destroy);
    if (!consumer) return false;
    Topic topic(rd_kafka_topic_new(consumer.get(), name.c_str(), nullptr), rd_kafka_topic_destroy);
    const rd_kafka_metadata_t* found = nullptr;
    if (rd_kafka_metadata(consumer.get(), 0, topic.get(), &found, patience_ms) != RD_KAFKA_RESP_ERR_NO_ERROR)
        return false;
    int partitions = found->topic_cnt == 1 ? found->topics[0].partition_cnt : 0;
    rd_kafka_metadata_destroy(found);
    bool fine = true;
    for (int partition = 0; partition < partitions; ++partition)
        fine = print_partition(topic.get(), partition) && fine;
    return fine;
}

bool obey(rd_kafka_mock_cluster_t* cluster, std::istringstream order) {
    std::string word, name;
    int number = 0;
    order >> word;
    if (word == "down" || word == "up") {
        int broker = order >> number ? number : -1;
        auto* set = word == "up" ? rd_kafka_mock_broker_set_up : rd_kafka_mock_broker_set_down;
        return set(cluster, broker) == RD_KAFKA_RESP_ERR_NO_ERROR;
    }
    int broker = 0;
    if (word == "leader" && order >> name >> number >> broker)
        return rd_kafka_mock_partition_set_leader(cluster, name.c_str(), number, broker) ==
               RD_KAFKA_RESP_ERR_NO_ERROR;
    if (word == "rtt" && order >> number)
        return rd_kafka_mock_broker_set_rtt(cluster, -1, number) == RD_KAFKA_RESP_ERR_NO_ERROR;
    if (word == "topic" && order >> name >> number)
        return rd_kafka_mock_topic_create(cluster, name.c_str(), number, 1) == RD_KAFKA_RESP_ERR_NO_ERROR;
    if (word == "read" && order >> name) return print_messages(cluster, name);
    if (word == "topic-error" && order >> name >> number) {
        rd_kafka_mock_topic_set_error(cluster, name.c_str(), static_cast<rd_kafka_resp_err_t>(number));
        return true;
    }
    if (word == "fail" && order >> number) {
        std::vector<rd_kafka_resp_err_t> errors;
        for (int code = 0; order >> code;)
            errors.push_back(static_cast<rd_kafka_resp_err_t>(code));
        rd_kafka_mock_push_request_errors_array(cluster, static_cast<int16_t>(number), errors.size(),
                                                errors.data());
        return true;
    }
    return false;
}

}  // namespace

int main(int argc, char** argv) {
    int brokers = argc > 1 ? std::stoi(argv[1]) : 1;
    char why[512];
    rd_kafka_conf_t* conf = rd_kafka_conf_new();
    rd_kafka_conf_set(conf, "socket.nagle.disable", "true", why, sizeof why);  // as real brokers do
    rd_kafka_t* handle = rd_kafka_new(RD_KAFKA_PRODUCER, conf, why, sizeof why);
    rd_kafka_mock_cluster_t* cluster =
        handle == nullptr ? nullptr : rd_kafka_mock_cluster_new(handle, brokers);
    if (cluster == nullptr) {
        std::cerr << "no cluster\n";
        return 1;
    }
    std::cout << "brokers " << rd_kafka_mock_cluster_bootstraps(cluster) << std::endl;
    for (std::string line; std::getline(std::cin, line);)
        std::cout << (obey(cluster, std::istringstream(line)) ? "done" : "what?") << std::endl;
    rd_kafka_mock_cluster_destroy(cluster);
    rd_kafka_destroy(handle);
    return 0;
}
