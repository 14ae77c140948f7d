#include "http/server.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/stream_traits.hpp>
#include <boost/beast/http.hpp>
#include <csignal>
#include <thread>
#include <unordered_set>

#include "base/log.hpp"
#include "base/text.hpp"
#include "http/unix_socket.hpp"

namespace gantry::http {

namespace asio = boost::asio;
namespace beast = boost::beast;
using ErrorCode = boost::system::error_code;
using Executor = asio::io_context::executor_type;
using Clock = asio::basic_waitable_timer<std::chrono::steady_clock,
                                         asio::wait_traits<std::chrono::steady_clock>, Executor>;

namespace {

class Connection {
public:
    virtual ~Connection() = default;
    virtual void close() = 0;  // on the I/O thread
};

// What the connections of a server share. Sockets and timers belong to the I/O thread, handlers run on the
// workers.
struct Core {
    Core(Handler handle, Limits limit) : handler(std::move(handle)), limits(limit), workers(limit.workers) {}
    const Handler handler;
    const Limits limits;
    std::unordered_set<Connection*> connections;  // I/O thread
    std::atomic<std::size_t> count = 0;
    asio::io_context io{1};  // both may still hold connections when they are destroyed
    asio::thread_pool workers;
};

// One connection, for any stream: TCP and TLS have the same shape as the Unix socket.
template <class Stream>
class Session final : public Connection, public std::enable_shared_from_this<Session<Stream>> {
public:
    Session(Core& core, Stream stream)
        : core_(core), stream_(std::move(stream)), timer_(core.io.get_executor()) {
        core_.connections.insert(this);
        core_.count = core_.connections.size();
    }
    ~Session() override { leave(); }

    void begin() {
        ErrorCode ignored;
        beast::get_lowest_layer(stream_).non_blocking(true, ignored);
        read();
    }

    void close() override {
        gone_ = true;
        ErrorCode ignored;
        beast::get_lowest_layer(stream_).close(ignored);
        timer_.cancel();
        leave();
    }

private:
    using Message = beast::http::request_parser<beast::http::string_body>;
    using Text = beast::http::response<beast::http::string_body>;
    using Head = beast::http::response<beast::http::empty_body>;

    void leave() {
        core_.connections.erase(this);
        core_.count = core_.connections.size();
    }

    void close_after(std::chrono::milliseconds time) {
        timer_.expires_after(time);
        timer_.async_wait([weak = this->weak_from_this()](const ErrorCode& cancelled) {
            if (auto self = weak.lock(); self && !cancelled) self->close();
        });
    }

    void read() {
        parser_.emplace();
        parser_->header_limit(static_cast<std::uint32_t>(core_.limits.header));
        parser_->body_limit(core_.limits.body);
        close_after(core_.limits.wait);
        beast::http::async_read(stream_, buffer_, *parser_,
                                [self = this->shared_from_this()](const ErrorCode& error, std::size_t) {
                                    self->was_read(error);
                                });
    }

    void was_read(const ErrorCode& error) {
        using Bad = beast::http::error;
        timer_.cancel();
        if (gone_) return;
        if (error == Bad::header_limit)
            return refuse(431, fail_of(fmt::format("the head of the request is longer than {} bytes",
                                                   core_.limits.header)));
        if (error == Bad::body_limit)
            return refuse(413, fail_of(fmt::format("the body is longer than {} bytes", core_.limits.body)));
        if (error == Bad::end_of_stream || error == Bad::partial_message) return close();
        if (error && error.category() == beast::http::make_error_code(Bad::bad_method).category())
            return refuse(400, fail_of(fmt::format("this is not HTTP: {}", error.message())));
        if (error) return close();

        auto& message = parser_->get();
        version_ = message.version();
        keep_ = message.keep_alive();
        head_only_ = message.method() == beast::http::verb::head;
        auto target = parse_target({message.target().data(), message.target().size()});
        if (!target) return refuse(400, target.error());
        auto request = std::make_shared<Request>();
        request->method = std::string(message.method_string());
        request->path = std::move(target->path);
        request->query = std::move(target->query);
        for (auto& field : message)
            request->headers.emplace_back(field.name_string(), field.value());
        request->body = std::move(message.body());
        parser_.reset();
        asio::post(core_.workers, [self = this->shared_from_this(), request = std::move(request)]() mutable {
            auto answer = std::make_shared<Response>();
            if (!self->gone_) *answer = self->handle(*request);
            request.reset();
            back(std::move(self), [answer](Session& session) { session.respond(std::move(*answer)); });
        });
    }

    // From a worker to the I/O thread. The pointer goes with it: a session must not end on a worker.
    template <class Work>
    static void back(std::shared_ptr<Session> self, Work work) {
        auto& io = self->core_.io;
        asio::post(io, [self = std::move(self), work = std::move(work)]() mutable { work(*self); });
    }

