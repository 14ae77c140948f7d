// The [[sink]] sections.
#include <algorithm>
#include <map>

#include <fmt/format.h>

#include "base/text.hpp"
#include "gateway/config_makes.hpp"
#include "gateway/config_settings.hpp"

namespace gantry::gateway {

namespace {
class SinkCheck {
public:
    SinkCheck(Kinds kinds, Findings& findings) : kinds_(kinds), findings_(findings) {}

    void check(const Node& node) {
        auto* table = node.get<Node::Table>();
        if (table == nullptr) {
            findings_.error(node.at, fmt::format("sink is a list with {} in it", node.kind()),
                            "write each sink as a section [[sink]]");
            return;
        }
        section_ = check_section(*table, node.at, config_section("sink"), "[[sink]]", findings_);
        sink_ = {};
        check_name();
        check_type();
        check_url();
        check_selection();
        sink_.from_oldest = section_.get<std::string>("start") == "oldest";
        sink_.shape =
            sink::parse_shape(section_.get<std::string>("shape").value_or("")).value_or(sink_.shape);
        if (auto batch = section_.get<std::int64_t>("batch"))
            sink_.batch = static_cast<std::size_t>(*batch);
        else if (sink_.kind != nullptr)
            sink_.batch = sink_.kind->batch;
        sink_.max_rate = static_cast<std::uint64_t>(section_.get<std::int64_t>("max_rate").value_or(0));
        sink_.tries = static_cast<std::uint64_t>(section_.get<std::int64_t>("tries").value_or(1));
        sink_.commands = section_.get<bool>("commands").value_or(false);
        take("timeout", sink_.timeout);
        take("retry_min", sink_.retry_min);
        take("retry_max", sink_.retry_max);
        if (sink_.retry_max < sink_.retry_min)
            findings_.error(section_.place("retry_max"), "retry_max is shorter than retry_min",
                            "make it longer");
        check_others();
        sinks.push_back(std::move(sink_));
    }

    std::vector<SinkConfig> sinks;

private:
    void take(std::string_view key, std::chrono::microseconds& into) {
        into = section_.get<std::chrono::microseconds>(key).value_or(into);
    }

    void check_name() {
        sink_.name = section_.get<std::string>("name").value_or("");
        if (sink_.name.empty()) return;
        auto at = section_.place("name");
        auto allowed = [](char c) {
            return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                   c == '_' || c == '.';
        };
        if (!std::ranges::all_of(sink_.name, allowed))
            findings_.error(at, fmt::format("name = \"{}\" is no name for a sink", printable(sink_.name)),
                            "use letters, digits, '-', '_' and '.'");
        auto [it, first] = names_.try_emplace(sink_.name, at.line);
        if (!first)
            findings_.error(
                at,
                fmt::format("sink \"{}\" is already defined at line {}", printable(sink_.name), it->second),
                "names must differ");
    }

    void check_type() {
        auto type = section_.get<std::string>("type");
        if (!type) return;
        std::vector<std::string_view> names;
        for (auto* kind : kinds_) {
            if (kind->name == *type) sink_.kind = kind;
            names.push_back(kind->name);
        }
        if (sink_.kind != nullptr) return;
        auto near = nearest(*type, names);
        findings_.error(section_.place("type"),
                        fmt::format("there is no kind of sink \"{}\"", printable(*type)),
                        near.empty() ? fmt::format("kinds: {}", fmt::join(names, ", "))
                                     : fmt::format("did you mean \"{}\"?", near));
    }

    void check_url() {
        auto url = section_.get<std::string>("url");
        if (sink_.kind == nullptr) return;
        auto& kind = *sink_.kind;
        if (kind.schemes.empty()) {
            if (url)
                findings_.error(section_.place("url"), fmt::format("{} takes no url", kind.name),
                                "remove it");
            return;
        }
        auto forms = [&] {
            std::vector<std::string> all;
            for (auto scheme : kind.schemes)
                all.push_back(fmt::format("{}://…", scheme));
            return fmt::format("{}", fmt::join(all, " or "));
        };
        if (!url) {
            findings_.error(section_.at, fmt::format("[[sink]] of type {} needs a url", kind.name),
                            fmt::format("add url = \"{}\"", forms()));
            return;
        }
        auto at = section_.place("url");
        auto end = url->find("://");
        auto scheme = std::string_view(*url).substr(0, end == std::string::npos ? 0 : end);
        // "user:secret@" would be in every log and status that shows the url, the next error included.
        auto authority = std::string_view(*url).substr(end == std::string::npos ? 0 : end + 3);
        authority = authority.substr(0, authority.find_first_of("/?#"));
        auto at_sign = authority.rfind('@');
        if (at_sign != std::string_view::npos &&
            authority.substr(0, at_sign).find(':') != std::string_view::npos)
            return findings_.error(at, "a password does not stand in a url",
                                   "write password_file = \"/path\" or password_env = \"VARIABLE\"");
        if (std::ranges::find(kind.schemes, scheme) == kind.schemes.end())
            return findings_.error(
                at, fmt::format("url = \"{}\" is none that {} takes", printable(*url), kind.name),
                fmt::format("write {}", forms()));
        sink_.url = std::move(*url);
    }

