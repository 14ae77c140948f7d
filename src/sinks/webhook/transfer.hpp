#pragma once
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "sink/sink.hpp"

// HTTP as this sink needs it. transfer.cpp alone knows libcurl.
namespace gantry::sinks::webhook {

struct Connection {
    std::string url;
    std::string ca, certificate, key;  // files; empty: the system's CAs, no certificate
    bool insecure = false;             // any certificate will do
    std::string proxy;                 // empty: none, whatever the environment says
    std::chrono::milliseconds connect_timeout{10'000};
};

struct Request {
    std::string_view method = "POST";
    std::string url = {};                   // empty: that of the connection
    std::vector<std::string> headers = {};  // "Name: value"
    std::string_view body = {};
};

struct Answer {
    enum class End : std::uint8_t { answered, failed, out_of_time, stopped };
    End end = End::failed;
    std::string error = {};  // why it failed
    // The connection broke while the request was under way: a server may do that to a body too large for it.
    bool broken = false;
    bool untrusted = false;  // the server's certificate was not believed

    // If answered. All of it is the peer's.
    int status = 0;
    std::string reason = {};       // "Too Many Requests"
    std::string retry_after = {};  // the header's value
    std::string date = {};         // likewise
    std::string redirect = {};     // the whole URL that Location means
    std::string body = {};         // its beginning
};

// One exchange at a time, over one connection that stays open between them.
class Transfer {
public:
    explicit Transfer(Connection connection);
    ~Transfer();
    Answer exchange(const Request& request, const sink::Patience& patience);

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

struct Url {
    std::string scheme, host;   // in small letters
    bool has_password = false;  // or a user name
    std::string shown = {};     // for people: without user, password, query and fragment
};
std::optional<Url> parse_url(const std::string& text);

std::optional<Wall> parse_http_date(const std::string& text);

}  // namespace gantry::sinks::webhook
