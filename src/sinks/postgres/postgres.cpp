#include "sinks/postgres/postgres.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "sinks/postgres/rows.hpp"
#include "sinks/postgres/verdict.hpp"

namespace gantry::sinks::postgres {

using std::chrono::steady_clock;

namespace {

constexpr std::size_t piece_size = 64 * 1024;  // of COPY's data: the rows of a batch are never all in memory

// What the server is told to give up after, so that it does not go on when we no longer listen.
std::int64_t milliseconds_left(const sink::Patience& patience) {
    auto left = std::chrono::ceil<std::chrono::milliseconds>(patience.until - steady_clock::now()).count();
    constexpr std::int64_t longest = 24L * 3600 * 1000;
    return std::clamp<std::int64_t>(left, 1, longest);
}

// A confirmation must not come before the rows are on the server's disk; remote_apply is more than that.
// Nobody's transaction is to stay open if this machine is lost in the middle of one.
constexpr std::string_view session_settings = R"(
SELECT set_config('synchronous_commit', CASE WHEN current_setting('synchronous_commit') = 'remote_apply'
                                             THEN 'remote_apply' ELSE 'on' END, false),
       set_config('idle_in_transaction_session_timeout', '60s', false), set_config('lock_timeout', $1, false),
       set_config('statement_timeout', $2, false), pg_is_in_recovery(), current_setting('fsync'),
       current_setting('server_encoding'))";

}  // namespace

PostgresSink::PostgresSink(Target target) : target_(std::move(target)) {
    // COMMIT is under no time-out: cut short in its wait for a standby it would succeed all the same.
    insert_ = insert_events(target_.names) + ";\n";
    if (target_.present_tags) insert_ += update_presence(target_.names, target_.gateway) + ";\n";
    insert_ += "SET LOCAL statement_timeout = 0";
}

bool PostgresSink::connected() const {
    return session_.connected();
}

Answer<void> PostgresSink::connect(const sink::Patience& patience) {
    session_.look();
    if (session_.connected()) return {};
    if (!target_.warning.empty() && !warned_) log::warn("sink", "{}", target_.warning);
    warned_ = true;
    std::string troubles;
    for (std::size_t i = 0; i < target_.hosts.size(); ++i) {
        // Each of several servers gets its part of the time, or the first one could take it all.
        auto now = steady_clock::now();
        auto part = patience;
        part.until = now + (patience.until - now) / static_cast<int>(target_.hosts.size() - i);
        auto ready = connect_to(target_.hosts[i], part);
        if (ready) return ready;
        session_.close();
        troubles += (troubles.empty() ? "" : "; ") + ready.error().text;
    }
    return tl::unexpected(Failure{std::move(troubles)});
}

Answer<void> PostgresSink::connect_to(const Target::Host& host, const sink::Patience& patience) {
    std::vector<std::string> addresses = {{}};
    if (!host.is_directory()) {
        auto found = resolver_.addresses(host.name, patience);
        if (!found) return tl::unexpected(Failure{found.error().text()});
        addresses = std::move(*found);
    }
    Failure last;
    for (std::size_t i = 0; i < addresses.size(); ++i) {
        auto now = steady_clock::now();
        auto part = patience;
        part.until = now + (patience.until - now) / static_cast<int>(addresses.size() - i);
        auto parameters = target_.parameters;
        parameters.emplace_back("host", host.name);
        parameters.emplace_back("hostaddr", addresses[i]);
        parameters.emplace_back("port", host.port);
        parameters.emplace_back("sslmode", host.sslmode);
        auto connected = session_.connect(parameters, part);
        if (connected) return set_up(host, patience);
        last = connected.error();
    }
    return tl::unexpected(
        Failure{fmt::format("no connection to {}: {}", host.shown(), printable(last.text))});
}