    Response handle(const Request& request) {
        try {
            return core_.handler(request);
        } catch (const std::exception& error) {
            log::error("http", "{} {}: {}", printable(request.method), printable(request.path), error.what());
            return refusal(500, {"the gateway failed to answer this: " + std::string(error.what()),
                                 "its log says more; please report it"});
        }
    }

    static Error fail_of(std::string what) { return {std::move(what)}; }

    // The request was not read to its end, so nothing can follow on this connection.
    void refuse(int status, const Error& error) {
        keep_ = false;
        respond(refusal(status, error));
    }

    template <class Reply>
    void fill(Reply& reply, const Response& response) const {
        reply.version(version_);
        reply.result(static_cast<unsigned>(response.status));
        reply.set(beast::http::field::server, "gantry");
        if (!response.content_type.empty())
            reply.set(beast::http::field::content_type, response.content_type);
        for (auto& [name, value] : response.headers)
            reply.insert(name, value);
    }

    void respond(Response response) {
        if (gone_) return;
        if (response.stream) return begin_stream(std::move(response));
        text_.emplace();
        fill(*text_, response);
        text_->keep_alive(keep_);
        if (head_only_) {
            text_->content_length(response.body.size());
        } else {
            text_->body() = std::move(response.body);
            text_->prepare_payload();
        }
        close_after(core_.limits.wait);
        beast::http::async_write(stream_, *text_,
                                 [self = this->shared_from_this()](const ErrorCode& error, std::size_t) {
                                     self->text_.reset();
                                     self->answered(error);
                                 });
    }

    void answered(const ErrorCode& error) {
        timer_.cancel();
        if (gone_) return;
        if (error) return close();
        if (keep_) return read();
        // What the client is still sending is read away for a moment: a close on top of unread bytes could
        // take the answer with it.
        ErrorCode ignored;
        beast::get_lowest_layer(stream_).shutdown(
            std::decay_t<decltype(beast::get_lowest_layer(stream_))>::shutdown_send, ignored);
        close_after(std::min(core_.limits.wait, std::chrono::milliseconds(2000)));
        drain();
    }

    void drain() {
        buffer_.clear();
        stream_.async_read_some(buffer_.prepare(8192),
                                [self = this->shared_from_this()](const ErrorCode& error, std::size_t) {
                                    if (self->gone_) return;
                                    if (error) return self->close();
                                    self->drain();
                                });
    }

    void begin_stream(Response response) {
        keep_ = false;  // the end of a stream ends the connection
        next_ = std::move(response.stream);
        head_.emplace();
        fill(*head_, response);
        head_->keep_alive(false);
        if (version_ >= 11) head_->chunked(true);
        writer_.emplace(*head_);
        close_after(core_.limits.wait);
        beast::http::async_write_header(
            stream_, *writer_, [self = this->shared_from_this()](const ErrorCode& error, std::size_t) {
                self->timer_.cancel();
                if (self->gone_ || error) return self->end_stream();
                if (self->head_only_) return self->answered(error);
                self->watch();
                self->ask();
            });
    }

    // A client that goes away while nothing is sent shows only by the end of its bytes.
    void watch() {
        auto& socket = beast::get_lowest_layer(stream_);
        socket.async_wait(asio::socket_base::wait_read,
                          [self = this->shared_from_this()](const ErrorCode& error) {
                              if (self->gone_ || error) return;
                              char byte = 0;
                              ErrorCode state;
                              auto& from = beast::get_lowest_layer(self->stream_);
                              from.receive(asio::buffer(&byte, 1), asio::socket_base::message_peek, state);
                              if (state && state != asio::error::would_block) self->end_stream();
                          });
    }

    void ask() {
        asking_ = true;
        asio::post(core_.workers, [self = this->shared_from_this()]() mutable {
            auto chunk = std::make_shared<std::string>();
            bool more = false, failed = false;
            try {
                if (!self->gone_) more = self->next_(*chunk);
            } catch (const std::exception& error) {
                log::error("http", "a stream failed: {}", error.what());
                failed = true;
            }
            back(std::move(self),
                 [chunk, more, failed](Session& session) { session.got(*chunk, more, failed); });
        });
    }

    void got(std::string& chunk, bool more, bool failed) {
        asking_ = false;
        if (gone_ || failed) return end_stream();
        if (!chunk.empty()) return send_chunk(std::move(chunk), more);
        if (!more) return send_end();
        timer_.expires_after(core_.limits.poll);
        timer_.async_wait([self = this->shared_from_this()](const ErrorCode& cancelled) {
            if (self->gone_ || cancelled) return self->end_stream();
            self->ask();
        });
    }

    void send_chunk(std::string chunk, bool more) {
        chunk_ = std::move(chunk);
        close_after(core_.limits.wait);
        auto sent = [self = this->shared_from_this(), more](const ErrorCode& error, std::size_t) {
            self->timer_.cancel();
            if (self->gone_ || error) return self->end_stream();
            if (more) return self->ask();
            self->send_end();
        };
        if (version_ >= 11) {
            asio::async_write(stream_, beast::http::make_chunk(asio::buffer(chunk_)), std::move(sent));
        } else {
            asio::async_write(stream_, asio::buffer(chunk_), std::move(sent));
        }
    }

