// gantry gpio: inputs and outputs of readers.
#include <charconv>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/job_text.hpp"
#include "cli/values.hpp"

namespace gantry::cli {

namespace {
namespace json = boost::json;

struct GpioOptions {
    Target target;
    std::vector<std::string> words;  // READER
    std::optional<std::chrono::milliseconds> run_for;
    std::vector<std::string> changes;
    std::vector<std::string> said;  // once it is done
};

// "1=on", "2=0", "3=off"
Result<boost::json::object> change_of(std::string_view text,
                                      std::optional<std::chrono::milliseconds> run_for = {}) {
    auto wrong = [&] {
        return fail(fmt::format("{} is no output and state", printable(text)), "write 1=on or 1=off");
    };
    auto equals = text.find('=');
    if (equals == std::string_view::npos) return wrong();
    unsigned output = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + equals, output);
    if (error != std::errc{} || end != text.data() + equals || output == 0) return wrong();
    auto state = text.substr(equals + 1);
    bool on = state == "on" || state == "1";
    if (!on && state != "off" && state != "0") return wrong();
    boost::json::object change;
    change["output"] = output;
    change["state"] = on;
    if (run_for) change["for_ms"] = run_for->count();
    return change;
}

int job(Context& context, GpioOptions& options, boost::json::object request, std::string_view verb) {
    if (auto fine = take_words(options.target, options.words, {}); !fine)
        return misuse(context, verb, fine.error());
    auto result = run_job(options.target, std::move(request));
    if (!result) return complain(context, verb, result.error());
    if (!options.target.json)
        if (const auto* values = result->if_contains("values"))
            if (const auto* inputs = values->as_object().if_contains("inputs"))
                for (auto& input : inputs->as_array())
                    context.out << fmt::format("input {}: {}\n",
                                               input.as_object().at("input").to_number<int>(),
                                               input.as_object().at("state").as_bool() ? "on" : "off");
    if (!options.target.json && result->at("status").get_string() == "done")
        for (auto& said : options.said)
            context.out << said << '\n';
    return conclude(context, options.target, *result, verb);
}

int set(Context& context, GpioOptions& options) {
    // With an address the reader's name may be missing: then a change stands in its place.
    if (options.target.direct() && !options.words.empty() &&
        options.words.front().find('=') != std::string::npos)
        options.changes.insert(options.changes.begin(), std::exchange(options.words, {}).front());
    if (options.changes.empty())
        return misuse(context, "gpio set", {"OUTPUT=STATE is missing", "write 1=on or 1=off"});
    boost::json::object request;
    boost::json::array changes;
    for (auto& text : options.changes) {
        auto change = change_of(text, options.run_for);
        if (!change) return misuse(context, "gpio set", change.error());
        options.said.push_back(fmt::format(
            "output {} {}{}", json::serialize(change->at("output")),
            change->at("state").as_bool() ? "on" : "off",
            options.run_for ? fmt::format(" for {}", to_text(std::chrono::microseconds(*options.run_for)))
                            : ""));
        changes.emplace_back(std::move(*change));
    }
    request["op"] = "gpio.set";
    request["outputs"] = std::move(changes);
    return job(context, options, std::move(request), "gpio set");
}
}  // namespace

void add_gpio(CLI::App& app, Context& context) {
    auto& gpio = add_command(
        app, "gpio", "Inputs and outputs of a reader",
        "gantry gpio get dock-1\ngantry gpio set dock-1 1=on 2=off\ngantry gpio set dock-1 1=on --for 2s");
    gpio.require_subcommand(1);
    {
        auto options = std::make_shared<GpioOptions>();
        auto& command = add_command(gpio, "get", "Ask a reader for its inputs", "gantry gpio get dock-1");
        add_target(command, options->target, "The job's result as JSON");
        add_words(command, context, options->words, {{"READER", "The reader"}});
        on_run(command, context, [&context, options] {
            boost::json::object request;
            request["op"] = "gpio.get";
            return job(context, *options, std::move(request), "gpio get");
        });
    }
    {
        auto options = std::make_shared<GpioOptions>();
        auto& command = add_command(gpio, "set", "Switch outputs of a reader",
                                    "gantry gpio set dock-1 1=on\ngantry gpio set dock-1 1=on --for 2s");
        add_target(command, options->target, "The job's result as JSON");
        add_words(command, context, options->words, {{"READER", "The reader"}});
        auto* changes = command.add_option("OUTPUT=STATE", options->changes, "Like 1=on 2=off");
        must(*changes, [](const std::string& text) { return change_of(text).map([](const auto&) {}); });
        add_duration(command, "--for", options->run_for,
                     "Then back to the opposite state; without it the state stays");
        on_run(command, context, [&context, options] { return set(context, *options); });
    }
}

}  // namespace gantry::cli