Answer<void> PostgresSink::set_up(const Target::Host& host, const sink::Patience& patience) {
    auto trouble = [&](const Failure& failure) {
        return tl::unexpected(Failure{fmt::format("{}: {}", host.shown(), printable(failure.text))});
    };
    std::array values = {fmt::format("{}ms", target_.lock_timeout.count()),
                         fmt::format("{}ms", milliseconds_left(patience))};
    auto set = session_.ask(std::string(session_settings), values, patience);
    if (!set) return trouble(set.error());
    auto& row = set->at(0);
    if (row[4] == "t") return trouble({"it is a standby, which takes nothing"});
    if (row[5] == "off")
        log::warn("sink", "{} runs with fsync = off: what it confirms may be lost with its power",
                  host.shown());
    if (row[6] != "UTF8")
        log::warn("sink", "{} keeps texts in {}: an event with other characters is refused", host.shown(),
                  printable(*row[6]));
    std::vector kept = {kept_events(target_.names)};
    if (target_.present_tags) kept.push_back(kept_presence(target_.names));
    if (auto done = migrate(session_, target_.names, kept, patience); !done) return trouble(done.error());
    if (auto made = session_.run(create_staging(), patience); !made) return trouble(made.error());
    return {};
}

// Failure of a row leaves the session ready for the next try.
Answer<void> PostgresSink::insert(std::span<const sink::Item> items, const sink::Patience& patience) {
    std::size_t at = 0;
    auto more = [&](std::string& out) {
        if (at == 0) append_copy_header(out);
        while (at < items.size() && out.size() < piece_size)
            append_copy_row(out, items[at++], target_.gateway);
        if (at < items.size()) return true;
        append_copy_end(out);
        return false;
    };
    auto begin =
        fmt::format("BEGIN ISOLATION LEVEL READ COMMITTED READ WRITE; SET LOCAL statement_timeout = {}; {}",
                    milliseconds_left(patience), copy_into_staging());
    auto done = session_.copy_in(begin, more, patience);
    if (done)
        if (auto inserted = session_.run(insert_, patience); !inserted)
            done = tl::unexpected(inserted.error());
    if (done) done = session_.commit(patience);
    if (!done && session_.connected())
        if (auto back = session_.run("ROLLBACK", patience); !back) session_.close();
    return done;
}

sink::Outcome PostgresSink::deliver(std::span<const sink::Item> batch, const sink::Patience& patience) {
    auto outcome = sink::Outcome::kept(batch.size(), {});
    if (patience.over(steady_clock::now())) {
        outcome.trouble = "there was no time to deliver anything";
        return outcome;
    }
    if (auto ready = connect(patience); !ready) {
        outcome.trouble = std::move(ready.error().text);
        return outcome;
    }
    struct Part {
        std::size_t first, size;
    };
    std::vector<Part> parts;
    if (!batch.empty()) parts.push_back({0, batch.size()});
    while (!parts.empty()) {
        auto part = parts.back();
        parts.pop_back();
        auto done = insert(batch.subspan(part.first, part.size), patience);
        if (done) {
            std::fill_n(outcome.fates.begin() + static_cast<std::ptrdiff_t>(part.first), part.size,
                        sink::Fate::accepted);
        } else if (!blames_a_row(done.error()) || !session_.connected()) {
            outcome.trouble = printable(done.error().text);
            break;
        } else if (part.size == 1) {
            outcome.reject(part.first, std::move(done.error().text));
        } else {
            auto half = part.size / 2;
            parts.push_back({part.first + half, part.size - half});
            parts.push_back({part.first, half});
        }
    }
    if (target_.present_tags && parts.empty()) forget_gone_tags(patience);
    return outcome;
}

// Now and then; nothing is lost if it does not work out.
void PostgresSink::forget_gone_tags(const sink::Patience& patience) {
    constexpr auto pause = 1h;
    auto now = steady_clock::now();
    if (!session_.connected() || now < forget_at_) return;
    forget_at_ = now + pause;
    auto done = session_.run(postgres::forget_gone_tags(target_.names, target_.gateway), patience);
    if (!done)
        log::warn("sink", "tags that are long gone could not be forgotten: {}", printable(done.error().text));
}

void PostgresSink::idle(const sink::Patience& /*patience*/) {
    session_.look();
}

}  // namespace gantry::sinks::postgres
