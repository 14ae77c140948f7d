#pragma once
#include <array>
#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/error.hpp"
#include "document/document.hpp"
#include "document/rows.hpp"

// Checks a file's tree against the rows, and collects everything there is to say about it.
namespace gantry::document {

class Findings {
public:
    explicit Findings(std::string_view file) : file_(file) {}
    void error(Place at, const std::string& what, const std::string& hint = {});
    void warning(Place at, const std::string& what);
    bool failed() const { return !errors_.empty(); }
    // "file:line:column: what; hint" in the order of the file, at most max_errors of them.
    std::string errors() const;
    std::vector<std::string> warnings() const;
    static constexpr std::size_t max_errors = 50;

private:
    using Lines = std::multimap<Place, std::string>;
    std::string_view file_;
    Lines errors_, warnings_;
};

struct Never {};
using Point = std::array<double, 3>;
using Checked = std::variant<bool, std::int64_t, double, std::string, std::chrono::microseconds,
                             std::vector<std::string>, Point, std::vector<Point>, Never>;

// The good values of one table by their keys; what the file left out is there with its row's fallback.
class Section {
public:
    struct Item {
        Place at;  // of the value; of the table for a fallback
        Checked value;
        bool given = false;
    };
    Place at;  // of the table
    std::map<std::string, Item, std::less<>> items;
    std::vector<const Entry*> others;  // keys that no row has

    // Nothing when the key was neither given (rightly) nor has a fallback.
    template <class T>
    std::optional<T> get(std::string_view key) const {
        auto it = items.find(key);
        if (it == items.end()) return {};
        auto* value = std::get_if<T>(&it->second.value);
        return value == nullptr ? std::nullopt : std::optional<T>(*value);
    }
    bool is_never(std::string_view key) const { return get<Never>(key).has_value(); }
    Place place(std::string_view key) const {
        auto it = items.find(key);
        return it == items.end() ? at : it->second.at;
    }
};

// `where` names the table for a person: "[presence]", "[[reader]]".
Section check_section(const Node::Table& table, Place at, const SectionRows& section, std::string_view where,
                      Findings& findings);

// "unknown key …" with the nearest of `known`, or all of them.
void unknown_key(const Entry& entry, std::string_view where, std::span<const std::string_view> known,
                 Findings& findings);

// "8GiB", "512MiB", "1.5GB", "100000B". Nothing when it is none of these.
std::optional<std::int64_t> parse_size(std::string_view text);

}  // namespace gantry::document
