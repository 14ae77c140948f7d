#include <algorithm>
#include <map>
#include <set>

#include <fmt/format.h>

#include "base/text.hpp"
#include "gateway/config_makes.hpp"
#include "gateway/config_settings.hpp"
#include "link/link.hpp"

namespace gantry::gateway {

namespace {
bool is_pattern(std::string_view name) {
    return name.find('*') != std::string_view::npos;
}

class ReaderCheck {
public:
    ReaderCheck(Makes makes, Findings& findings) : makes_(makes), findings_(findings) {}

    void check(const Node& node) {
        auto* table = node.get<Node::Table>();
        if (table == nullptr) {
            findings_.error(node.at, fmt::format("reader is a list with {} in it", node.kind()),
                            "write each reader as a section [[reader]]");
            return;
        }
        section_ = check_section(*table, node.at, config_section("reader"), "[[reader]]", findings_);
        reader_ = {};
        reader_.name = section_.get<std::string>("name").value_or("");
        reader_.zone = section_.get<std::string>("zone").value_or("");
        check_address();
        check_from();
        check_name();
        check_model();
        check_notify();
        antennas_ = nullptr;
        check_others();
        if (antennas_ != nullptr) check_antennas(*antennas_);
        readers.push_back(std::move(reader_));
    }

    std::vector<ReaderConfig> readers;
    std::vector<ReadGap> gaps;

private:
    bool listens() const { return reader_.address.scheme->kind == LinkKind::listen; }

    void check_address() {
        auto text = section_.get<std::string>("address");
        if (!text) return;
        auto address = parse_address(*text, makes_);
        if (!address) {
            findings_.error(section_.place("address"), address.error().what, address.error().hint);
            return;
        }
        reader_.address = std::move(*address);
        auto line = section_.place("address").line;
        // Many readers may dial in at one address, as long as they speak one protocol there; a dialled
        // address or a serial line is one reader's own.
        auto& a = reader_.address;
        auto key = listens() ? fmt::format("listen {}:{}", a.host, a.port)
                             : fmt::format("{}:{}{}", a.host, a.port, a.path);
        auto [it, first] = addresses_.try_emplace(key, a.scheme, line);
        bool shared = listens() && (a.port == 0 || it->second.first == a.scheme);
        if (!first && !shared)
            findings_.error(section_.place("address"),
                            fmt::format("address \"{}\" is taken by the reader at line {}", printable(a.text),
                                        it->second.second),
                            listens() ? "give each protocol a port of its own" : "one reader, one section");
    }

    void check_from() {
        auto networks = section_.get<std::vector<std::string>>("from");
        if (!networks) return;
        auto at = section_.place("from");
        for (auto& network : *networks)
            if (!link::is_network(network))
                findings_.error(at, fmt::format("from = \"{}\" is no network", printable(network)),
                                "write it like \"192.168.0.0/24\", \"10.0.0.7\" or \"fe80::/10\"");
        if (reader_.address.scheme != nullptr && !listens())
            findings_.error(at, "from is for readers that dial in, and this one is dialled", "remove it");
        reader_.from = std::move(*networks);
    }

    void check_model() {
        auto model = section_.get<std::string>("model");
        auto* make = reader_.address.plugin;
        if (!model || make == nullptr) return;
        auto at = section_.place("model");
        if (make->models.empty())
            return findings_.error(at, fmt::format("{} readers have no choice of model", make->name),
                                   "remove it");
        if (std::ranges::find(make->models, *model) == make->models.end()) {
            auto near = nearest(*model, make->models);
            return findings_.error(at, fmt::format("{} knows no model \"{}\"", make->name, printable(*model)),
                                   near.empty() ? fmt::format("models: {}", fmt::join(make->models, ", "))
                                                : fmt::format("did you mean \"{}\"?", near));
        }
        reader_.model = std::move(*model);
    }

    void check_notify() {
        auto notify = section_.get<std::string>("notify");
        auto advertise = section_.get<std::string>("advertise");
        auto* make = reader_.address.plugin;
        if (make == nullptr) return;
        if (advertise && !notify)
            findings_.error(section_.place("advertise"), "advertise says where notify is, and there is none",
                            "add notify = \"0.0.0.0:3000\", or remove it");
        if (!notify) return;
        auto at = section_.place("notify");
        // Who dials in there is told by its address: that of the link we dialled.
        if (!make->notifies || reader_.address.scheme->kind != LinkKind::dial)
            return findings_.error(at,
                                   fmt::format("readers at {}:// do not dial in with notifications",
                                               reader_.address.scheme->name),
                                   "remove it");
        auto endpoint = link::parse_endpoint(*notify);
        if (!endpoint) return findings_.error(at, endpoint.error().what, endpoint.error().hint);
        auto key = fmt::format("{} {}", reader_.address.host, link::to_text(*endpoint));
        auto [it, first] = notified_.try_emplace(key, at.line);
        if (!first && endpoint->port != 0)
            findings_.error(at,
                            fmt::format("the reader at line {} has the same host and notify port: their "
                                        "notifications could not be told apart",
                                        it->second),
                            "give this one a notify port of its own");
        if (advertise) {
            auto told = link::parse_endpoint(*advertise);
            if (!told || told->host.empty() || told->port == 0)
                findings_.error(section_.place("advertise"),
                                fmt::format("advertise = \"{}\" is no address a reader could dial",
                                            printable(*advertise)),
                                "write it like \"192.168.0.10:3000\"");
            reader_.advertise = std::move(*advertise);
        }
        reader_.notify = std::move(*notify);
    }

