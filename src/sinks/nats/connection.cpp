#include "sinks/nats/connection.hpp"

#include <nats/nats.h>

#include <condition_variable>
#include <cstdlib>
#include <map>
#include <mutex>
#include <unordered_map>
#include <utility>

#include <fmt/format.h>

#include "base/text.hpp"
#include "base/time.hpp"
#include "sinks/nats/subjects.hpp"

namespace gantry::sinks::nats {

namespace {
constexpr std::int64_t connect_ms = 5000, request_ms = 5000, write_ms = 5000, ping_ms = 10'000;

std::int64_t nanoseconds(std::chrono::seconds duration) {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(duration).count();
}

// Of the last call on this thread.
std::string last_error(natsStatus status) {
    auto* more = nats_GetLastError(nullptr);
    std::string text = more != nullptr && *more != '\0' ? more : natsStatus_GetText(status);
    return printable(text);
}

// Answers that mean the message and nothing else.
bool is_about_message(jsErrCode code) {
    constexpr int header_exceeds_maximum = 10097;  // the library has no name for it
    return code == JSStreamMessageExceedsMaximumErr || static_cast<int>(code) == header_exceeds_maximum;
}

struct OptionsCloser {
    void operator()(natsOptions* options) const { natsOptions_Destroy(options); }
};
struct StreamInfoCloser {
    void operator()(jsStreamInfo* info) const { jsStreamInfo_Destroy(info); }
};
using StreamInfo = std::unique_ptr<jsStreamInfo, StreamInfoCloser>;
}  // namespace

struct Connection::Client {
    Client() = default;
    ~Client() {
        jsCtx_Destroy(stream);
        natsConnection_Destroy(connection);
    }
    Client(const Client&) = delete;
    Client& operator=(const Client&) = delete;
    natsConnection* connection = nullptr;
    jsCtx* stream = nullptr;
};

// What the library's threads write to. They may do so a moment after a connection was destroyed, so they know
// it by its number only.
struct Connection::Box {
    std::mutex mutex;
    std::condition_variable changed;
    std::unordered_map<const natsMsg*, std::size_t> in_flight;  // items by their message
    std::vector<Answer> answers;
    std::string forbidden;
};

struct Connection::Callbacks {
    struct Registry {
        std::mutex mutex;
        std::uintptr_t last = 0;
        std::map<std::uintptr_t, std::weak_ptr<Box>> boxes;
    };
    // Never destroyed: the library's threads outlive main().
    static Registry& registry() {
        static auto* all = new Registry;
        return *all;
    }
    static std::uintptr_t add(const std::shared_ptr<Box>& box) {
        std::lock_guard lock(registry().mutex);
        registry().boxes[++registry().last] = box;
        return registry().last;
    }
    static void remove(std::uintptr_t number) {
        std::lock_guard lock(registry().mutex);
        registry().boxes.erase(number);
    }
    static std::shared_ptr<Box> find(void* number) {
        std::lock_guard lock(registry().mutex);
        auto found = registry().boxes.find(reinterpret_cast<std::uintptr_t>(number));
        return found == registry().boxes.end() ? nullptr : found->second.lock();
    }

    static void answered(jsCtx*, natsMsg* message, jsPubAck* accepted, jsPubAckErr* refused, void* number) {
        if (auto box = find(number)) {
            std::lock_guard lock(box->mutex);
            if (auto found = box->in_flight.find(message); found != box->in_flight.end()) {
                auto& answer = box->answers.emplace_back();
                answer.item = found->second;
                answer.accepted = accepted != nullptr;
                if (refused != nullptr) {
                    answer.rejected = is_about_message(refused->ErrCode);
                    answer.why = refused->Err == NATS_NO_RESPONDERS ? "no stream there takes the subject"
                                 : refused->ErrText != nullptr      ? printable(refused->ErrText)
                                                                    : natsStatus_GetText(refused->Err);
                }
                box->in_flight.erase(found);
                box->changed.notify_all();
            }
        }
        natsMsg_Destroy(message);
    }

