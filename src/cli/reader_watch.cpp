// gantry reader watch: how a reader is, second after second.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"
#include "cli/job_text.hpp"
#include "cli/reader_commands.hpp"
#include "cli/reader_json.hpp"
#include "cli/remote.hpp"
#include "cli/signals.hpp"
#include "cli/values.hpp"
#include "http/message.hpp"

namespace gantry::cli {

namespace {
namespace json = boost::json;
constexpr std::string_view verb = "reader watch";
constexpr std::chrono::milliseconds period = 1s;

struct Options {
    Target target;
    std::vector<std::string> words;
    std::optional<std::chrono::milliseconds> run_for;
};

// "2026-11-21T23:04:00Z  connected, last read 0.2 s ago  reads 1234 +56  frames 78 +3"
class Printer {
public:
    Printer(Context& context, bool as_json) : out_(context.out), json_(as_json) {}

    void print(json::object reader, Wall now) {
        auto time = to_rfc3339(std::chrono::floor<std::chrono::seconds>(now));
        if (json_) {
            reader["time"] = to_rfc3339(now);
            reader.erase("parameters");
            reader.erase("commands");
            out_ << api::json_text(reader) << '\n' << std::flush;
            return;
        }
        auto zone = time.find('.');
        if (zone != std::string::npos) time = time.substr(0, zone) + "Z";
        out_ << fmt::format("{}  {}  ", time, plain(reader["state"]));
        count("reads", reader["reads"]);
        if (const auto* counters = reader["counters"].if_object())
            for (auto& counter : *counters)
                if (counter.key() != "reads") count(std::string(counter.key()), counter.value());
        out_ << '\n' << std::flush;
        first_ = false;
    }

private:
    void count(const std::string& name, const json::value& value) {
        boost::system::error_code error;
        auto number = value.is_number() ? value.to_number<std::uint64_t>(error) : 0;
        auto& before = before_[name];
        // Of what never happens there is nothing to say.
        if (number > 0 || name == "reads") {
            out_ << fmt::format(" {} {}", name, number);
            if (!first_ && number > before) out_ << fmt::format(" +{}", number - before);
        }
        before = number;
    }

    std::ostream& out_;
    bool json_, first_ = true;
    std::map<std::string, std::uint64_t> before_;
};

// Calls `next` each second until it has nothing more, or somebody ends it.
template <class Next>
int follow(Context& context, const Options& options, Signals& signals, const Next& next) {
    Printer printer(context, options.target.json);
    auto left = options.run_for;
    for (;;) {
        Result<json::object> reader = next();
        if (!reader) return complain(context, verb, reader.error());
        printer.print(std::move(*reader), link::read_clocks().wall);
        if (nobody_reads(context)) return done;
        auto pause = left ? std::min(period, *left) : period;
        if (signals.wait(pause)) return done;
        if (left && (*left -= pause).count() <= 0) return done;
    }
}

int watch(Context& context, Options& options) {
    auto& target = options.target;
    if (auto fine = take_words(target, options.words, {}); !fine) return misuse(context, verb, fine.error());
    Signals signals;
    if (!target.direct()) {
        auto place = fmt::format("/api/v1/readers/{}", http::encode_component(target.reader));
        return follow(context, options, signals, [&]() -> Result<json::object> {
            auto answer = ask(target.place, "GET", place);
            if (!answer) return tl::unexpected(answer.error());
            return std::move(answer->as_object());
        });
    }
    auto reader = open_direct(target, true);
    if (!reader) return complain(context, verb, reader.error());
    return follow(context, options, signals, [&]() -> Result<json::object> {
        auto status = (*reader)->status();
        if (!status.connected) return fail(fmt::format("{}: {}", target.shown(), printable(status.ended)));
        return to_json(status, (*reader)->address());
    });
}
}  // namespace

void add_reader_watch(CLI::App& reader, Context& context) {
    auto& command = add_command(reader, "watch", "How a reader is and what it counts, once a second",
                                "gantry reader watch gate-1\ngantry reader watch gate-1 --json --for 1min");
    auto options = std::make_shared<Options>();
    add_target(command, options->target, "One JSON object a line");
    add_words(command, context, options->words, {{"READER", "The reader"}});
    add_duration(command, "--for", options->run_for, "End after this long (default: with Ctrl-C)");
    on_run(command, context, [&context, options] { return watch(context, *options); });
}

}  // namespace gantry::cli
