#include "sinks/postgres/session.hpp"

#include <libpq-fe.h>
#include <poll.h>

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"

namespace gantry::sinks::postgres {

namespace {

struct FreeResult {
    void operator()(PGresult* result) const { PQclear(result); }
};
using ResultHandle = std::unique_ptr<PGresult, FreeResult>;

// libpq's texts have several lines, indented by tabs, and end in one.
std::string one_line(std::string_view text) {
    std::string out;
    for (char c : trimmed(text)) {
        bool blank = c == '\n' || c == '\t' || c == '\r' || c == ' ';
        if (!blank)
            out += c;
        else if (!out.ends_with(' '))
            out += ' ';
    }
    return out;
}

std::string field(const PGresult* result, int code) {
    const char* text = PQresultErrorField(result, code);
    return text == nullptr ? std::string() : one_line(text);
}

Failure failure_of(const PGresult* result) {
    constexpr std::size_t longest_detail = 400;  // it may show the whole row
    Failure failure{.text = field(result, PG_DIAG_MESSAGE_PRIMARY),
                    .sqlstate = field(result, PG_DIAG_SQLSTATE),
                    .routine = field(result, PG_DIAG_SOURCE_FUNCTION)};
    if (failure.text.empty()) failure.text = one_line(PQresultErrorMessage(result));
    if (auto detail = field(result, PG_DIAG_MESSAGE_DETAIL); !detail.empty())
        failure.text += ": " + detail.substr(0, longest_detail);
    if (!failure.sqlstate.empty()) failure.text += fmt::format(" (SQLSTATE {})", failure.sqlstate);
    return failure;
}

// Somebody's trigger may warn of every row. Only one thing is said aloud: a COMMIT without its standby.
void take_notice(void* /*nobody*/, const PGresult* notice) {
    auto text = printable(field(notice, PG_DIAG_MESSAGE_PRIMARY));
    if (field(notice, PG_DIAG_SOURCE_FUNCTION) == "SyncRepWaitForLSN")
        log::warn("sink", "postgres: {}", text);
    else
        log::debug("sink", "postgres: {}", text);
}

Rows rows_of(const PGresult* result) {
    Rows rows(static_cast<std::size_t>(PQntuples(result)));
    for (int at = 0; at < PQntuples(result); ++at)
        for (int column = 0; column < PQnfields(result); ++column) {
            auto& row = rows[static_cast<std::size_t>(at)];
            if (PQgetisnull(result, at, column) != 0)
                row.emplace_back();
            else
                row.emplace_back(std::string(PQgetvalue(result, at, column),
                                             static_cast<std::size_t>(PQgetlength(result, at, column))));
        }
    return rows;
}

}  // namespace

struct Session::Impl {
    PGconn* connection = nullptr;

    ~Impl() { close(); }
    void close() {
        if (connection != nullptr) PQfinish(connection);  // does not wait for anybody
        connection = nullptr;
    }

    // Until the socket is ready for one of `events`. False: patience is over. The stop token has no file
    // descriptor, so it is looked at now and then.
    bool wait(short events, const sink::Patience& patience) const {
        constexpr auto slice = 50ms;
        for (;;) {
            auto now = std::chrono::steady_clock::now();
            if (patience.over(now)) return false;
            auto left = std::chrono::ceil<std::chrono::milliseconds>(patience.until - now);
            pollfd waiting{PQsocket(connection), events, 0};
            if (::poll(&waiting, 1, static_cast<int>(std::min(left, slice).count())) > 0) return true;
        }
    }

    // What libpq says of the connection, which is of no more use.
    tl::unexpected<Failure> broken() {
        auto text = connection == nullptr ? std::string("there is no connection")
                                          : one_line(PQerrorMessage(connection));
        close();
        return tl::unexpected(Failure{text.empty() ? "the connection broke" : text});
    }
    tl::unexpected<Failure> patience_over(const sink::Patience& patience) {
        close();
        return tl::unexpected(
            Failure{patience.stop.stop_requested() ? "the gateway ends" : "no answer in time"});
    }