    void check_name() {
        if (reader_.name.empty() || reader_.address.scheme == nullptr) return;
        auto at = section_.place("name");
        auto shown = printable(reader_.name);
        if (is_pattern(reader_.name) && !listens()) {
            findings_.error(at, fmt::format("name = \"{}\": a * is for readers that dial in", shown),
                            "give this reader a name of its own");
            return;
        }
        // One pattern may serve several addresses; a name is one reader's for the whole gateway.
        auto& a = reader_.address;
        auto key = is_pattern(reader_.name)
                       ? fmt::format("{} at {} {}:{}", reader_.name, a.scheme->name, a.host, a.port)
                       : reader_.name;
        auto [it, first] = names_.try_emplace(key, at.line);
        if (!first)
            findings_.error(at, fmt::format("reader \"{}\" is already defined at line {}", shown, it->second),
                            "names must differ");
    }

    // Keys that every make shares are rows; what is left is the make's own, or a slip.
    void check_others() {
        auto* make = reader_.address.plugin;
        std::vector<std::string_view> known;
        for (auto& row : config_section("reader").rows)
            known.push_back(row.key);
        known.push_back("antenna");
        std::set<std::string_view> any_make;
        for (auto* each : makes_)
            for (auto& row : each->driver_settings)
                any_make.insert(row.name);
        if (make != nullptr)
            for (auto& row : make->driver_settings)
                known.push_back(row.name);
        SettingsCheck own(make == nullptr ? std::span<const SettingRow>() : make->driver_settings, findings_);
        for (auto* entry : section_.others) {
            if (entry->key == "antenna") {
                antennas_ = entry;
            } else if (own.take(*entry)) {
                continue;
            } else if (any_make.contains(entry->key)) {
                if (make != nullptr)  // else the bad address has been reported already
                    findings_.error(entry->at,
                                    fmt::format("{} readers have no setting \"{}\"", make->name, entry->key),
                                    "remove it");
            } else {
                unknown_key(*entry, "[[reader]]", known, findings_);
            }
        }
        for (auto& given : own.given())
            if (auto gap = given.row->between_reads ? parse_duration(given.text) : std::nullopt)
                gaps.push_back({readers.size(), given.at, given.row->name, *gap});
        if (auto settings = make == nullptr ? std::nullopt : own.settings())
            reader_.settings = std::move(*settings);
    }

    void check_antennas(const Entry& entry) {
        auto* list = entry.value.get<Node::List>();
        if (list == nullptr) {
            findings_.error(entry.at, fmt::format("antenna is {}", entry.value.kind()),
                            "write each antenna as a section [[reader.antenna]]");
            return;
        }
        std::map<std::string, std::uint32_t, std::less<>> lines;
        for (auto& node : *list) {
            auto* table = node.get<Node::Table>();
            if (table == nullptr) {
                findings_.error(node.at, fmt::format("antenna is a list with {} in it", node.kind()),
                                "write each antenna as a section [[reader.antenna]]");
                continue;
            }
            auto& rows = config_section("reader.antenna");
            auto antenna = check_section(*table, node.at, rows, "[[reader.antenna]]", findings_);
            std::vector<std::string_view> known;
            for (auto& row : rows.rows)
                known.push_back(row.key);
            for (auto* other : antenna.others)
                unknown_key(*other, "[[reader.antenna]]", known, findings_);
            auto name = antenna.get<std::string>("name");
            auto zone = antenna.get<std::string>("zone");
            if (!name || !zone) continue;
            auto [it, first] = lines.try_emplace(*name, antenna.place("name").line);
            if (!first)
                findings_.error(antenna.place("name"),
                                fmt::format("antenna \"{}\" has a zone already, at line {}", printable(*name),
                                            it->second),
                                "one section an antenna");
            check_antenna_name(*name, antenna.place("name"));
            reader_.antennas.push_back({std::move(*name), std::move(*zone)});
        }
    }

    void check_antenna_name(const std::string& name, Place at) {
        auto* make = reader_.address.plugin;
        if (make == nullptr) return;
        constexpr std::uint16_t most = 256;  // no make counts further in its reports
        for (std::uint16_t number = 0; number < most; ++number)
            if (make->antenna_name(number) == name) return;
        findings_.error(
            at, fmt::format("{} readers have no antenna \"{}\"", make->name, printable(name)),
            fmt::format("theirs are called \"{}\", \"{}\", …", make->antenna_name(1), make->antenna_name(2)));
    }

    Makes makes_;
    Findings& findings_;
    Section section_;
    ReaderConfig reader_;
    const Entry* antennas_ = nullptr;
    std::map<std::string, std::pair<const Scheme*, std::uint32_t>> addresses_;
    std::map<std::string, std::uint32_t> names_;
    std::map<std::string, std::uint32_t> notified_;
};
}  // namespace

std::vector<ReaderConfig> check_readers(const Node::List& readers, Makes makes, Findings& findings,
                                        std::vector<ReadGap>& gaps) {
    ReaderCheck check(makes, findings);
    for (auto& node : readers)
        check.check(node);
    gaps = std::move(check.gaps);
    return std::move(check.readers);
}

}  // namespace gantry::gateway
