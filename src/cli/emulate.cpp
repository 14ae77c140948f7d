// gantry emulate: virtual readers.
#include <algorithm>
#include <fstream>
#include <ostream>
#include <sstream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/log.hpp"
#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/emulate.hpp"
#include "cli/scenario.hpp"
#include "cli/signals.hpp"
#include "cli/values.hpp"
#include "field/field.hpp"
#include "link/device_host.hpp"
#include "link/serial.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {

std::vector<std::pair<std::string, std::string>> link_settings(const Plugin& plugin,
                                                               const std::optional<link::Endpoint>& connect,
                                                               bool serial) {
    std::vector<std::pair<std::string, std::string>> out;
    if (connect && !plugin.dial_setting.empty() && !serial)
        out.emplace_back(plugin.dial_setting, link::to_text(*connect));
    // Where "serial" is something else, a number, it is the longer word.
    for (auto& row : plugin.device_settings)
        if (serial && row.kind == SettingRow::Kind::boolean &&
            (row.name == "serial" || row.name == "serial_line"))
            out.emplace_back(row.name, "true");
    return out;
}

Result<Settings> settings_of(const EmulateOptions& options, const Plugin& plugin,
                             std::vector<std::pair<std::string, std::string>> others) {
    std::vector<std::pair<std::string, std::string>> given;
    std::optional<Error> error;
    auto add = [&](std::string_view option, std::string name, std::string value) {
        given.emplace_back(std::move(name), std::move(value));
        auto fine = Settings::make(plugin.device_settings, std::span(given).last(1));
        if (!fine && !error)
            error = Error{fmt::format("{}: {}", option, fine.error().what), fine.error().hint};
    };
    for (auto& each : options.settings) {
        auto equals = each.find('=');
        add("--set " + printable(each), each.substr(0, equals), each.substr(equals + 1));
    }
    if (!options.generation.empty())
        add("--generation " + printable(options.generation), "generation", options.generation);
    if (!options.model.empty()) add("--model " + printable(options.model), "model", options.model);
    if (!options.family.empty()) add("--family " + printable(options.family), "family", options.family);
    if (options.no_ack) add("--no-ack", "ack", "false");
    for (auto& [name, value] : link_settings(plugin, options.connect, !options.pty.empty()))
        add(options.connect ? "--connect" : "--pty", name, value);
    if (error) return tl::unexpected(std::move(*error));
    for (auto& other : others)
        if (std::ranges::find(given, other.first, [](auto& each) { return each.first; }) == given.end())
            given.push_back(std::move(other));
    // Real readers may gather tags as long as presence waits for the next sighting; still tags would seem to
    // come and go.
    auto is_batch = [](const auto& each) { return each.first == "batch"; };
    bool gathers = std::ranges::any_of(plugin.device_settings, [](auto& row) { return row.name == "batch"; });
    if (gathers && std::ranges::none_of(given, is_batch)) given.emplace_back("batch", "500ms");
    return Settings::make(plugin.device_settings, given);
}

void reach(VirtualReader& reader, const EmulateOptions& options, unsigned number, std::size_t count) {
    if (options.connect) reader.connect = options.connect;
    if (options.listen) reader.listen = options.listen;
    if (options.listen && options.listen->port != 0)
        reader.listen->port = static_cast<std::uint16_t>(options.listen->port + number);
    if (!options.pty.empty())
        reader.pty = count == 1 ? options.pty : fmt::format("{}-{}", options.pty, number + 1);
    reader.baud = options.baud;
}

Result<void> check_link(const EmulateOptions& options, const Plugin& plugin, std::size_t count) {
    auto line = std::ranges::find(plugin.schemes, LinkKind::serial, &Scheme::kind);
    if (!options.pty.empty()) {
        if (options.connect || options.listen)
            return fail("--pty does not go with --connect or --listen", "a reader has one link");
        if (line == plugin.schemes.end())
            return fail(fmt::format("a {} reader has no serial line", plugin.name));
        return {};
    }
    if (options.baud && options.scenario.empty())
        return fail(std::string(baud_without_line), std::string(add_a_line));
    if (plugin.device_dials) {
        if (options.connect && !options.listen) return {};
        return fail(fmt::format("a {} reader dials out", plugin.name), "say where with --connect HOST:PORT");
    }
    if (options.connect && options.listen)
        return fail("--connect does not go with --listen", "a reader has one link");
    if (options.connect && plugin.dial_setting.empty())
        return fail(fmt::format("a {} reader listens", plugin.name), "say where with --listen HOST:PORT");
    if (options.listen && options.listen->port != 0 && options.listen->port + count - 1 > 0xFFFF)
        return fail(
            fmt::format("{} readers from port {} on need ports over 65535", count, options.listen->port),
            "begin with a lower one");
    return {};
}