    static void went_wrong(natsConnection* connection, natsSubscription*, natsStatus status, void* number) {
        auto box = find(number);
        if (box == nullptr || status != NATS_NOT_PERMITTED) return;
        const char* text = nullptr;
        natsConnection_GetLastError(connection, &text);
        std::lock_guard lock(box->mutex);
        box->forbidden = printable(text != nullptr && *text != '\0' ? text : natsStatus_GetText(status));
        box->changed.notify_all();
    }
};

void start_library() {
    static std::once_flag once;
    std::call_once(once, [] {
        nats_Open(-1);
        natsOptions* options = nullptr;  // TLS is initialised when it is first asked for
        if (natsOptions_Create(&options) == NATS_OK) natsOptions_SetSecure(options, true);
        natsOptions_Destroy(options);
    });
}

Connection::Connection()
    : box_(std::make_shared<Box>()), box_number_(Callbacks::add(box_)), client_(std::make_unique<Client>()) {}

Connection::~Connection() {
    Callbacks::remove(box_number_);
}

Result<std::unique_ptr<Connection>> Connection::open(const Access& access) {
    std::string why;
    for (auto& server : access.servers) {
        std::unique_ptr<Connection> out(new Connection);
        auto connected = out->connect(access, server);
        if (connected) connected = out->ready_stream(access.stream);
        if (connected) {
            out->server_ = server;
            return out;
        }
        if (!why.empty()) why += "; ";
        why += fmt::format("{}: {}", server.text(), connected.error().text());
    }
    return fail(why);
}

Result<void> Connection::connect(const Access& access, const sink::ServerAddress& server) {
    natsOptions* made = nullptr;
    auto status = natsOptions_Create(&made);
    std::unique_ptr<natsOptions, OptionsCloser> options(made);
    auto also = [&](auto call, auto... arguments) {
        if (status == NATS_OK) status = call(options.get(), arguments...);
    };
    auto* number = reinterpret_cast<void*>(box_number_);
    auto url = fmt::format("nats://{}", server.text());
    also(natsOptions_SetURL, url.c_str());
    also(natsOptions_SetName, access.name.c_str());
    also(natsOptions_SetTimeout, connect_ms);
    also(natsOptions_SetWriteDeadline, write_ms);
    also(natsOptions_SetPingInterval, ping_ms);
    also(natsOptions_SetMaxPingsOut, 2);
    also(natsOptions_SetAllowReconnect, false);
    also(natsOptions_SetErrorHandler, &Callbacks::went_wrong, number);
    if (!access.user.empty()) also(natsOptions_SetUserInfo, access.user.c_str(), access.password.c_str());
    if (!access.token.empty()) also(natsOptions_SetToken, access.token.c_str());
    if (!access.credentials.empty())
        also(natsOptions_SetUserCredentialsFromFiles, access.credentials.c_str(), nullptr);
    if (access.tls) {
        also(natsOptions_SetSecure, true);
        if (!access.tls_ca.empty()) also(natsOptions_LoadCATrustedCertificates, access.tls_ca.c_str());
        if (!access.tls_cert.empty())
            also(natsOptions_LoadCertificatesChain, access.tls_cert.c_str(), access.tls_key.c_str());
        if (access.tls_insecure)
            also(natsOptions_SkipServerVerification, true);
        else
            also(natsOptions_SetExpectedHostname, server.host.c_str());
    }
    if (status == NATS_OK) status = natsConnection_Connect(&client_->connection, options.get());
    if (status != NATS_OK) {
        bool rights = status == NATS_CONNECTION_AUTH_FAILED || status == NATS_NOT_PERMITTED;
        return fail(last_error(status),
                    rights ? "check user and password_file, token_file or credentials" : "");
    }
    jsOptions wishes;
    jsOptions_Init(&wishes);
    wishes.Wait = request_ms;
    wishes.PublishAsync.AckHandler = &Callbacks::answered;
    wishes.PublishAsync.AckHandlerClosure = number;
    status = natsConnection_JetStream(&client_->stream, client_->connection, &wishes);
    if (status != NATS_OK) return fail(last_error(status));
    return {};
}

static Result<void> check_stream(const jsStreamConfig& there, const StreamPlan& plan) {
    auto refuse = [&](std::string what, std::string hint) {
        return fail(fmt::format("the stream {} {}", printable(plan.name), what), std::move(hint));
    };
    bool takes = false;
    for (int i = 0; i < there.SubjectsLen; ++i)
        takes = takes || covers(there.Subjects[i], plan.wanted);
    if (!takes)
        return refuse(fmt::format("does not take {}", plan.wanted),
                      fmt::format("add the subject, or set stream to another one"));
    auto window =
        std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::nanoseconds(there.Duplicates));
    if (window < plan.duplicate_window)
        return refuse(fmt::format("drops doubles for {} only", to_text(window)),
                      fmt::format("nats stream edit {} --dupe-window={}s", printable(plan.name),
                                  plan.duplicate_window.count()));
    if (there.NoAck) return refuse("confirms nothing (no_ack)", "set stream to another one");
    if (there.Sealed) return refuse("is sealed", "set stream to another one");
    if (there.Replicas < plan.replicas)
        return refuse(fmt::format("has {} replicas, not {}", there.Replicas, plan.replicas),
                      fmt::format("nats stream edit {} --replicas={}", printable(plan.name), plan.replicas));
    return {};
}

