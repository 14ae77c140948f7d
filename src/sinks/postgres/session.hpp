#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <tl/expected.hpp>

#include "base/error.hpp"
#include "sink/sink.hpp"

// One connection to a PostgreSQL server. All that knows libpq is behind this header.
namespace gantry::sinks::postgres {

// What the server, or the way to it, says went wrong.
struct Failure {
    std::string text;           // one line; the server's words are in it
    std::string sqlstate = {};  // five characters; empty: the connection failed, or patience was over
    std::string routine = {};   // where in the server: tells apart what shares an SQLSTATE
};
template <class T>
using Answer = tl::expected<T, Failure>;

using Row = std::vector<std::optional<std::string>>;
using Rows = std::vector<Row>;

// libpq's keywords and their values: {"user", "gantry"}.
using Parameters = std::vector<std::pair<std::string, std::string>>;

// The parts of postgres://user@host:port/db. No part of a URL that it refuses is in the error.
Result<Parameters> parse_url(const std::string& url);

// Every call returns when patience is over. What was under way then is given up together with the
// connection: only the server knows how it ended.
class Session {
public:
    Session();
    ~Session();
    Session(Session&&) noexcept;
    Session& operator=(Session&&) noexcept;

    // Host names must have been resolved ("hostaddr"), or libpq waits for the resolver without patience.
    Answer<void> connect(const Parameters& parameters, const sink::Patience& patience);
    void close();
    bool connected() const;
    // Takes what the server has sent by itself: afterwards connected() knows whether it has hung up.
    void look();

    // One or several statements; the rows of the last one.
    Answer<Rows> run(const std::string& sql, const sink::Patience& patience);
    // Done only if the server says COMMIT: in a transaction that has failed it says ROLLBACK, and no error.
    Answer<void> commit(const sink::Patience& patience);
    // One statement with $1, $2 …
    Answer<Rows> ask(const std::string& sql, std::span<const std::string> values,
                     const sink::Patience& patience);
    // Statements of which the last is a COPY … FROM STDIN. `more` appends the next piece of the data; false:
    // that was the last one.
    Answer<void> copy_in(const std::string& sql, const std::function<bool(std::string&)>& more,
                         const sink::Patience& patience);

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace gantry::sinks::postgres
