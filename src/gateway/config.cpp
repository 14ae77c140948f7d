#include "gateway/config.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>

#include <fmt/format.h>

#include "base/text.hpp"
#include "gateway/config_makes.hpp"
#include "protocols/registry.hpp"
#include "sinks/registry.hpp"

namespace gantry::gateway {

namespace {
using std::chrono::microseconds;

std::filesystem::path default_data_dir() {
    if (geteuid() == 0) return "/var/lib/gantry";
    auto* state = std::getenv("XDG_STATE_HOME");  // NOLINT(concurrency-mt-unsafe): read at the start
    if (state != nullptr && *state == '/') return std::filesystem::path(state) / "gantry";
    auto* home = std::getenv("HOME");  // NOLINT(concurrency-mt-unsafe)
    if (home != nullptr && *home == '/') return std::filesystem::path(home) / ".local/state/gantry";
    return "gantry-data";
}

std::vector<std::string_view> keys_of(const ConfigSection& section) {
    std::vector<std::string_view> keys;
    for (auto& row : section.rows)
        keys.push_back(row.key);
    return keys;
}

class Check {
public:
    Check(const Node& root, std::string_view file, Makes makes, Kinds kinds)
        : root_(*root.get<Node::Table>()), findings_(file), makes_(makes), kinds_(kinds) {}

    Result<Config> run() {
        check_names();
        gateway();
        if (auto* readers = list("reader"))
            config_.readers = check_readers(*readers, makes_, findings_, gaps_);
        auto events = single("events");
        config_.tag_read = events.get<bool>("tag_read").value_or(false);
        config_.tag_glimpsed = events.get<bool>("tag_glimpsed").value_or(false);
        config_.presence.glimpsed_events = config_.tag_glimpsed;
        take_rules(single("presence"), config_.presence);
        if (auto* zones = list("zone"))
            for (auto& node : *zones)
                zone(node);
        check_gaps();
        store();
        api();
        sinks();
        if (findings_.failed()) return fail(findings_.errors());
        config_.warnings = findings_.warnings();
        return std::move(config_);
    }

    Result<std::filesystem::path> data_dir() {
        gateway();
        if (findings_.failed()) return fail(findings_.errors());
        return config_.data_dir;
    }

private:
    const Entry* find(std::string_view key) const {
        auto it = std::ranges::find(root_, key, &Entry::key);
        return it == root_.end() ? nullptr : &*it;
    }

    void check_names() {
        std::vector<std::string_view> known;
        for (auto& section : config_sections())
            if (section.path.find('.') == std::string_view::npos) known.push_back(section.path);
        for (auto& entry : root_) {
            if (std::ranges::find(known, entry.key) != known.end()) continue;
            auto near = nearest(entry.key, known);
            findings_.error(entry.at, fmt::format("unknown section \"{}\"", printable(entry.key)),
                            near.empty() ? fmt::format("sections: {}", fmt::join(known, ", "))
                                         : fmt::format("did you mean {}?", header(near)));
        }
    }

    static std::string header(std::string_view path) {
        return config_section(path).repeated ? fmt::format("[[{}]]", path) : fmt::format("[{}]", path);
    }

    // A section that stands once; without it all its fallbacks.
    Section single(std::string_view path) {
        auto& rows = config_section(path);
        auto* entry = find(path);
        auto* table = entry == nullptr ? nullptr : entry->value.get<Node::Table>();
        if (entry != nullptr && table == nullptr)
            findings_.error(entry->at, fmt::format("{} is {}", path, entry->value.kind()),
                            fmt::format("it stands once, as a section [{}]", path));
        static const Node::Table none;
        auto section =
            check_section(table == nullptr ? none : *table, table == nullptr ? Place{} : entry->value.at,
                          rows, header(path), findings_);
        auto known = keys_of(rows);
        for (auto* other : section.others)
            unknown_key(*other, header(path), known, findings_);
        return section;
    }