    void send_end() {
        next_ = nullptr;
        if (version_ < 11) return answered({});
        close_after(core_.limits.wait);
        asio::async_write(stream_, beast::http::make_chunk_last(),
                          [self = this->shared_from_this()](const ErrorCode& error, std::size_t) {
                              self->answered(error);
                          });
    }

    void end_stream() {
        if (!gone_) close();
        if (!asking_) next_ = nullptr;  // else when the worker has come back from it
    }

    Core& core_;
    Stream stream_;
    Clock timer_;
    beast::flat_buffer buffer_{64 * 1024};
    std::optional<Message> parser_;
    std::optional<Text> text_;
    std::optional<Head> head_;
    std::optional<beast::http::response_serializer<beast::http::empty_body>> writer_;
    std::function<bool(std::string&)> next_;
    std::string chunk_;
    unsigned version_ = 11;
    bool keep_ = false, head_only_ = false, asking_ = false;
    std::atomic<bool> gone_ = false;
};

using Protocol = asio::local::stream_protocol;
using Socket = asio::basic_stream_socket<Protocol, Executor>;
using Acceptor = asio::basic_socket_acceptor<Protocol, Executor>;

constexpr auto out_of_files_pause = std::chrono::seconds(1);

// For those who get no session.
void turn_away(int fd, int status, std::string_view reason, const Error& error) {
    auto body = refusal(status, error).body;
    auto text = fmt::format(
        "HTTP/1.1 {} {}\r\nContent-Type: application/problem+json\r\nContent-Length: {}\r\nConnection: "
        "close\r\n\r\n{}",
        status, reason, body.size(), body);
    (void)!::send(fd, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

class UnixServer final : public Server {
public:
    UnixServer(UnixListener listener, Handler handler, Limits limits)
        : listener_(std::move(listener)),
          core_(std::move(handler), limits),
          acceptor_(core_.io.get_executor()),
          timer_(core_.io.get_executor()) {}

    ~UnixServer() override {
        asio::post(core_.io, [this] {
            ErrorCode ignored;
            acceptor_.close(ignored);
            timer_.cancel();
            for (auto connections = core_.connections; auto* each : connections)
                each->close();
            core_.workers.stop();  // what has not begun is not begun
        });
        core_.workers.join();
        core_.io.stop();
        thread_.join();
    }

    Result<void> begin() {
        ErrorCode error;
        acceptor_.assign(Protocol(), listener_.release(), error);
        if (error) return fail(fmt::format("cannot watch the socket: {}", error.message()));
        accept();
        thread_ = std::thread([this] {
            pthread_setname_np(pthread_self(), "gantry-http");
            auto work = asio::make_work_guard(core_.io);
            core_.io.run();
        });
        return {};
    }

    std::size_t connections() const override { return core_.count; }

private:
    void accept() {
        acceptor_.async_accept([this](const ErrorCode& error, Socket socket) {
            if (!acceptor_.is_open()) return;
            if (error && error != asio::error::connection_aborted) return pause(error);
            if (!error) take(std::move(socket));
            accept();
        });
    }

    void take(Socket socket) {
        starved_ = false;
        int fd = socket.native_handle();
        if (!is_trusted_peer(fd)) {
            return turn_away(fd, 403, "Forbidden",
                             {"this socket serves the user that runs the gateway, and root"});
        }
        if (core_.connections.size() >= core_.limits.connections) {
            return turn_away(fd, 503, "Service Unavailable",
                             {fmt::format("{} connections are open already", core_.limits.connections),
                              "close some, or try again"});
        }
        std::make_shared<Session<Socket>>(core_, std::move(socket))->begin();
    }

    void pause(const ErrorCode& error) {
        if (!starved_)
            log::warn("http", "cannot accept connections: {}; trying again every second", error.message());
        starved_ = true;
        timer_.expires_after(out_of_files_pause);
        timer_.async_wait([this](const ErrorCode& cancelled) {
            if (!cancelled && acceptor_.is_open()) accept();
        });
    }

    UnixListener listener_;
    Core core_;
    Acceptor acceptor_;
    Clock timer_;
    std::thread thread_;
    bool starved_ = false;
};

}  // namespace

Result<std::unique_ptr<Server>> Server::open(const std::filesystem::path& path, Handler handler,
                                             Limits limits) {
    auto listener = UnixListener::open(path);
    if (!listener) return tl::unexpected(listener.error());
    // Signals belong to the threads of the program, not to those made here.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    auto server = std::make_unique<UnixServer>(std::move(*listener), std::move(handler), limits);
    auto begun = server->begin();
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    if (!begun) return tl::unexpected(begun.error());
    return server;
}

}  // namespace gantry::http