Result<void> Connection::ready_stream(const StreamPlan& plan) {
    stream_name_ = plan.name;
    jsErrCode code{};
    jsStreamInfo* found = nullptr;
    auto status = js_GetStreamInfo(&found, client_->stream, plan.name.c_str(), nullptr, &code);
    StreamInfo there(found);
    if (status == NATS_OK) return check_stream(*there->Config, plan);
    auto no_jetstream = [&] {
        return fail("the server has no JetStream, or none that is ready", "start it with -js");
    };
    if (code == JSNotEnabledErr || code == JSNotEnabledForAccountErr || status == NATS_NO_RESPONDERS)
        return no_jetstream();
    if (code != JSStreamNotFoundErr && status != NATS_NOT_FOUND)
        return fail(fmt::format("the stream {} cannot be looked up: {}", printable(plan.name),
                                forbidden() ? trouble() : last_error(status)));
    jsStreamConfig wanted;
    jsStreamConfig_Init(&wanted);
    std::vector<const char*> subjects;
    for (auto& each : plan.subjects)
        subjects.push_back(each.c_str());
    wanted.Name = plan.name.c_str();
    wanted.Subjects = subjects.data();
    wanted.SubjectsLen = static_cast<int>(subjects.size());
    wanted.Duplicates = nanoseconds(plan.duplicate_window);
    wanted.MaxAge = nanoseconds(plan.max_age);
    wanted.Replicas = plan.replicas;
    wanted.Storage = plan.in_memory ? js_MemoryStorage : js_FileStorage;
    jsStreamInfo* created = nullptr;
    status = js_AddStream(&created, client_->stream, &wanted, nullptr, &code);
    StreamInfo made(created);
    if (status == NATS_OK) return {};
    return fail(fmt::format("the stream {} cannot be made: {}", printable(plan.name),
                            forbidden() ? trouble() : last_error(status)),
                code == JSStreamSubjectOverlapErr
                    ? "another stream takes these subjects: set stream to its name"
                    : "");
}

bool Connection::alive() const {
    return natsConnection_Status(client_->connection) == NATS_CONN_STATUS_CONNECTED;
}

bool Connection::forbidden() const {
    std::lock_guard lock(box_->mutex);
    return !box_->forbidden.empty();
}

std::string Connection::trouble() const {
    {
        std::lock_guard lock(box_->mutex);
        if (!box_->forbidden.empty()) return box_->forbidden;
    }
    const char* text = nullptr;
    natsConnection_GetLastError(client_->connection, &text);
    return text != nullptr && *text != '\0' ? printable(text) : "the server ended the connection";
}

Connection::Handed Connection::publish(const std::string& subject, std::string_view id,
                                       std::string_view payload, std::size_t item, std::string& refusal) {
    natsMsg* message = nullptr;
    auto status =
        natsMsg_Create(&message, subject.c_str(), nullptr, payload.data(), static_cast<int>(payload.size()));
    if (status != NATS_OK) {
        refusal = last_error(status);
        return Handed::refused;
    }
    {
        std::lock_guard lock(box_->mutex);
        box_->in_flight[message] = item;
    }
    auto* key = message;
    std::string message_id(id);
    jsPubOptions options;
    jsPubOptions_Init(&options);
    options.MsgId = message_id.c_str();
    options.ExpectStream = stream_name_.c_str();
    status = js_PublishMsgAsync(client_->stream, &message, &options);
    if (status == NATS_OK) return Handed::sent;
    {
        std::lock_guard lock(box_->mutex);
        box_->in_flight.erase(key);
    }
    natsMsg_Destroy(message);
    if (status != NATS_MAX_PAYLOAD && status != NATS_INVALID_SUBJECT) return Handed::lost;
    refusal = status == NATS_MAX_PAYLOAD
                  ? fmt::format("its {} bytes are more than the {} that the server takes in a message",
                                payload.size(), natsConnection_GetMaxPayload(client_->connection))
                  : last_error(status);
    return Handed::refused;
}

std::size_t Connection::in_flight() const {
    std::lock_guard lock(box_->mutex);
    return box_->in_flight.size();
}

bool Connection::settled() const {
    std::lock_guard lock(box_->mutex);
    return box_->in_flight.empty() && box_->answers.empty();
}

std::vector<Answer> Connection::answers(std::chrono::milliseconds at_most) {
    std::unique_lock lock(box_->mutex);
    box_->changed.wait_for(lock, at_most, [&] { return !box_->answers.empty() || !box_->forbidden.empty(); });
    return std::exchange(box_->answers, {});
}

std::vector<sink::ServerAddress> Connection::servers() const {
    std::vector<sink::ServerAddress> out = {server_};
    char** urls = nullptr;
    int count = 0;
    if (natsConnection_GetServers(client_->connection, &urls, &count) != NATS_OK) return out;
    for (int i = 0; i < count; ++i) {
        if (auto server = sink::parse_server_url(urls[i], server_.port)) out.push_back(*std::move(server));
        std::free(urls[i]);
    }
    std::free(urls);
    return out;
}

}  // namespace gantry::sinks::nats
