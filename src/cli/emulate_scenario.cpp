// gantry emulate --scenario: readers that a scenario names, in one field.
#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "cli/emulate.hpp"
#include "cli/scenario.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {

namespace {
using Fault = ScenarioRefused::Fault;

auto refuse(Fault fault, std::string what, std::string hint = {}) {
    return tl::unexpected(ScenarioRefused{{std::move(what), std::move(hint)}, fault});
}

// What a scenario brings itself.
std::string_view at_odds(const EmulateOptions& options) {
    if (!options.tags.empty()) return "--tags";
    if (options.moving) return "--moving";
    if (options.count != 1) return "--count";
    if (!options.name.empty()) return "--name";
    return {};
}

struct Chosen {
    std::size_t number;  // in the scenario
    const Plugin* plugin;
};

tl::expected<std::vector<Chosen>, ScenarioRefused> choose(const field::Scenario& scenario,
                                                          const EmulateOptions& options) {
    std::vector<Chosen> chosen;
    std::vector<std::string_view> names;
    for (std::size_t i = 0; i < scenario.readers.size(); ++i) {
        auto& reader = scenario.readers[i];
        names.push_back(reader.name);
        if (!options.reader.empty() && reader.name != options.reader) continue;
        auto make = options.make;
        if (make == every_make) {
            make = reader.make;
            if (make == every_make)
                return refuse(Fault::command_line,
                              fmt::format("reader \"{}\" may be of any make", printable(reader.name)),
                              "name one in place of any, or write make = \"…\" in the scenario");
        } else if (reader.make != every_make && reader.make != make) {
            if (options.reader.empty()) continue;
            return refuse(Fault::command_line,
                          fmt::format("reader \"{}\" is a {} reader", printable(reader.name), reader.make),
                          fmt::format("write gantry emulate {}", reader.make));
        }
        chosen.push_back({i, find_plugin(make)});
    }
    if (!chosen.empty()) return chosen;
    if (options.reader.empty())
        return refuse(Fault::command_line, fmt::format("the scenario has no {} reader", options.make),
                      fmt::format("its readers: {}", printable(fmt::format("{}", fmt::join(names, ", ")))));
    auto near = nearest(options.reader, names);
    return refuse(
        Fault::command_line, fmt::format("the scenario has no reader \"{}\"", printable(options.reader)),
        near.empty() ? fmt::format("its readers: {}", printable(fmt::format("{}", fmt::join(names, ", "))))
                     : fmt::format("did you mean \"{}\"?", printable(near)));
}

Error at(const EmulateOptions& options, document::Place place, const Error& error) {
    return {fmt::format("{}:{}:{}: {}", printable(options.scenario), place.line, place.column, error.what),
            error.hint};
}

// What the file says of its link; the command line may say otherwise.
Result<void> own_link(const field::ReaderSpec& spec, const EmulateOptions& options, VirtualReader& reader) {
    auto endpoint = [&](const std::optional<field::Located>& text, std::optional<link::Endpoint>& into,
                        bool fits, std::string_view other) -> Result<void> {
        if (!text) return {};
        if (!fits)
            return tl::unexpected(at(options, text->at,
                                     {fmt::format("a {} reader {}", reader.plugin->name,
                                                  reader.plugin->device_dials ? "dials out" : "listens"),
                                      fmt::format("say where with {} = \"HOST:PORT\"", other)}));
        auto place = link::parse_endpoint(text->text);
        if (!place) return tl::unexpected(at(options, text->at, place.error()));
        into = *place;
        return {};
    };
    if (spec.pty) reader.pty = spec.pty->text;
    bool can_dial = reader.plugin->device_dials || !reader.plugin->dial_setting.empty();
    auto fine = endpoint(spec.connect, reader.connect, can_dial, "listen");
    return fine ? endpoint(spec.listen, reader.listen, !reader.plugin->device_dials, "connect") : fine;
}

Result<Settings> own_settings(const field::ReaderSpec& spec, const EmulateOptions& options,
                              const VirtualReader& reader) {
    auto& plugin = *reader.plugin;
    std::vector<std::pair<std::string, std::string>> given;
    for (auto& [name, value] : spec.settings) {
        given.emplace_back(name, value.text);
        if (auto fine = Settings::make(plugin.device_settings, std::span(given).last(1)); !fine)
            return tl::unexpected(at(options, value.at, fine.error()));
    }
    for (auto& each : link_settings(plugin, reader.connect, !reader.pty.empty()))
        given.push_back(std::move(each));
    return settings_of(options, plugin, std::move(given));
}
}  // namespace

tl::expected<std::size_t, ScenarioRefused> build_scenario(Context& context, Emulation& emulation,
                                                          const EmulateOptions& options) {
    if (auto odd = at_odds(options); !odd.empty())
        return refuse(Fault::command_line, fmt::format("{} does not go with --scenario", odd),
                      "a scenario brings its readers and tags itself");
    auto scenario = load_scenario(context, options.scenario);
    if (!scenario) return refuse(Fault::file, scenario.error().what, scenario.error().hint);
    auto chosen = choose(*scenario, options);
    if (!chosen) return tl::unexpected(chosen.error());

    std::vector<VirtualReader> readers;
    std::size_t dialling = 0;
    std::string place;
    for (unsigned i = 0; i < chosen->size(); ++i) {
        auto& spec = scenario->readers[(*chosen)[i].number];
        auto& plugin = *(*chosen)[i].plugin;
        VirtualReader reader;
        reader.plugin = &plugin;
        if (auto own = own_link(spec, options, reader); !own) return refuse(Fault::file, own.error().text());
        bool dials = reader.dials();
        bool said = dials ? reader.connect.has_value() : reader.listen.has_value() || !reader.pty.empty();
        if (options.connect || options.listen || !options.pty.empty() || (dials && !said))
            if (auto fine = check_link(options, plugin, chosen->size()); !fine)
                return refuse(Fault::command_line, fine.error().what, fine.error().hint);
        if (!options.pty.empty() || options.connect || options.listen) reader.pty.clear();
        reach(reader, options, i, chosen->size());
        auto settings = own_settings(spec, options, reader);
        if (!settings) return refuse(Fault::file, settings.error().text());
        reader.device = {.name = spec.name, .seed = options.seed + i, .settings = *settings};
        if (reader.dials()) {
            ++dialling;
            auto to = link::to_text(*reader.connect);
            place = place.empty() || place == to ? to : "their gateways";
        }
        readers.push_back(std::move(reader));
    }
    if (options.baud && std::ranges::none_of(readers, [](auto& each) { return !each.pty.empty(); }))
        return refuse(Fault::command_line, std::string(baud_without_line), std::string(add_a_line));
    if (dialling > 0) emulation.will_dial(place, dialling);
    auto& scene = emulation.play(*scenario, link::read_clocks().steady, options.speed);
    for (std::size_t i = 0; i < readers.size(); ++i) {
        readers[i].air = &scene.air((*chosen)[i].number);
        emulation.add(std::move(readers[i]));
    }
    return readers.size();
}

}  // namespace gantry::cli
