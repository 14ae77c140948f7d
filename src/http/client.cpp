#include "http/client.hpp"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>

#include "base/time.hpp"
#include "http/unix_socket.hpp"

namespace gantry::http {

namespace asio = boost::asio;
namespace beast = boost::beast;
using ErrorCode = boost::system::error_code;

namespace {

constexpr std::size_t most_in_memory = 1024 * 1024 * 1024;

// One exchange on a small event loop of its own, so that it can end by time.
class Exchange {
public:
    Exchange(std::filesystem::path path, std::chrono::milliseconds timeout, const OnChunk& on_chunk)
        : path_(std::move(path)), timeout_(timeout), on_chunk_(on_chunk), socket_(io_) {
        parser_.header_limit(64 * 1024);
        parser_.body_limit(boost::none);
    }

    Result<Response> run(int fd, std::string_view method, std::string_view target, std::string_view body) {
        auto end = std::chrono::steady_clock::now() + timeout_;
        socket_.assign(asio::local::stream_protocol(), fd);
        request_.method_string(beast::string_view(method.data(), method.size()));
        request_.target(beast::string_view(target.data(), target.size()));
        request_.version(11);
        request_.set(beast::http::field::host, "gantry");
        request_.set(beast::http::field::connection, "close");
        if (!body.empty()) request_.set(beast::http::field::content_type, "application/json");
        request_.body() = body;
        request_.prepare_payload();
        if (method == "HEAD") parser_.skip(true);
        // A server that refuses early may have answered although it did not take the whole request.
        beast::http::async_write(socket_, request_, [this](const ErrorCode&, std::size_t) { read_head(); });
        while (!over_) {
            if (streaming_) {
                io_.run_one();
            } else if (io_.run_one_until(end) == 0) {
                return fail(fmt::format("the gateway in {} did not answer within {}", folder(),
                                        to_text(std::chrono::microseconds(timeout_))),
                            "it may be overloaded or suspended; look at its log");
            }
        }
        if (error_ && !stopped_) {
            return fail(
                fmt::format("the gateway in {} closed the connection before its answer was whole ({})",
                            folder(), error_.message()),
                "its log may say why");
        }
        return std::move(response_);
    }

private:
    std::string folder() const {
        auto folder = path_.parent_path().string();
        return folder.empty() ? "." : folder;
    }

    void read_head() {
        beast::http::async_read_header(
            socket_, buffer_, parser_, [this](const ErrorCode& error, std::size_t) {
                if (error) return finish(error);
                auto& head = parser_.get();
                response_.status = static_cast<int>(head.result_int());
                response_.content_type = std::string(head[beast::http::field::content_type]);
                for (auto& field : head)
                    response_.headers.emplace_back(field.name_string(), field.value());
                streaming_ = on_chunk_ && response_.status / 100 == 2;
                read_body();
            });
    }

    void read_body() {
        if (parser_.is_done()) return finish({});
        parser_.get().body().data = piece_;
        parser_.get().body().size = sizeof piece_;
        beast::http::async_read_some(socket_, buffer_, parser_, [this](const ErrorCode& error, std::size_t) {
            std::string_view part(piece_, sizeof piece_ - parser_.get().body().size);
            if (!part.empty() && !take(part)) return;
            if (error && error != beast::http::error::need_buffer) return finish(error);
            read_body();
        });
    }

    bool take(std::string_view part) {
        if (streaming_) {
            if (on_chunk_(part)) return true;
            stopped_ = true;
            finish({});
            return false;
        }
        response_.body += part;
        if (response_.body.size() <= most_in_memory) return true;
        finish(beast::http::error::body_limit);
        return false;
    }

    void finish(const ErrorCode& error) {
        error_ = error;
        over_ = true;
    }

    std::filesystem::path path_;
    std::chrono::milliseconds timeout_;
    const OnChunk& on_chunk_;
    asio::io_context io_{1};
    asio::local::stream_protocol::socket socket_;
    beast::flat_buffer buffer_{128 * 1024};
    beast::http::request<beast::http::string_body> request_;
    beast::http::response_parser<beast::http::buffer_body> parser_;
    char piece_[16 * 1024];
    Response response_;
    ErrorCode error_;
    bool over_ = false, streaming_ = false, stopped_ = false;
};

}  // namespace

Result<Response> request(const std::filesystem::path& path, std::string_view method, std::string_view target,
                         std::string_view body, std::chrono::milliseconds timeout, const OnChunk& on_chunk) {
    auto fd = connect_unix(path, timeout);
    if (!fd) return tl::unexpected(fd.error());
    Exchange exchange(path, timeout, on_chunk);
    return exchange.run(*fd, method, target, body);
}

}  // namespace gantry::http