    // While our bytes go out the server's are taken in, or each could wait for the other.
    Answer<void> flush(const sink::Patience& patience) {
        for (;;) {
            auto left = PQflush(connection);
            if (left == 0) return {};
            if (left < 0) return broken();
            if (!wait(POLLIN | POLLOUT, patience)) return patience_over(patience);
            if (PQconsumeInput(connection) == 0) return broken();
        }
    }

    // The next result, null behind the last one.
    Answer<ResultHandle> next_result(const sink::Patience& patience) {
        while (PQisBusy(connection) != 0) {
            if (!wait(POLLIN, patience)) return patience_over(patience);
            if (PQconsumeInput(connection) == 0) return broken();
        }
        return ResultHandle(PQgetResult(connection));
    }

    struct Ended {
        Rows rows;
        std::string tag;  // "COMMIT", "INSERT 0 5"
    };
    // All results up to the end of the command, or, with `until_copy`, to where the server waits for data.
    Answer<Ended> results(const sink::Patience& patience, bool until_copy = false) {
        Ended ended;
        std::optional<Failure> failed;
        for (;;) {
            auto result = next_result(patience);
            if (!result) return tl::unexpected(result.error());
            if (*result == nullptr) break;
            switch (PQresultStatus(result->get())) {
                case PGRES_TUPLES_OK:
                    ended.rows = rows_of(result->get());
                    [[fallthrough]];
                case PGRES_COMMAND_OK:
                    ended.tag = PQcmdStatus(result->get());
                    break;
                case PGRES_EMPTY_QUERY:
                    break;
                case PGRES_COPY_IN:
                    if (until_copy) return ended;
                    [[fallthrough]];
                case PGRES_COPY_OUT:
                case PGRES_COPY_BOTH:
                    close();  // nobody here would go on with it
                    return tl::unexpected(Failure{"the server began a copy that nobody asked for"});
                default:
                    if (!failed) failed = failure_of(result->get());
            }
        }
        if (PQstatus(connection) == CONNECTION_BAD) close();
        if (!failed && until_copy) failed = Failure{"the server takes no copy"};
        if (failed) return tl::unexpected(std::move(*failed));
        return ended;
    }