    // The items of a section that may stand several times.
    const Node::List* list(std::string_view path) {
        auto* entry = find(path);
        if (entry == nullptr) return nullptr;
        auto* list = entry->value.get<Node::List>();
        if (list == nullptr)
            findings_.error(entry->at, fmt::format("{} is {}", path, entry->value.kind()),
                            fmt::format("there may be several: write [[{}]]", path));
        return list;
    }

    void gateway() {
        auto section = single("gateway");
        config_.gateway_id = section.get<std::string>("id").value_or("");
        auto allowed = [](char c) {
            return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                   c == '_' || c == '.';
        };
        if (!std::ranges::all_of(config_.gateway_id, allowed))
            findings_.error(
                section.place("id"),
                fmt::format("id = \"{}\" cannot be part of an event id", printable(config_.gateway_id)),
                "use 1 to 64 letters, digits, '-', '_' and '.'");
        auto given = section.get<std::string>("data_dir");
        config_.data_dir = given ? std::filesystem::path(*given) : default_data_dir();
    }

    static void take_rules(const Section& section, presence::Rules& rules) {
        auto duration = [&](std::string_view key, microseconds& into) {
            into = section.get<microseconds>(key).value_or(into);
        };
        duration("glimpse_timeout", rules.glimpse_timeout);
        duration("observe_after", rules.observe_after);
        duration("lose_after", rules.lose_after);
        duration("purge_after", rules.purge_after);
        if (auto reads = section.get<std::int64_t>("observe_after_reads"))
            rules.observe_after_reads = static_cast<std::uint32_t>(*reads);
        if (section.is_never("offline_lose_after"))
            rules.offline_lose_after.reset();
        else if (auto after = section.get<microseconds>("offline_lose_after"))
            rules.offline_lose_after = *after;
    }

    std::vector<std::string_view> used_zones() const {
        std::vector<std::string_view> zones;
        for (auto& reader : config_.readers) {
            if (!reader.zone.empty()) zones.push_back(reader.zone);
            for (auto& antenna : reader.antennas)
                zones.push_back(antenna.zone);
        }
        return zones;
    }

    void zone(const Node& node) {
        auto* table = node.get<Node::Table>();
        if (table == nullptr) {
            findings_.error(node.at, fmt::format("zone is a list with {} in it", node.kind()),
                            "write each zone as a section [[zone]]");
            return;
        }
        auto& rows = config_section("zone");
        auto section = check_section(*table, node.at, rows, "[[zone]]", findings_);
        auto known = keys_of(rows);
        for (auto* other : section.others)
            unknown_key(*other, "[[zone]]", known, findings_);
        auto name = section.get<std::string>("name");
        if (!name) return;
        if (std::ranges::find(config_.zones, *name, &ZoneConfig::name) != config_.zones.end())
            findings_.error(section.place("name"),
                            fmt::format("zone \"{}\" is already defined", printable(*name)),
                            "names must differ");
        auto zones = used_zones();
        if (std::ranges::find(zones, *name) == zones.end()) {
            auto near = nearest(*name, zones);
            findings_.warning(section.place("name"),
                              fmt::format("no reader or antenna is in zone \"{}\"{}", printable(*name),
                                          near.empty() ? "" : fmt::format("; did you mean \"{}\"?", near)));
        }
        auto rules = config_.presence;
        take_rules(section, rules);
        config_.zones.push_back({std::move(*name), rules});
    }

    // Of all zones that the reader's tags may be in the one that waits the shortest.
    microseconds lose_after(const ReaderConfig& reader) const {
        auto of_zone = [this](std::string_view name) {
            auto zone = std::ranges::find(config_.zones, name, &ZoneConfig::name);
            return zone == config_.zones.end() ? config_.presence.lose_after : zone->rules.lose_after;
        };
        auto shortest = of_zone(reader.zone);
        for (auto& antenna : reader.antennas)
            shortest = std::min(shortest, of_zone(antenna.zone));
        return shortest;
    }

