#include <nats/nats.h>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/sinks/bare_client.hpp"

namespace gantry::bench {

namespace {
constexpr auto subject = "bare.dock-1.events";
constexpr std::int64_t duplicate_window_ns = 3'600'000'000'000, answers_within_ms = 30'000;

void check_nats(natsStatus status, const char* doing) {
    if (status != NATS_OK) throw Failure(fmt::format("bare nats, {}: {}", doing, natsStatus_GetText(status)));
}

// Asynchronous publishing with message ids, completed a batch, into a stream like the sink's.
class BareNats final : public BareClient {
public:
    explicit BareNats(const std::string& url) {
        check_nats(natsConnection_ConnectTo(&connection_, url.c_str()), "connecting");
        check_nats(natsConnection_JetStream(&stream_, connection_, nullptr), "JetStream");
        jsStreamConfig config;
        jsStreamConfig_Init(&config);
        const char* subjects[] = {"bare.>"};
        config.Name = "BARE";
        config.Subjects = subjects;
        config.SubjectsLen = 1;
        config.Duplicates = duplicate_window_ns;
        config.Storage = js_FileStorage;
        check_nats(js_AddStream(nullptr, stream_, &config, nullptr, nullptr), "making the stream");
    }
    ~BareNats() override {
        jsCtx_Destroy(stream_);
        natsConnection_Destroy(connection_);
    }

    void deliver(std::span<const sink::Item> batch) override {
        for (auto& item : batch) {
            jsPubOptions options;
            jsPubOptions_Init(&options);
            std::string id(item.id);
            options.MsgId = id.c_str();
            check_nats(js_PublishAsync(stream_, subject, item.payload.data(),
                                       static_cast<int>(item.payload.size()), &options),
                       "publishing");
        }
        jsPubOptions wait;
        jsPubOptions_Init(&wait);
        wait.MaxWait = answers_within_ms;
        check_nats(js_PublishAsyncComplete(stream_, &wait), "waiting");
        natsMsgList failed{};
        if (js_PublishAsyncGetPendingList(&failed, stream_) == NATS_OK) {
            natsMsgList_Destroy(&failed);
            throw Failure("bare nats: not all was confirmed");
        }
    }

private:
    natsConnection* connection_ = nullptr;
    jsCtx* stream_ = nullptr;
};
}  // namespace

std::unique_ptr<BareClient> bare_nats(const std::string& place) {
    return std::make_unique<BareNats>(place);
}

}  // namespace gantry::bench