namespace {
// The tags that a virtual reader sees when nobody names any.
event::Technology tags_of(const Plugin& plugin, const Settings& settings) {
    return plugin.device_tags != nullptr ? plugin.device_tags(settings) : event::Technology::epc_gen2;
}
bool is_hf(event::Technology kind) {
    return kind == event::Technology::iso15693 || kind == event::Technology::icode1;
}

Result<void> fill(Emulation& emulation, Air& air, const EmulateOptions& options, event::Technology kind,
                  unsigned number) {
    if (options.moving) {
        field::TrafficSpec traffic;
        traffic.seed = options.seed + number;
        if (is_hf(kind)) traffic.pool = field::hf_tags(kind, traffic.seed, traffic.tags);
        emulation.field().add_traffic(air, traffic, link::read_clocks().steady);
        return {};
    }
    if (options.tags.empty()) {
        for (auto& tag : is_hf(kind) ? field::default_hf_tags(kind, number) : field::default_tags(number))
            emulation.field().place(air, tag);
        return {};
    }
    std::ifstream file(options.tags, std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    if (!file)
        return fail(fmt::format("cannot read {}", options.tags),
                    "is it there, and a CSV file with a header?");
    auto tags = field::read_tags_csv(text.str(), options.tags);
    if (!tags) return tl::unexpected(tags.error());
    for (auto& tag : *tags)
        emulation.field().place(air, tag);
    return {};
}

Result<void> build(Emulation& emulation, const EmulateOptions& options, const Plugin& plugin,
                   const Settings& settings) {
    auto base = options.name.empty() ? fmt::format("virtual-{}", plugin.name) : options.name;
    if (options.connect) emulation.will_dial(link::to_text(*options.connect), options.count);
    for (unsigned i = 0; i < options.count; ++i) {
        VirtualReader reader;
        reader.plugin = &plugin;
        reader.device.name = options.count == 1 ? base : fmt::format("{}-{}", base, i + 1);
        reader.device.seed = options.seed + i;
        reader.device.settings = settings;
        auto kind = tags_of(plugin, settings);
        reader.air = &emulation.field().add_reader(reader.device.name, is_hf(kind) ? 1 : 4);
        if (auto filled = fill(emulation, *reader.air, options, kind, i); !filled) return filled;
        reach(reader, options, i, options.count);
        emulation.add(std::move(reader));
    }
    return {};
}

constexpr std::string_view help_word = "help";

// What can go wrong on request with readers of a make, or of every make, one a line.
void list_faults(std::string_view make, std::ostream& out) {
    for (auto* plugin : plugins()) {
        if (plugin->faults == nullptr || (make != every_make && make != plugin->name)) continue;
        if (make == every_make) out << plugin->name << ":\n";
        for (auto& fault : plugin->faults())
            out << fmt::format("  {:<32} {}\n", describe(fault), fault.help);
    }
    out << std::flush;
}

// A command on stdin goes to all the virtual readers, or to one: a hand at the device.
void obey(std::string_view line, std::string_view make, Emulation& emulation, Context& context) {
    if (line == help_word) return list_faults(make, context.out);
    if (line == "state") {
        emulation.print_state(context.out);
        return;
    }
    if (auto done = emulation.inject(line); !done) log::error("emulate", "{}", done.error().text());
}

// Who asked for so many seconds wants to know that nothing came of them.
int look_back(Context& context, const LinkWatch& watch) {
    auto never = watch.never_taken(link::read_clocks().steady);
    if (never == 0) return done;
    auto reason = watch.last_reason();
    return complain(context, "emulate",
                    {fmt::format("{} of {} virtual reader{} never got through to {}{}", never,
                                 watch.readers(), watch.readers() == 1 ? "" : "s", watch.place(),
                                 reason.empty() ? "" : fmt::format(" ({})", reason)),
                     "is a gateway running there, with a [[reader]] of that name?"});
}

std::string in_quotes(std::string_view text) {
    std::string out;
    append_json_string(out, text);
    return out;
}

// Makes the readers, or says why not.
std::optional<int> make(Context& context, Emulation& emulation, const EmulateOptions& options) {
    if (!options.scenario.empty()) {
        auto started = build_scenario(context, emulation, options);
        if (!started) {
            auto& error = started.error().error;
            return started.error().fault == ScenarioRefused::Fault::file ? refuse_scenario(context, error)
                                                                         : misuse(context, "emulate", error);
        }
        log::info("emulate", "{} virtual reader{} of {}", *started, *started == 1 ? "" : "s",
                  printable(options.scenario));
        return {};
    }
    if (options.make == every_make)
        return misuse(context, "emulate",
                      {"any is for the readers of a scenario", "name a make, or add --scenario FILE"});
    if (!options.reader.empty() || options.speed != 1)
        return misuse(context, "emulate",
                      {fmt::format("--{} is for a scenario", options.reader.empty() ? "speed" : "reader"),
                       "add --scenario FILE"});
    const auto* plugin = find_plugin(options.make);
    if (auto fine = check_link(options, *plugin, options.count); !fine)
        return misuse(context, "emulate", fine.error());
    auto settings = settings_of(options, *plugin);
    if (!settings) return misuse(context, "emulate", settings.error());
    if (auto built = build(emulation, options, *plugin, *settings); !built)
        return complain(context, "emulate", built.error());
    log::info("emulate", "{} virtual {} reader{}", options.count, plugin->name,
              options.count == 1 ? "" : "s");
    return {};
}

int emulate(Context& context, const EmulateOptions& options) {
    if (std::ranges::find(options.faults, help_word) != options.faults.end()) {
        list_faults(options.make, context.out);
        return done;
    }
    Signals signals;
    link::raise_file_limit();
    Emulation emulation;
    if (auto refused = make(context, emulation, options)) return *refused;
    // Before anybody can see the readers.
    for (auto& fault : options.faults)
        if (auto fine = emulation.check(fault); !fine)
            return misuse(
                context, "emulate",
                {fmt::format("--fault {}: {}", printable(fault), fine.error().what), fine.error().hint});
    if (auto started = emulation.start(); !started) return complain(context, "emulate", started.error());
    for (auto& fault : options.faults)
        if (auto fine = emulation.inject(fault); !fine)
            log::error("emulate", "--fault {}: {}", printable(fault), fine.error().text());
    for (auto& place : emulation.places())
        context.out << (options.json ? fmt::format("{{\"listening\":{}}}\n", in_quotes(place))
                                     : fmt::format("listening on {}\n", printable(place)));
    context.out << std::flush;
    Lines lines;
    bool told_to_end = signals.wait(options.run_for, [&](std::string_view typed) {
        lines.add(typed, [&](std::string_view line) { obey(line, options.make, emulation, context); });
        return false;
    });
    emulation.print_state(context.out);
    return told_to_end || emulation.watch() == nullptr ? done : look_back(context, *emulation.watch());
}
}  // namespace

// Of a setting of the virtual readers, for the shell.
static std::vector<std::string> choices_of(std::string_view setting) {
    std::vector<std::string> out;
    for (auto* plugin : plugins())
        for (auto& row : plugin->device_settings)
            if (row.name == setting)
                for (auto choice : row.choices)
                    if (!choice.empty()) out.emplace_back(choice);
    return out;
}

static std::vector<std::string> fault_words() {
    std::vector<std::string> out{std::string(help_word)};
    for (auto* plugin : plugins())
        if (plugin->faults != nullptr)
            for (auto& fault : plugin->faults())
                if (std::ranges::find(out, fault.word) == out.end()) out.emplace_back(fault.word);
    return out;
}

void add_emulate(CLI::App& app, Context& context) {
    auto& command = add_command(
        app, "emulate", "Run one or many virtual readers",
        "gantry emulate silion --connect 127.0.0.1:9055\n"
        "gantry emulate silion --connect 127.0.0.1:9055 --count 100 --name gate --moving\n"
        "gantry emulate caen --listen 127.0.0.1:1000 --model R4300P\n"
        "gantry emulate harting --connect 127.0.0.1:10005\n"
        "gantry emulate caen --pty /tmp/ttyR0 --baud 9600\n"
        "gantry emulate silion --pty /tmp/ttyR1 --set crc=ccitt\n"
        "gantry emulate silion --connect 127.0.0.1:9055 --tags tags.csv --fault 'error 11'\n"
        "gantry emulate caen --fault help\n"
        "gantry emulate silion --connect 127.0.0.1:9055 --scenario examples/scenarios/dock-door.toml\n"
        "echo 'input 1=1' | gantry emulate silion --connect 127.0.0.1:9055 --for 10s");
    auto options = std::make_shared<EmulateOptions>();
    auto makes = make_names();
    makes.emplace_back(every_make);
    add_choice(command, context, "PROTOCOL", options->make, makes,
               "Which make; any: of each reader of a scenario its own")
        ->required();
    add_endpoint(command, "--connect", options->connect,
                 "What readers of a make that dials out, or can, dial");
    add_endpoint(command, "--listen", options->listen,
                 "Where readers of a make that is dialled listen (default: 127.0.0.1:0, any free port)");
    command
        .add_option("--pty", options->pty,
                    "A serial line instead: makes this link to a pseudo-terminal, which opens like "
                    "/dev/ttyUSB0")
        ->type_name("FILE");
    command
        .add_option("--baud", options->baud, "The speed of that line (default: what is usual for the make)")
        ->check(CLI::Range(300u, 4'000'000u));
    command
        .add_option("--tags", options->tags,
                    "CSV file of tags that stand in front of the antennas (default: a handful)")
        ->type_name("FILE");
    command
        .add_option(
            "--scenario", options->scenario,
            "Readers and tags of this file: all readers of the make, in one field; --connect, --listen "
            "and --pty go before what it says")
        ->type_name("FILE");
    command.add_option("--reader", options->reader, "Only this reader of the scenario")->type_name("NAME");
    command
        .add_option("--speed", options->speed,
                    "How many times as fast as it is the scenario plays (default: 1)")
        ->check(CLI::Range(0.01, 1000.0))
        ->type_name("NUMBER");
    command.add_flag("--moving", options->moving, "Tags that come and go, instead of tags that stand still");
    command.add_option("--count", options->count, "How many readers; their names get -1, -2, …")
        ->check(CLI::Range(1u, 20'000u));
    command.add_option("--name", options->name, "The reader's own name (default: virtual-PROTOCOL)");
    add_count(command, "--seed", options->seed, 0, "Seed of everything that looks random");
    // Which of them the make knows it says itself.
    context.words[command.add_option("--generation", options->generation,
                                     "Firmware generation, for makes that have several")] =
        choices_of("generation");
    context.words[command.add_option("--model", options->model,
                                     "What it behaves as, for makes that have several models")] =
        choices_of("model");
    context.words[command.add_option("--family", options->family,
                                     "Which tags it reads, for makes that have several kinds of readers")] =
        choices_of("family");
    command.add_flag("--no-ack", options->no_ack, "Do not ask for acknowledgements");
    must(*command.add_option("--set", options->settings, "A setting of the virtual reader, name=value"),
         [](const std::string& text) -> Result<void> {
             if (text.find('=') == std::string::npos)
                 return fail(fmt::format("{} has no value", printable(text)), "write --set name=value");
             return {};
         });
    auto* fault =
        command.add_option("--fault", options->faults,
                           "Something to go wrong from the start, `help` lists what, or NAME: what for one "
                           "of several readers; the same words may come on stdin, one a line");
    context.words[fault] = fault_words();
    add_duration(command, "--for", options->run_for,
                 "End after this long, like 10s; with --connect, that no gateway was reached by then is a "
                 "failure");
    command.add_flag("--json", options->json, "Print where it listens as JSON");
    on_run(command, context, [&context, options] { return emulate(context, *options); });
}

}  // namespace gantry::cli
