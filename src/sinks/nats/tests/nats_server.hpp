#pragma once
#include <arpa/inet.h>
#include <nats/nats.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "sinks/nats/nats_sink.hpp"
#include "testkit/eventually.hpp"
#include "testkit/process.hpp"
#include "testkit/sink_suite.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::sinks::nats {
extern const sink::Kind kind;
}

namespace gantry::sinks::nats::tests {

using namespace std::chrono_literals;
using testkit::eventually;

// Below the range from which the system takes ports for connections: nobody takes it while the server is
// down.
inline std::uint16_t free_port() {
    static std::minstd_rand random{std::random_device{}()};
    for (int tries = 0; tries < 1000; ++tries) {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(static_cast<std::uint16_t>(10'000 + random() % 20'000));
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        bool free = bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
        close(fd);
        if (free) return ntohs(address.sin_port);
    }
    ADD_FAILURE() << "no free port";
    return 0;
}

// A client beside the sink, for one question after the other.
class Client {
public:
    explicit Client(std::uint16_t port, const std::string& user = {}, const std::string& password = {}) {
        natsOptions* options = nullptr;
        natsOptions_Create(&options);
        natsOptions_SetURL(options, fmt::format("nats://127.0.0.1:{}", port).c_str());
        natsOptions_SetTimeout(options, 1000);
        natsOptions_SetAllowReconnect(options, false);
        if (!user.empty()) natsOptions_SetUserInfo(options, user.c_str(), password.c_str());
        if (natsConnection_Connect(&connection_, options) == NATS_OK) {
            jsOptions wishes;
            jsOptions_Init(&wishes);
            wishes.Wait = 1000;
            natsConnection_JetStream(&stream_, connection_, &wishes);
        }
        natsOptions_Destroy(options);
    }
    ~Client() {
        jsCtx_Destroy(stream_);
        natsConnection_Destroy(connection_);
    }
    Client(const Client&) = delete;
    Client& operator=(const Client&) = delete;