    Answer<Ended> run(const std::string& sql, const sink::Patience& patience) {
        if (connection == nullptr || PQsendQuery(connection, sql.c_str()) == 0) return broken();
        if (auto sent = flush(patience); !sent) return tl::unexpected(sent.error());
        return results(patience);
    }
};

Result<Parameters> parse_url(const std::string& url) {
    auto colon = url.find("://");
    auto scheme = url.substr(0, std::min(colon, url.size()));
    if (colon == std::string::npos || (scheme != "postgres" && scheme != "postgresql"))
        return fail("the url is none of a PostgreSQL server",
                    "write it like \"postgres://user@host/database\"");
    auto authority = std::string_view(url).substr(colon + 3);
    authority = authority.substr(0, authority.find_first_of("/?"));
    auto at = authority.rfind('@');
    bool secret_in_front = at != std::string::npos && authority.substr(0, at).find(':') != std::string::npos;
    if (secret_in_front || url.find("assword") != std::string::npos)
        return fail("the url holds a password", "take it out and name its file with password_file");

    char* why = nullptr;
    std::unique_ptr<PQconninfoOption, void (*)(PQconninfoOption*)> options(PQconninfoParse(url.c_str(), &why),
                                                                           PQconninfoFree);
    if (!options) {
        PQfreemem(why);  // it quotes the url
        return fail("the url cannot be read", "write it like \"postgres://user@host:5432/database\"");
    }
    constexpr std::array<std::string_view, 4> allowed = {"host", "port", "user", "dbname"};
    Parameters parameters;
    for (auto* option = options.get(); option->keyword != nullptr; ++option) {
        if (option->val == nullptr || *option->val == '\0') continue;
        if (std::ranges::find(allowed, option->keyword) == allowed.end())
            return fail(fmt::format("the url sets {}", option->keyword),
                        "a url names user, host, port and database; all else is a setting of the sink");
        parameters.emplace_back(option->keyword, option->val);
    }
    return parameters;
}

Session::Session() : impl_(std::make_unique<Impl>()) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

void Session::close() {
    impl_->close();
}

bool Session::connected() const {
    return impl_->connection != nullptr && PQstatus(impl_->connection) == CONNECTION_OK;
}

void Session::look() {
    while (connected()) {
        pollfd waiting{PQsocket(impl_->connection), POLLIN, 0};
        if (::poll(&waiting, 1, 0) <= 0) return;
        if (PQconsumeInput(impl_->connection) == 0 || PQstatus(impl_->connection) == CONNECTION_BAD) close();
    }
}

Answer<void> Session::connect(const Parameters& parameters, const sink::Patience& patience) {
    close();
    std::vector<const char*> names, values;
    for (auto& [name, value] : parameters) {
        names.push_back(name.c_str());
        values.push_back(value.c_str());
    }
    names.push_back(nullptr);
    values.push_back(nullptr);
    auto& connection = impl_->connection;
    connection = PQconnectStartParams(names.data(), values.data(), 0);
    if (connection == nullptr) return tl::unexpected(Failure{"no memory for a connection"});
    PQsetNoticeReceiver(connection, take_notice, nullptr);
    if (PQstatus(connection) == CONNECTION_BAD) return impl_->broken();
    for (auto state = PGRES_POLLING_WRITING; state != PGRES_POLLING_OK;) {
        if (!impl_->wait(state == PGRES_POLLING_READING ? POLLIN : POLLOUT, patience))
            return impl_->patience_over(patience);
        state = PQconnectPoll(connection);
        if (state != PGRES_POLLING_FAILED) continue;
        Failure failure{one_line(PQerrorMessage(connection))};
        if (PQconnectionNeedsPassword(connection) != 0)
            failure.text += "; set password_file or password_env";
        else if (PQconnectionUsedPassword(connection) != 0)
            failure.text += "; is it the user of the url, and the password of password_file or password_env?";
        close();
        return tl::unexpected(std::move(failure));
    }
    PQsetnonblocking(connection, 1);
    return {};
}

Answer<Rows> Session::run(const std::string& sql, const sink::Patience& patience) {
    return impl_->run(sql, patience).map([](Impl::Ended&& ended) { return std::move(ended.rows); });
}

Answer<void> Session::commit(const sink::Patience& patience) {
    auto ended = impl_->run("COMMIT", patience);
    if (!ended) return tl::unexpected(ended.error());
    if (ended->tag != "COMMIT") return tl::unexpected(Failure{"the server has rolled the transaction back"});
    return {};
}

Answer<Rows> Session::ask(const std::string& sql, std::span<const std::string> values,
                          const sink::Patience& patience) {
    std::vector<const char*> texts;
    for (auto& value : values)
        texts.push_back(value.c_str());
    if (!connected() || PQsendQueryParams(impl_->connection, sql.c_str(), static_cast<int>(texts.size()),
                                          nullptr, texts.data(), nullptr, nullptr, 0) == 0)
        return impl_->broken();
    if (auto sent = impl_->flush(patience); !sent) return tl::unexpected(sent.error());
    return impl_->results(patience).map([](Impl::Ended&& ended) { return std::move(ended.rows); });
}

Answer<void> Session::copy_in(const std::string& sql, const std::function<bool(std::string&)>& more,
                              const sink::Patience& patience) {
    if (!connected() || PQsendQuery(impl_->connection, sql.c_str()) == 0) return impl_->broken();
    if (auto sent = impl_->flush(patience); !sent) return sent;
    if (auto ready = impl_->results(patience, true); !ready) return tl::unexpected(ready.error());
    std::string piece;
    for (bool going = true; going;) {
        piece.clear();
        going = more(piece);
        if (PQputCopyData(impl_->connection, piece.data(), static_cast<int>(piece.size())) < 0)
            return impl_->broken();
        if (auto sent = impl_->flush(patience); !sent) return sent;
    }
    if (PQputCopyEnd(impl_->connection, nullptr) <= 0) return impl_->broken();
    if (auto sent = impl_->flush(patience); !sent) return sent;
    if (auto done = impl_->results(patience); !done) return tl::unexpected(done.error());
    return {};
}

}  // namespace gantry::sinks::postgres