    void check_selection() {
        auto texts = [&](std::string_view key) {
            return section_.get<std::vector<std::string>>(key).value_or(std::vector<std::string>{});
        };
        auto& selection = sink_.selection;
        selection.readers = texts("readers");
        selection.zones = texts("zones");
        selection.tags = texts("tags");
        for (auto& pattern : selection.tags) {
            if (pattern.starts_with("urn:")) continue;
            for (auto& c : pattern)
                if (c >= 'a' && c <= 'f') c = static_cast<char>(c - 'a' + 'A');
            if (pattern.empty() || pattern.find_first_not_of("0123456789ABCDEF*") != std::string::npos)
                findings_.error(
                    section_.place("tags"),
                    fmt::format("tags = \"{}\" is neither hex nor an EPC URI", printable(pattern)),
                    "write it like \"3074*\" or \"urn:epc:id:sgtin:0614141.*\"");
        }
        for (auto& pattern : texts("types")) {
            auto before = selection.types.size();
            std::vector<std::string_view> names;
            for (auto& [type, name] : event::all_types()) {
                names.push_back(name);
                if (matches(pattern, name)) selection.types.push_back(type);
            }
            if (selection.types.size() != before) continue;
            auto near = nearest(pattern, names);
            findings_.error(section_.place("types"),
                            fmt::format("there is no event type \"{}\"", printable(pattern)),
                            near.empty() ? fmt::format("types: {}", fmt::join(names, ", "))
                                         : fmt::format("did you mean \"{}\"?", near));
        }
    }

    void check_others() {
        auto* kind = sink_.kind;
        if (kind != nullptr && sink_.commands && !kind->takes_requests)
            findings_.error(section_.place("commands"),
                            fmt::format("no requests come in over {}", kind->name), "remove it");
        SettingsCheck own(kind == nullptr ? std::span<const SettingRow>() : kind->settings, findings_);
        std::vector<std::string_view> known;
        for (auto& row : config_section("sink").rows)
            if (row.key != "url" || kind == nullptr || !kind->schemes.empty()) known.push_back(row.key);
        if (kind != nullptr)
            for (auto& row : kind->settings)
                known.push_back(row.name);
        for (auto* entry : section_.others) {
            if (own.take(*entry)) continue;
            bool of_another = std::ranges::any_of(kinds_, [&](auto* each) {
                return std::ranges::find(each->settings, entry->key, &SettingRow::name) !=
                       each->settings.end();
            });
            if (kind == nullptr) {
                // All that can be said: it looks like a slip of a key that every sink has.
                if (!of_another && !nearest(entry->key, known).empty())
                    unknown_key(*entry, "[[sink]]", known, findings_);
            } else if (of_another)
                findings_.error(entry->at,
                                fmt::format("{} sinks have no setting \"{}\"", kind->name, entry->key),
                                "remove it");
            else
                unknown_key(*entry, "[[sink]]", known, findings_);
        }
        if (kind == nullptr) return;
        auto settings = own.settings();
        if (!settings) return;
        sink_.settings = std::move(*settings);
        // What no row says: settings that contradict each other, a file that is not there.
        struct Nobody : sink::Host {
            std::vector<sink::ReaderState> readers() override { return {}; }
            void request(std::string_view, std::string, std::function<void(std::string)>) override {}
        } nobody;
        if (!sink_.url.empty() || kind->schemes.empty())
            if (auto made = kind->make({.name = sink_.name,
                                        .gateway_id = "check",
                                        .url = sink_.url,
                                        .settings = sink_.settings,
                                        .batch = sink_.batch},
                                       nobody);
                !made)
                findings_.error(section_.at, made.error().what, made.error().hint);
    }

    Kinds kinds_;
    Findings& findings_;
    Section section_;
    SinkConfig sink_;
    std::map<std::string, std::uint32_t> names_;
};
}  // namespace

std::vector<SinkConfig> check_sinks(const Node::List& sinks, Kinds kinds, Findings& findings) {
    SinkCheck check(kinds, findings);
    for (auto& node : sinks)
        check.check(node);
    return std::move(check.sinks);
}

}  // namespace gantry::gateway