    void check_gaps() {
        for (auto& each : gaps_) {
            auto waits = lose_after(config_.readers[each.reader]);
            if (each.gap > waits)
                findings_.warning(
                    each.at, fmt::format("{} = \"{}\" is longer than lose_after = \"{}\": tags that stand "
                                         "still will come and go",
                                         each.name, to_text(each.gap), to_text(waits)));
        }
    }

    void store() {
        auto section = single("store");
        auto& store = config_.store;
        store.path = config_.data_dir / "gantry.db";
        store.keep = section.get<microseconds>("keep").value_or(store.keep);
        if (auto size = section.get<std::int64_t>("max_size"))
            store.max_size = static_cast<std::uint64_t>(*size);
        store.on_full = section.get<std::string>("on_full") == "drop_oldest" ? journal::OnFull::drop_oldest
                                                                             : journal::OnFull::hold_readers;
    }

    void api() {
        auto* entry = find("api");
        auto section = single("api");
        auto* table = entry == nullptr ? nullptr : entry->value.get<Node::Table>();
        if (table == nullptr) return;
        auto listen = std::ranges::find(*table, "listen", &Entry::key);
        if (listen != table->end())
            findings_.warning(listen->at,
                              "api.listen is not served by this version; the gateway answers on "
                              "gantry.sock in the data directory");
    }

    void sinks() {
        if (auto* sinks = list("sink")) config_.sinks = check_sinks(*sinks, kinds_, findings_);
        for (auto& each : config_.sinks)
            config_.store.sinks.push_back(each.name);
    }

    const Node::Table& root_;
    std::vector<ReadGap> gaps_;
    Findings findings_;
    Makes makes_;
    Kinds kinds_;
    Config config_;
};
}  // namespace

Result<Config> parse_config(std::string_view toml, std::string_view file_name, Makes makes, Kinds kinds) {
    auto root = document::parse_document(toml);
    if (!root) {
        Findings findings(file_name);
        findings.error(root.error().at, root.error().what);
        return fail(findings.errors());
    }
    return Check(*root, file_name, makes, kinds).run();
}

Result<Config> parse_config(std::string_view toml, std::string_view file_name) {
    return parse_config(toml, file_name, plugins(), sink_kinds());
}

Config default_config() {
    return parse_config("", "", {}).value();
}

static Result<std::string> read_config(const std::filesystem::path& file) {
    auto name = printable(file.string());
    std::error_code error;
    if (!std::filesystem::exists(file, error))
        return fail(fmt::format("{}: there is no such file", name),
                    "`gantry config example` prints one to start from");
    if (std::filesystem::is_directory(file, error))
        return fail(fmt::format("{}: is a directory", name), "name the file in it");
    std::ifstream in(file, std::ios::binary);
    std::string text;
    // A little more than parse_config() takes is enough to be told that it is too big.
    constexpr std::size_t most = (4 << 20) + 1;
    for (char block[4096]; text.size() < most && (in.read(block, sizeof block) || in.gcount() > 0);)
        text.append(block, static_cast<std::size_t>(in.gcount()));
    if (!in.is_open() || in.bad())
        return fail(fmt::format("{}: cannot be read", name), "may this user read it?");
    return text;
}

Result<Config> load_config(const std::filesystem::path& file) {
    auto text = read_config(file);
    if (!text) return tl::unexpected(text.error());
    return parse_config(*text, printable(file.string()));
}

Result<std::filesystem::path> load_data_dir(const std::filesystem::path& file) {
    auto text = read_config(file);
    if (!text) return tl::unexpected(text.error());
    auto name = printable(file.string());
    auto root = document::parse_document(*text);
    if (root) return Check(*root, name, {}, {}).data_dir();
    Findings findings(name);
    findings.error(root.error().at, root.error().what);
    return fail(findings.errors());
}

}  // namespace gantry::gateway
