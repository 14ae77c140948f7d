#include "field/scenario.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <fmt/format.h>

#include "base/text.hpp"
#include "document/check.hpp"
#include "field/scenario_rows.hpp"

namespace gantry::field {

namespace {
using document::Entry;
using document::Findings;
using document::Node;
using document::Place;
using document::Section;
using std::chrono::microseconds;

constexpr std::size_t most_tags = 200'000;
constexpr std::size_t most_readers = 1000, most_antennas = 64;

Vec vec(const document::Point& point) {
    return {point[0], point[1], point[2]};
}

std::vector<std::string_view> keys_of(const document::SectionRows& section) {
    std::vector<std::string_view> keys;
    for (auto& row : section.rows)
        keys.push_back(row.key);
    return keys;
}

// Half power beam width of an antenna of that gain: a beam of θ by θ degrees gathers about 30,000 / θ².
double beam_of(double gain_dbi) {
    return std::clamp(std::sqrt(30'000 / std::pow(10, gain_dbi / 10)), 10.0, 180.0);
}

std::size_t uid_size(event::Technology technology) {
    return technology == event::Technology::epc_gen2 ? 0 : 8;
}

class ScenarioCheck {
public:
    ScenarioCheck(const Node::Table& root, std::string_view file, std::span<const std::string_view> makes)
        : root_(root), findings_(file), makes_(makes) {}

    Result<Scenario> run() {
        check_sections();
        about();
        for (auto* node : items(root_, "reader", "reader"))
            reader(*node);
        for (auto* node : items(root_, "tags", "tags"))
            tags(*node);
        if (scenario_.readers.empty() && !findings_.failed())
            findings_.error({}, "nobody reads in this scenario",
                            "add a [[reader]] with a [[reader.antenna]]");
        if (scenario_.readers.size() > most_readers)
            findings_.error(
                {}, fmt::format("{} readers; {} are the most", scenario_.readers.size(), most_readers));
        if (scenario_.tags() > most_tags)
            findings_.error({}, fmt::format("{} tags in all; {} are the most", scenario_.tags(), most_tags));
        if (findings_.failed()) return fail(findings_.errors());
        return std::move(scenario_);
    }

private:
    static const Entry* find(const Node::Table& table, std::string_view key) {
        auto it = std::ranges::find(table, key, &Entry::key);
        return it == table.end() ? nullptr : &*it;
    }

    void check_sections() {
        static constexpr std::string_view known[] = {"scenario", "reader", "tags"};
        for (auto& entry : root_) {
            if (std::ranges::find(known, entry.key) != std::end(known)) continue;
            auto near = nearest(entry.key, known);
            auto shown = near == "scenario" ? "[scenario]" : fmt::format("[[{}]]", near);
            findings_.error(entry.at, fmt::format("unknown section \"{}\"", printable(entry.key)),
                            near.empty() ? "sections: [scenario], [[reader]], [[tags]]"
                                         : fmt::format("did you mean {}?", shown));
        }
    }

    // The tables of a section that may stand several times.
    std::vector<const Node*> items(const Node::Table& table, std::string_view key, std::string_view path) {
        std::vector<const Node*> found;
        auto* entry = find(table, key);
        if (entry == nullptr) return found;
        auto* list = entry->value.get<Node::List>();
        if (list == nullptr) {
            findings_.error(entry->at, fmt::format("{} is {}", path, entry->value.kind()),
                            fmt::format("there may be several: write [[{}]]", path));
            return found;
        }
        for (auto& node : *list) {
            if (node.get<Node::Table>() != nullptr)
                found.push_back(&node);
            else
                findings_.error(node.at, fmt::format("{} is a list with {} in it", path, node.kind()),
                                fmt::format("write each as a section [[{}]]", path));
        }
        return found;
    }

    // `below`: keys that are sections of their own.
    Section section(const Node::Table& table, Place at, ScenarioSection which,
                    std::initializer_list<std::string_view> below = {}) {
        auto& rows = scenario_rows(which);
        auto where = rows.repeated ? fmt::format("[[{}]]", rows.path) : fmt::format("[{}]", rows.path);
        auto checked = document::check_section(table, at, rows, where, findings_);
        auto known = keys_of(rows);
        known.insert(known.end(), below.begin(), below.end());
        for (auto* other : checked.others)
            if (std::ranges::find(below, other->key) == below.end())
                document::unknown_key(*other, where, known, findings_);
        return checked;
    }

    void about() {
        auto* entry = find(root_, "scenario");
        auto* table = entry == nullptr ? nullptr : entry->value.get<Node::Table>();
        if (table == nullptr) {
            findings_.error(entry == nullptr ? Place{} : entry->at, "there is no section [scenario]",
                            "begin with [scenario] and name = \"my-scene\"");
            return;
        }
        auto given = section(*table, entry->value.at, ScenarioSection::scenario);
        scenario_.name = given.get<std::string>("name").value_or("");
        scenario_.about = given.get<std::string>("about").value_or("");
        scenario_.seed = static_cast<std::uint64_t>(given.get<std::int64_t>("seed").value_or(1));
        scenario_.lasts = given.get<microseconds>("lasts").value_or(10s);
        too_long(given, "lasts");
        scenario_.region = given.get<std::string>("region") == "us" ? Region::us : Region::eu;
        scenario_.path_loss = given.get<double>("path_loss").value_or(scenario_.path_loss);
        scenario_.echo_db = given.get<double>("echo_db").value_or(scenario_.echo_db);
    }

    void too_long(const Section& given, std::string_view key) {
        if (given.get<microseconds>(key).value_or(0us) > 24h)
            findings_.error(given.place(key), fmt::format("{} is over a day", key),
                            "it may be \"24h\" at most");
    }

    void reader(const Node& node) {
        auto& table = *node.get<Node::Table>();
        auto given = section(table, node.at, ScenarioSection::reader, {"antenna", "settings"});
        ReaderSpec reader;
        reader.at = node.at;
        reader.name = given.get<std::string>("name").value_or("");
        if (!reader.name.empty() && !reader_names_.insert(reader.name).second)
            findings_.error(given.place("name"),
                            fmt::format("there is a reader \"{}\" already", printable(reader.name)),
                            "names must differ");
        check_make(given, reader);
        auto located = [&](std::string_view key) -> std::optional<Located> {
            auto text = given.get<std::string>(key);
            if (!text) return {};
            return Located{*text, given.place(key)};
        };
        reader.connect = located("connect");
        reader.listen = located("listen");
        reader.pty = located("pty");
        if (reader.connect.has_value() + reader.listen.has_value() + reader.pty.has_value() > 1)
            findings_.error(node.at, "connect, listen and pty are ways to reach a reader, and it has one",
                            "keep one of them");
        reader.session = static_cast<std::uint8_t>(given.get<std::int64_t>("session").value_or(0));
        reader.q = static_cast<std::uint8_t>(given.get<std::int64_t>("q").value_or(4));
        auto mode = given.get<std::string>("mode").value_or("balanced");
        for (auto each : {LinkMode::fast, LinkMode::balanced, LinkMode::dense})
            if (name_of(each) == mode) reader.mode = each;
        reader.anticollision = given.get<bool>("anticollision").value_or(true);
        if (auto* entry = find(table, "settings")) settings(*entry, reader);
        for (auto* each : items(table, "antenna", "reader.antenna"))
            antenna(*each, reader);
        if (reader.antennas.empty() && find(table, "antenna") == nullptr)
            findings_.error(node.at, fmt::format("reader \"{}\" has no antenna", printable(reader.name)),
                            "add a [[reader.antenna]] with position and towards");
        if (reader.antennas.size() > most_antennas)
            findings_.error(node.at, fmt::format("{} antennas; {} are the most a reader has",
                                                 reader.antennas.size(), most_antennas));
        scenario_.readers.push_back(std::move(reader));
    }

    void check_make(const Section& given, ReaderSpec& reader) {
        reader.make = given.get<std::string>("make").value_or("any");
        if (reader.make == "any" || std::ranges::find(makes_, reader.make) != makes_.end()) return;
        std::vector<std::string_view> known(makes_.begin(), makes_.end());
        known.emplace_back("any");
        auto near = nearest(reader.make, known);
        findings_.error(given.place("make"),
                        fmt::format("make = \"{}\" is not known", printable(reader.make)),
                        near.empty() ? fmt::format("makes: {}", fmt::join(known, ", "))
                                     : fmt::format("did you mean \"{}\"?", near));
    }

    // What they are only the make can say; here they become text, as on the command line.
    void settings(const Entry& entry, ReaderSpec& reader) {
        auto* table = entry.value.get<Node::Table>();
        if (table == nullptr) {
            findings_.error(entry.value.at, fmt::format("settings is {}", entry.value.kind()),
                            "write settings = { name = \"value\" }");
            return;
        }
        for (auto& each : *table) {
            Located value{{}, each.value.at};
            if (auto* text = each.value.get<std::string>())
                value.text = *text;
            else if (auto* yes = each.value.get<bool>())
                value.text = *yes ? "true" : "false";
            else if (auto* whole = each.value.get<std::int64_t>())
                value.text = fmt::format("{}", *whole);
            else if (auto* number = each.value.get<double>())
                value.text = fmt::format("{}", *number);
            else
                findings_.error(each.value.at,
                                fmt::format("{} is {}", printable(each.key), each.value.kind()),
                                "a setting is text in quotes, a number, true or false");
            reader.settings.emplace_back(each.key, std::move(value));
        }
    }

    void antenna(const Node& node, ReaderSpec& reader) {
        auto given = section(*node.get<Node::Table>(), node.at, ScenarioSection::antenna);
        AntennaSpec antenna;
        antenna.name = given.get<std::string>("name").value_or(fmt::format("{}", reader.antennas.size() + 1));
        antenna.position = vec(given.get<document::Point>("position").value_or(document::Point{}));
        antenna.towards = vec(given.get<document::Point>("towards").value_or(document::Point{}));
        bool both = given.items.contains("position") && given.items.contains("towards");
        if (both && length(antenna.towards - antenna.position) < 1e-3)
            findings_.error(given.place("towards"), "the antenna looks at the point where it is",
                            "name another point that it looks at");
        antenna.band = given.get<std::string>("band") == "hf" ? Band::hf : Band::uhf;
        antenna.gain_dbi = given.get<double>("gain_dbi").value_or(antenna.gain_dbi);
        antenna.beam = given.get<double>("beam").value_or(beam_of(antenna.gain_dbi));
        antenna.power_dbm = given.get<double>("power_dbm").value_or(antenna.power_dbm);
        antenna.reach = given.get<double>("reach").value_or(antenna.reach);
        if (antenna.reach < 0.01)
            findings_.error(given.place("reach"), fmt::format("reach = {} is too short", antenna.reach),
                            "it must be at least 0.01");
        for (auto* key : {"gain_dbi", "beam"})
            wrong_band(given, key, antenna.band == Band::hf, "UHF");
        wrong_band(given, "reach", antenna.band == Band::uhf, "HF");
        reader.antennas.push_back(std::move(antenna));
    }
    void wrong_band(const Section& given, std::string_view key, bool wrong, std::string_view band) {
        auto it = given.items.find(key);
        if (!wrong || it == given.items.end() || !it->second.given) return;
        findings_.error(it->second.at, fmt::format("{} is for {} antennas", key, band),
                        "remove it, or choose the other band");
    }

    void tags(const Node& node) {
        auto& table = *node.get<Node::Table>();
        auto given = section(table, node.at, ScenarioSection::tags, {"motion"});
        TagGroup group;
        group.name = given.get<std::string>("name").value_or("");
        if (!group.name.empty() && !group_names_.insert(group.name).second)
            findings_.error(given.place("name"),
                            fmt::format("there is a group \"{}\" already", printable(group.name)),
                            "names must differ");
        group.technology = event::parse_technology(given.get<std::string>("technology").value_or(""))
                               .value_or(event::Technology::epc_gen2);
        group.position = vec(given.get<document::Point>("position").value_or(document::Point{}));
        layout(given, group);
        if (auto spacing = given.get<document::Point>("spacing")) group.spacing = vec(*spacing);
        group.jitter = given.get<double>("jitter").value_or(0);
        if (auto axis = given.get<document::Point>("axis")) {
            group.axis = vec(*axis);
            if (length(*group.axis) < 1e-6)
                findings_.error(given.place("axis"), "axis has no direction",
                                "write it like [1, 0, 0], or leave it out");
        }
        group.sensitivity_dbm = given.get<double>("sensitivity_dbm").value_or(group.sensitivity_dbm);
        group.spread_db = given.get<double>("spread_db").value_or(group.spread_db);
        group.loss_db = given.get<double>("loss_db").value_or(group.loss_db);
        first_id(given, group);
        if (auto* entry = find(table, "motion")) motion(*entry, group);
        scenario_.groups.push_back(std::move(group));
    }

    void layout(const Section& given, TagGroup& group) {
        auto count = given.get<std::int64_t>("count");
        auto grid = given.get<document::Point>("grid");
        if (!grid) {
            group.count = static_cast<std::uint32_t>(count.value_or(1));
            group.grid[0] = group.count;
            return;
        }
        double places = 1;
        for (std::size_t i = 0; i < 3; ++i) {
            if ((*grid)[i] != std::floor((*grid)[i])) {
                findings_.error(given.place("grid"), fmt::format("grid holds {}", (*grid)[i]),
                                "expected whole numbers: grid = [5, 5, 8]");
                return;
            }
            group.grid[i] = static_cast<std::uint32_t>((*grid)[i]);
            places *= (*grid)[i];
        }
        if (places > most_tags) {
            findings_.error(given.place("grid"), fmt::format("grid has {} places", places),
                            fmt::format("a scenario has {} tags at most", most_tags));
            return;
        }
        group.count = static_cast<std::uint32_t>(count.value_or(static_cast<std::int64_t>(places)));
        if (group.count > places)
            findings_.error(
                given.place("count"),
                fmt::format("count = {} is more than the {} places of the grid", group.count, places),
                "make the grid larger, or leave count out");
    }

    void first_id(const Section& given, TagGroup& group) {
        auto text = given.get<std::string>("first_id");
        if (!text) return;
        auto at = given.place("first_id");
        auto bytes = from_hex(*text);
        if (!bytes) {
            findings_.error(at, fmt::format("first_id = \"{}\" is not hex", printable(*text)),
                            "write two digits for each byte");
            return;
        }
        auto technology = event::to_text(group.technology);
        auto uid = uid_size(group.technology);
        if (uid != 0 && bytes->size() != uid)
            findings_.error(at, fmt::format("first_id has {} bytes", bytes->size()),
                            fmt::format("the UID of an {} tag has {}", technology, uid));
        if (uid == 0 &&
            (bytes->size() % 2 != 0 || bytes->size() < 4 || bytes->size() > event::TagId::max_size))
            findings_.error(at, fmt::format("first_id has {} bytes", bytes->size()),
                            fmt::format("the EPC of an {} tag has an even number, 4 to {}", technology,
                                        std::size_t{event::TagId::max_size}));
        group.first_id = std::move(*bytes);
    }

    void motion(const Entry& entry, TagGroup& group) {
        auto* table = entry.value.get<Node::Table>();
        if (table == nullptr) {
            findings_.error(entry.value.at, fmt::format("motion is {}", entry.value.kind()),
                            "write it as a section [tags.motion]");
            return;
        }
        auto given = section(*table, entry.value.at, ScenarioSection::motion);
        for (auto* key : {"lasts", "starts", "interval", "every"})
            too_long(given, key);
        MotionSpec motion;
        for (auto& point :
             given.get<std::vector<document::Point>>("path").value_or(std::vector<document::Point>{}))
            motion.path.push_back(vec(point));
        if (given.items.contains("path") && motion.path.size() < 2)
            findings_.error(given.place("path"), "a path has two points at least",
                            "expected path = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]");
        if (motion.path.size() > 1000) findings_.error(given.place("path"), "the path has over 1000 points");
        motion.lasts = given.get<microseconds>("lasts").value_or(1s);
        motion.starts = given.get<microseconds>("starts").value_or(0s);
        motion.interval = given.get<microseconds>("interval").value_or(0s);
        motion.spread = given.get<double>("spread").value_or(0);
        motion.every = given.get<microseconds>("every");
        motion.stays = given.get<std::string>("outside") == "stays";
        if (motion.spread > 0.9)
            findings_.error(given.place("spread"), fmt::format("spread = {} is too much", motion.spread),
                            "it may be 0.9 at most: some are ten times as fast as others then");
        else if (motion.every && std::chrono::duration<double>(motion.lasts) / (1 - motion.spread) >
                                     std::chrono::duration<double>(*motion.every))
            findings_.error(
                given.place("every"), "the next round would begin before the slowest tag has ended its",
                fmt::format("every must be longer than {}",
                            to_text(microseconds(std::llround(static_cast<double>(motion.lasts.count()) /
                                                              (1 - motion.spread))))));
        group.motion = std::move(motion);
    }

    const Node::Table& root_;
    Findings findings_;
    std::span<const std::string_view> makes_;
    Scenario scenario_;
    std::set<std::string, std::less<>> reader_names_, group_names_;
};
}  // namespace

std::size_t Scenario::tags() const {
    std::size_t sum = 0;
    for (auto& group : groups)
        sum += group.count;
    return sum;
}

Result<Scenario> parse_scenario(std::string_view toml, std::string_view file_name,
                                std::span<const std::string_view> makes) {
    auto root = document::parse_document(toml);
    if (root) return ScenarioCheck(*root->get<Node::Table>(), file_name, makes).run();
    Findings findings(file_name);
    findings.error(root.error().at, root.error().what);
    return fail(findings.errors());
}

std::string_view name_of(LinkMode mode) {
    static constexpr std::string_view names[] = {"fast", "balanced", "dense"};
    return names[static_cast<std::size_t>(mode)];
}

}  // namespace gantry::field