    // JetStream answers.
    bool ready() const {
        jsAccountInfo* info = nullptr;
        bool there = stream_ != nullptr && js_GetAccountInfo(&info, stream_, nullptr, nullptr) == NATS_OK;
        jsAccountInfo_Destroy(info);
        return there;
    }
    struct Stream {
        std::uint64_t last = 0;
        std::chrono::nanoseconds window{};
        std::vector<std::string> subjects;
        std::int64_t replicas = 0, followers = 0;
        std::chrono::nanoseconds max_age{};
    };
    std::optional<Stream> stream(const char* name) const {
        jsStreamInfo* info = nullptr;
        if (stream_ == nullptr || js_GetStreamInfo(&info, stream_, name, nullptr, nullptr) != NATS_OK)
            return {};
        Stream out{.last = info->State.LastSeq,
                   .window = std::chrono::nanoseconds(info->Config->Duplicates),
                   .subjects = {},
                   .replicas = info->Config->Replicas,
                   .max_age = std::chrono::nanoseconds(info->Config->MaxAge)};
        for (int i = 0; i < info->Config->SubjectsLen; ++i)
            out.subjects.emplace_back(info->Config->Subjects[i]);
        for (int i = 0; info->Cluster != nullptr && i < info->Cluster->ReplicasLen; ++i)
            out.followers += info->Cluster->Replicas[i]->Current ? 1 : 0;
        jsStreamInfo_Destroy(info);
        return out;
    }
    // Makes a stream; `change` has the last word on how.
    template <class Change>
    void add(const char* name, const char* subject, Change change) const {
        jsStreamConfig config;
        jsStreamConfig_Init(&config);
        config.Name = name;
        config.Subjects = &subject;
        config.SubjectsLen = 1;
        config.Duplicates = std::chrono::nanoseconds(2h).count();
        change(config);
        jsErrCode code{};
        EXPECT_EQ(js_AddStream(nullptr, stream_, &config, nullptr, &code), NATS_OK) << code;
    }
    void remove(const char* name) const {
        EXPECT_EQ(js_DeleteStream(stream_, name, nullptr, nullptr), NATS_OK);
    }
    struct Stored {
        std::string subject, id, payload;
    };
    std::optional<Stored> message(const char* stream_name, std::uint64_t sequence) const {
        natsMsg* message = nullptr;
        if (js_GetMsg(&message, stream_, stream_name, sequence, nullptr, nullptr) != NATS_OK) return {};
        const char* id = "";
        natsMsgHeader_Get(message, "Nats-Msg-Id", &id);
        Stored out{
            natsMsg_GetSubject(message), id,
            std::string(natsMsg_GetData(message), static_cast<std::size_t>(natsMsg_GetDataLength(message)))};
        natsMsg_Destroy(message);
        return out;
    }

private:
    natsConnection* connection_ = nullptr;
    jsCtx* stream_ = nullptr;
};

// A server of the test's own.
class NatsServer {
public:
    // `extra`: more lines of its configuration; "DIR" in them is its directory.
    explicit NatsServer(std::string extra = {}) : port_(free_port()), extra_(std::move(extra)) {
        for (auto at = extra_.find("DIR"); at != std::string::npos; at = extra_.find("DIR"))
            extra_.replace(at, 3, dir_.path());
    }
    void launch() {
        testkit::write_file(
            dir_.path() + "/nats.conf",
            fmt::format("listen: \"127.0.0.1:{}\"\njetstream {{ store_dir: \"{}\", max_file: 1G }}\n{}",
                        port_, dir_.path(), extra_));
        process_.emplace(std::vector<std::string>{"/usr/sbin/nats-server", "-c", dir_.path() + "/nats.conf"},
                         std::vector<std::string>{}, dir_.path() + "/log");
    }
    void start(const std::string& user = {}, const std::string& password = {}) {
        launch();
        ASSERT_TRUE(eventually([&] { return Client(port_, user, password).ready(); }))
            << "nats-server does not start";
    }
    void kill() { process_.reset(); }
    void pause() { process_->signal(SIGSTOP); }
    void resume() { process_->signal(SIGCONT); }
    std::uint16_t port() const { return port_; }
    const std::string& dir() const { return dir_.path(); }

private:
    testkit::TempDir dir_;
    std::uint16_t port_;
    std::string extra_;
    std::optional<testkit::Process> process_;
};

using Given = std::vector<std::pair<std::string, std::string>>;

inline Result<std::unique_ptr<sink::Sink>> try_make(const std::string& url, const Given& given) {
    static testkit::QuietHost host;
    auto settings = Settings::make(kind.settings, given);
    if (!settings) return tl::unexpected(settings.error());
    return kind.make(
        {.name = "stream", .gateway_id = "site-7", .url = url, .settings = *settings, .batch = 1000}, host);
}

inline std::unique_ptr<sink::Sink> make(const std::string& url, const Given& given = {}) {
    auto made = try_make(url, given);
    EXPECT_TRUE(made) << (made ? "" : made.error().text());
    return made ? *std::move(made) : nullptr;
}

inline std::string url_of(std::uint16_t port) {
    return fmt::format("nats://127.0.0.1:{}", port);
}

inline std::size_t count(const sink::Outcome& outcome, sink::Fate fate) {
    return static_cast<std::size_t>(std::ranges::count(outcome.fates, fate));
}

// The ids that a stream holds, read as they come.
class StreamReader {
public:
    std::vector<std::string> ids(const Client& client) {
        auto now = client.stream("GANTRY");
        while (now && read_.size() < now->last) {
            auto message = client.message("GANTRY", read_.size() + 1);
            if (!message) break;
            read_.push_back(message->id);
        }
        return read_;
    }

private:
    std::vector<std::string> read_;
};

// What the suite needs.
class NatsDestination : public testkit::Destination {
public:
    void start() override {
        server_.start();
        client_.emplace(server_.port());
        // Small messages only, so that some can be refused for good.
        if (!client_->stream("GANTRY"))
            client_->add("GANTRY", "gantry.>", [](jsStreamConfig& config) { config.MaxMsgSize = 4000; });
    }
    void kill() override { server_.kill(); }
    std::unique_ptr<sink::Sink> make_sink() override;
    std::vector<std::string> ids() override { return reader_.ids(*client_); }
    bool refuse(const std::string& id) override {
        too_large_.insert(id);
        return true;
    }
    bool idempotent() const override { return true; }

private:
    NatsServer server_;
    std::optional<Client> client_;
    StreamReader reader_;
    std::set<std::string> too_large_;
};

// Makes some events larger than the stream takes.
class Padding : public sink::Sink {
public:
    Padding(std::unique_ptr<sink::Sink> sink, const std::set<std::string>& ids)
        : sink_(std::move(sink)), ids_(ids) {}
    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override {
        std::vector<sink::Item> items(batch.begin(), batch.end());
        for (auto& item : items)
            if (ids_.contains(std::string(item.id))) item.payload = large_;
        return sink_->deliver(items, patience);
    }
    void idle(const sink::Patience& patience) override { sink_->idle(patience); }
    bool connected() const override { return sink_->connected(); }

private:
    std::unique_ptr<sink::Sink> sink_;
    const std::set<std::string>& ids_;
    std::string large_ = std::string(8000, ' ');
};

inline std::unique_ptr<sink::Sink> NatsDestination::make_sink() {
    return std::make_unique<Padding>(make(url_of(server_.port())), too_large_);
}

}  // namespace gantry::sinks::nats::tests
