#include "cli/target.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/remote.hpp"
#include "cli/values.hpp"
#include "http/message.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {

namespace {
Result<DirectReader::Options> direct_options(const Target& target) {
    DirectReader::Options options;
    auto address = gateway::parse_address(target.address);
    if (!address) return fail("--address: " + address.error().what, address.error().hint);
    options.address = std::move(*address);
    options.name = target.reader;
    std::vector<std::pair<std::string, std::string>> given;
    auto& rows = options.address.plugin->driver_settings;
    for (auto& each : target.settings) {
        auto equals = each.find('=');
        auto name = each.substr(0, equals);
        auto value = each.substr(equals + 1);
        if (name == "model") {  // the key of every make
            options.model = value;
            continue;
        }
        given.emplace_back(std::move(name), std::move(value));
        if (auto fine = Settings::make(rows, std::span(given).last(1)); !fine)
            return fail(fmt::format("--set {}: {}", printable(each), fine.error().what), fine.error().hint);
    }
    auto settings = Settings::make(rows, given);
    if (!settings) return tl::unexpected(settings.error());
    options.settings = std::move(*settings);
    return options;
}
}  // namespace

std::string Target::shown() const {
    return printable(reader.empty() ? address : reader);
}

void add_target(CLI::App& command, Target& target, const std::string& json_help) {
    add_place(command, target.place);
    command.add_option("--address", target.address,
                       "The reader itself, with no gateway: an address as in gantry.toml. Its name may be "
                       "left out then");
    must(*command.add_option("--set", target.settings,
                             "With --address: a setting of the reader's section, name=value"),
         [](const std::string& text) -> Result<void> {
             if (text.find('=') == std::string::npos)
                 return fail(fmt::format("{} has no value", printable(text)), "write --set name=value");
             return {};
         });
    add_duration(command, "--timeout", target.timeout, "How long to wait for its answer (default: 10s)");
    command.add_flag("--json", target.json, json_help);
}

void add_words(CLI::App& command, Context& context, std::vector<std::string>& words,
               std::initializer_list<Word> all) {
    for (auto& word : all) {
        auto keep = [&words](const std::string& text) { words.push_back(text); };
        auto* option = command.add_option_function<std::string>(word.name, keep, word.help);
        if (!word.is_file) context.asked.insert(option);
    }
}

Result<void> take_words(Target& target, std::vector<std::string>& words,
                        std::initializer_list<std::string_view> rest) {
    bool named = !target.direct() || words.size() > rest.size();
    if (named && words.empty())
        return fail("say which reader",
                    "its name, as `gantry reader list` shows it, or --address SCHEME://HOST");
    if (named) {
        target.reader = words.front();
        words.erase(words.begin());
    }
    if (words.size() < rest.size()) return fail(fmt::format("{} is missing", rest.begin()[words.size()]));
    return {};
}

Result<const Plugin*> make_of(const Target& target) {
    if (target.direct()) {
        auto options = direct_options(target);
        if (!options) return tl::unexpected(options.error());
        return options->address.plugin;
    }
    auto answer =
        ask(target.place, "GET", fmt::format("/api/v1/readers/{}", http::encode_component(target.reader)));
    if (!answer) return tl::unexpected(answer.error());
    const auto* name = answer->as_object().if_contains("make");
    const auto* make = name != nullptr && name->is_string() ? find_plugin(name->get_string()) : nullptr;
    if (make == nullptr)
        return fail(fmt::format("{} is of a make that this program does not know", printable(target.reader)),
                    "is the gateway of another version?");
    return make;
}

Result<std::unique_ptr<DirectReader>> open_direct(const Target& target, bool reading,
                                                  std::function<bool()> interrupted) {
    auto options = direct_options(target);
    if (!options) return tl::unexpected(options.error());
    options->reading = reading;
    options->interrupted = std::move(interrupted);
    return DirectReader::open(std::move(*options), *target.timeout);
}

}  // namespace gantry::cli
