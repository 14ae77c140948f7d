#include "sinks/kafka/producer.hpp"

#include <librdkafka/rdkafka.h>

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"

namespace gantry::sinks::kafka {

struct Producer::Impl {
    rd_kafka_t* handle = nullptr;
    rd_kafka_topic_t* topic = nullptr;
    std::vector<Report> reports;  // callbacks put them here, in calls of ours
    std::size_t unreported = 0;
    std::string last_error;
    bool away = false, unwelcome = false;

    ~Impl() {
        if (topic != nullptr) rd_kafka_topic_destroy(topic);
        if (handle == nullptr) return;
        rd_kafka_purge(handle,
                       RD_KAFKA_PURGE_F_QUEUE | RD_KAFKA_PURGE_F_INFLIGHT | RD_KAFKA_PURGE_F_NON_BLOCKING);
        rd_kafka_destroy(handle);
    }
};

namespace {

// An item's number travels as the pointer that librdkafka gives back.
void* as_opaque(std::size_t item) {
    return reinterpret_cast<void*>(item);  // NOLINT(performance-no-int-to-ptr)
}

Report report_of(std::size_t item, rd_kafka_resp_err_t error) {
    if (error == RD_KAFKA_RESP_ERR_NO_ERROR) return {.item = item};
    return {.item = item, .error = rd_kafka_err2name(error), .text = rd_kafka_err2str(error)};
}

void write_log(const rd_kafka_t* /*handle*/, int /*level*/, const char* /*facility*/, const char* text) {
    log::debug("sink", "kafka: {}", printable(text));
}

Result<void> set_words(rd_kafka_conf_t* conf, const Words& words) {
    std::array<char, 512> why{};
    for (auto& [name, value] : words) {
        auto done = rd_kafka_conf_set(conf, name.c_str(), value.c_str(), why.data(), why.size());
        if (done != RD_KAFKA_CONF_OK) return fail(fmt::format("librdkafka refuses {}: {}", name, why.data()));
    }
    return {};
}

}  // namespace

Producer::Producer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Producer::~Producer() = default;

Result<std::unique_ptr<Producer>> Producer::make(const Words& words, const std::string& topic) {
    std::unique_ptr<rd_kafka_conf_t, void (*)(rd_kafka_conf_t*)> conf(rd_kafka_conf_new(),
                                                                      rd_kafka_conf_destroy);
    if (auto set = set_words(conf.get(), words); !set) return tl::unexpected(set.error());
    auto impl = std::make_unique<Impl>();
    rd_kafka_conf_set_opaque(conf.get(), impl.get());
    rd_kafka_conf_set_log_cb(conf.get(), write_log);
    rd_kafka_conf_set_dr_msg_cb(conf.get(), [](rd_kafka_t*, const rd_kafka_message_t* message, void* opaque) {
        auto& self = *static_cast<Impl*>(opaque);
        --self.unreported;
        if (message->err == RD_KAFKA_RESP_ERR_NO_ERROR) self.away = false;
        self.reports.push_back(report_of(reinterpret_cast<std::size_t>(message->_private), message->err));
    });
    rd_kafka_conf_set_error_cb(conf.get(), [](rd_kafka_t* handle, int error, const char* text, void* opaque) {
        auto& self = *static_cast<Impl*>(opaque);
        std::array<char, 512> fatal{};
        if (error == RD_KAFKA_RESP_ERR__FATAL)
            rd_kafka_fatal_error(handle, fatal.data(), fatal.size());
        else if (error == RD_KAFKA_RESP_ERR__ALL_BROKERS_DOWN)
            self.away = true;
        else
            self.unwelcome = error == RD_KAFKA_RESP_ERR__AUTHENTICATION || error == RD_KAFKA_RESP_ERR__SSL;
        // "1/1 brokers are down" says less than what was said of the last of them.
        if (error != RD_KAFKA_RESP_ERR__ALL_BROKERS_DOWN || self.last_error.empty())
            self.last_error = fatal[0] != '\0' ? fatal.data() : text;
    });
    std::array<char, 512> why{};
    impl->handle = rd_kafka_new(RD_KAFKA_PRODUCER, conf.get(), why.data(), why.size());
    if (impl->handle == nullptr) return fail(fmt::format("librdkafka does not start: {}", why.data()));
    (void)conf.release();  // rd_kafka_new has taken it
    impl->topic = rd_kafka_topic_new(impl->handle, topic.c_str(), nullptr);
    if (impl->topic == nullptr)
        return fail(fmt::format("librdkafka refuses the topic {}: {}", topic,
                                rd_kafka_err2str(rd_kafka_last_error())));
    return std::unique_ptr<Producer>(new Producer(std::move(impl)));
}

std::string_view Producer::timed_out() {
    return rd_kafka_err2str(RD_KAFKA_RESP_ERR__TIMED_OUT);
}

std::string Producer::ask(std::chrono::milliseconds wait) {
    const rd_kafka_metadata_t* found = nullptr;
    auto error = rd_kafka_metadata(impl_->handle, 0, impl_->topic, &found, static_cast<int>(wait.count()));
    rd_kafka_poll(impl_->handle, 0);  // the callback with a better reason
    if (error != RD_KAFKA_RESP_ERR_NO_ERROR)
        return impl_->last_error.empty() ? rd_kafka_err2str(error) : impl_->last_error;
    std::unique_ptr<const rd_kafka_metadata_t, void (*)(const rd_kafka_metadata_t*)> metadata(
        found, rd_kafka_metadata_destroy);
    impl_->away = impl_->unwelcome = false;
    if (metadata->topic_cnt != 1) return "the cluster does not say anything about the topic";
    auto& topic = metadata->topics[0];
    if (topic.err != RD_KAFKA_RESP_ERR_NO_ERROR)
        return fmt::format("topic {}: {}", rd_kafka_topic_name(impl_->topic), rd_kafka_err2str(topic.err));
    for (int i = 0; i < topic.partition_cnt; ++i)
        if (auto& partition = topic.partitions[i]; partition.err != RD_KAFKA_RESP_ERR_NO_ERROR)
            return fmt::format("partition {} of {}: {}", partition.id, rd_kafka_topic_name(impl_->topic),
                               rd_kafka_err2str(partition.err));
    return {};
}

Producer::Put Producer::put(const Message& message, std::size_t item, Report& refusal) {
    std::array<rd_kafka_vu_t, 9> parts{};
    std::size_t count = 0;
    auto add = [&](rd_kafka_vtype_t type) -> auto& {
        parts[count].vtype = type;
        return parts[count++].u;
    };
    auto add_memory = [&](rd_kafka_vtype_t type, std::string_view bytes) {
        add(type).mem = {const_cast<char*>(bytes.data()), bytes.size()};  // only read
    };
    auto add_header = [&](const char* name, std::string_view value) {
        add(RD_KAFKA_VTYPE_HEADER).header = {name, value.data(), static_cast<ssize_t>(value.size())};
    };
    add(RD_KAFKA_VTYPE_RKT).rkt = impl_->topic;
    add(RD_KAFKA_VTYPE_MSGFLAGS).i = RD_KAFKA_MSG_F_COPY;
    add(RD_KAFKA_VTYPE_OPAQUE).ptr = as_opaque(item);
    add_memory(RD_KAFKA_VTYPE_VALUE, message.value);
    if (!message.key.empty()) add_memory(RD_KAFKA_VTYPE_KEY, message.key);
    add_header("id", message.id);
    add_header("type", message.type);
    add_header("schema", message.schema);
    add_header("content-type", message.content_type);
    std::unique_ptr<rd_kafka_error_t, void (*)(rd_kafka_error_t*)> error(
        rd_kafka_produceva(impl_->handle, parts.data(), count), rd_kafka_error_destroy);
    if (!error) {
        ++impl_->unreported;
        return Put::taken;
    }
    auto code = rd_kafka_error_code(error.get());
    if (code == RD_KAFKA_RESP_ERR__QUEUE_FULL) return Put::full;
    refusal = report_of(item, code);
    return Put::refused;
}

std::size_t Producer::unreported() const {
    return impl_->unreported;
}

void Producer::serve(std::chrono::milliseconds wait, std::vector<Report>& reports) {
    // Unlike a poll, a flush does not wait for more messages to send with the first.
    auto milliseconds = static_cast<int>(wait.count());
    if (impl_->unreported > 0)
        rd_kafka_flush(impl_->handle, milliseconds);
    else
        rd_kafka_poll(impl_->handle, milliseconds);
    std::ranges::move(impl_->reports, std::back_inserter(reports));
    impl_->reports.clear();
}

void Producer::give_up(std::vector<Report>& reports) {
    constexpr auto moment = 20ms;
    rd_kafka_purge(impl_->handle,
                   RD_KAFKA_PURGE_F_QUEUE | RD_KAFKA_PURGE_F_INFLIGHT | RD_KAFKA_PURGE_F_NON_BLOCKING);
    serve(moment, reports);  // a thread that hangs in the resolver reports later: nobody waits for it
}

bool Producer::away() const {
    return impl_->away;
}

bool Producer::unwelcome() const {
    return impl_->unwelcome;
}

std::string Producer::last_error() const {
    return impl_->last_error;
}

}  // namespace gantry::sinks::kafka
