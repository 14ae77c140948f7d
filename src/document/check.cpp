#include "document/check.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

#include "base/text.hpp"
#include "base/time.hpp"

namespace gantry::document {

void Findings::error(Place at, const std::string& what, const std::string& hint) {
    errors_.emplace(at, Error{what, hint}.text());
}

void Findings::warning(Place at, const std::string& what) {
    warnings_.emplace(at, what);
}

std::string Findings::errors() const {
    std::string out;
    std::size_t count = 0;
    for (auto& [at, text] : errors_) {
        if (count++ == max_errors) {
            out += fmt::format("\n{}: and {} errors more", file_, errors_.size() - max_errors);
            break;
        }
        out += fmt::format("{}{}:{}:{}: {}", out.empty() ? "" : "\n", file_, at.line, at.column, text);
    }
    return out;
}

std::vector<std::string> Findings::warnings() const {
    std::vector<std::string> out;
    for (auto& [at, text] : warnings_)
        out.push_back(fmt::format("{}:{}:{}: {}", file_, at.line, at.column, text));
    return out;
}

std::optional<std::int64_t> parse_size(std::string_view text) {
    struct Unit {
        std::string_view name;
        double bytes;
    };
    static constexpr Unit units[] = {
        {"B", 1},     {"kB", 1e3},     {"KB", 1e3},        {"MB", 1e6},           {"GB", 1e9},
        {"TB", 1e12}, {"KiB", 1024.0}, {"MiB", 1048576.0}, {"GiB", 1073741824.0}, {"TiB", 1099511627776.0},
    };
    double number = 0;
    auto [end, error] =
        std::from_chars(text.data(), text.data() + text.size(), number, std::chars_format::fixed);
    if (error != std::errc{} || !(number >= 0)) return {};
    std::string_view name(end, static_cast<std::size_t>(text.data() + text.size() - end));
    for (auto& unit : units)
        if (unit.name == name && number * unit.bytes < 9e18) return std::llround(number * unit.bytes);
    return {};
}

namespace {
constexpr std::string_view duration_hint = "write it like \"500ms\", \"2s\", \"5min\", \"1h\" or \"30d\"";

std::string expected(const Row& row) {
    switch (row.kind) {
        case Row::Kind::name:
            return "expected text in quotes";
        case Row::Kind::texts:
            return fmt::format("expected a list: {} = [\"{}\"]", row.key, row.sample);
        case Row::Kind::boolean:
            return "expected true or false";
        case Row::Kind::count:
            return "expected a whole number";
        case Row::Kind::number:
            return "expected a number";
        case Row::Kind::point:
            return fmt::format("expected three numbers: {} = [1.0, 0.5, 2.0]", row.key);
        case Row::Kind::points:
            return fmt::format("expected a list of threes: {} = [[0.0, 0.0, 0.0], [1.0, 0.5, 2.0]]", row.key);
        case Row::Kind::duration:
            return std::string(duration_hint);
        case Row::Kind::duration_or_never:
            return fmt::format("{}, or \"never\"", duration_hint);
        case Row::Kind::size:
            return "write it like \"512MiB\" or \"8GiB\"";
        case Row::Kind::choice:
            return fmt::format("expected one of: \"{}\"", fmt::join(row.choices, "\", \""));
    }
    return {};
}

Result<Checked> check_text(const Row& row, const std::string& text) {
    auto length = static_cast<std::int64_t>(text.size());
    if (text.empty())
        return fail(fmt::format("{} is empty", row.key), "leave the key out, or name something");
    if (length > row.max) return fail(fmt::format("{} is longer than {} bytes", row.key, row.max));
    if (std::ranges::any_of(text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; }))
        return fail(fmt::format("{} = \"{}\" holds a control character", row.key, printable(text)));
    return Checked(text);
}

Result<Checked> check_duration(const Row& row, const std::string& text) {
    if (row.kind == Row::Kind::duration_or_never && text == "never") return Checked(Never{});
    auto duration = parse_duration(text);
    if (!duration)
        return fail(fmt::format("{} = \"{}\" is no duration", row.key, printable(text)), expected(row));
    if (duration->count() < row.min)
        return fail(fmt::format("{} = \"{}\" is too short", row.key, printable(text)),
                    fmt::format("it must be at least \"{}\"", to_text(std::chrono::microseconds(row.min))));
    return Checked(*duration);
}

Result<Checked> check_size(const Row& row, const std::string& text) {
    auto size = parse_size(text);
    if (!size) return fail(fmt::format("{} = \"{}\" is no size", row.key, printable(text)), expected(row));
    if (*size < row.min)
        return fail(fmt::format("{} = \"{}\" is too small", row.key, printable(text)),
                    fmt::format("it must be at least \"{}MiB\"", row.min >> 20));
    return Checked(*size);
}

Result<Checked> check_choice(const Row& row, const std::string& text) {
    if (std::ranges::find(row.choices, text) != row.choices.end()) return Checked(text);
    auto near = nearest(text, row.choices);
    return fail(fmt::format("{} = \"{}\" is not known", row.key, printable(text)),
                near.empty() ? expected(row) : fmt::format("did you mean \"{}\"?", near));
}

Result<Checked> check_list(const Row& row, const Node::List& list) {
    std::vector<std::string> texts;
    for (auto& item : list) {
        auto* text = item.get<std::string>();
        if (text == nullptr) return fail(fmt::format("{} holds {}", row.key, item.kind()), expected(row));
        texts.push_back(*text);
    }
    return Checked(std::move(texts));
}

std::optional<double> number_of(const Node& node) {
    if (auto* whole = node.get<std::int64_t>()) return static_cast<double>(*whole);
    if (auto* number = node.get<double>()) return *number;
    return {};
}

Result<double> check_number(const Row& row, const Node& node) {
    auto number = number_of(node);
    if (!number) return fail(fmt::format("{} is {}", row.key, node.kind()), expected(row));
    if (!(*number >= static_cast<double>(row.min) && *number <= static_cast<double>(row.max)))
        return fail(fmt::format("{} = {} is outside {} to {}", row.key, *number, row.min, row.max));
    return *number;
}

Result<Point> check_point(const Row& row, const Node& node) {
    auto* list = node.get<Node::List>();
    Point point{};
    if (list == nullptr) return fail(fmt::format("{} is {}", row.key, node.kind()), expected(row));
    if (list->size() != point.size())
        return fail(fmt::format("{} holds a list of {}", row.key, list->size()), expected(row));
    for (std::size_t i = 0; i < point.size(); ++i) {
        auto& item = (*list)[i];
        if (!number_of(item)) return fail(fmt::format("{} holds {}", row.key, item.kind()), expected(row));
        auto number = check_number(row, item);
        if (!number) return tl::unexpected(number.error());
        point[i] = *number;
    }
    return point;
}

Result<std::vector<Point>> check_points(const Row& row, const Node& node) {
    auto* list = node.get<Node::List>();
    if (list == nullptr) return fail(fmt::format("{} is {}", row.key, node.kind()), expected(row));
    std::vector<Point> points;
    for (auto& item : *list) {
        if (item.get<Node::List>() == nullptr)
            return fail(fmt::format("{} holds {}", row.key, item.kind()), expected(row));
        auto point = check_point(row, item);
        if (!point) return tl::unexpected(point.error());
        points.push_back(*point);
    }
    return points;
}

// The value as the row wants it; the kind of the value was what TOML said.
Result<Checked> check_value(const Row& row, const Node& node) {
    using Kind = Row::Kind;
    auto wrong_kind = [&] { return fail(fmt::format("{} is {}", row.key, node.kind()), expected(row)); };
    if (row.kind == Kind::boolean) {
        if (auto* yes = node.get<bool>()) return Checked(*yes);
        return wrong_kind();
    }
    if (row.kind == Kind::count) {
        auto* number = node.get<std::int64_t>();
        if (number == nullptr) return wrong_kind();
        if (*number < row.min || *number > row.max)
            return fail(fmt::format("{} = {} is outside {} to {}", row.key, *number, row.min, row.max));
        return Checked(*number);
    }
    if (row.kind == Kind::number)
        return check_number(row, node).map([](double number) { return Checked(number); });
    if (row.kind == Kind::point)
        return check_point(row, node).map([](const Point& point) { return Checked(point); });
    if (row.kind == Kind::points)
        return check_points(row, node).map(
            [](std::vector<Point> points) { return Checked(std::move(points)); });
    if (row.kind == Kind::texts) {
        if (auto* list = node.get<Node::List>()) return check_list(row, *list);
        return wrong_kind();
    }
    auto* text = node.get<std::string>();
    if (text == nullptr) return wrong_kind();
    switch (row.kind) {
        case Kind::name:
            return check_text(row, *text);
        case Kind::duration:
        case Kind::duration_or_never:
            return check_duration(row, *text);
        case Kind::size:
            return check_size(row, *text);
        case Kind::choice:
            return check_choice(row, *text);
        default:
            return Checked(*text);
    }
}

// A row's fallback through the same checks as what a user writes.
Node fallback_node(const Row& row) {
    Node node;
    std::int64_t number = 0;
    if (row.kind == Row::Kind::boolean) {
        node.of = row.fallback == "true";
    } else if (row.kind == Row::Kind::count) {
        std::from_chars(row.fallback.data(), row.fallback.data() + row.fallback.size(), number);
        node.of = number;
    } else if (row.kind == Row::Kind::number) {
        double real = 0;
        std::from_chars(row.fallback.data(), row.fallback.data() + row.fallback.size(), real);
        node.of = real;
    } else {
        node.of = std::string(row.fallback);
    }
    return node;
}
}  // namespace

Section check_section(const Node::Table& table, Place at, const SectionRows& section, std::string_view where,
                      Findings& findings) {
    Section out;
    out.at = at;
    for (auto& entry : table) {
        auto row = std::ranges::find(section.rows, entry.key, &Row::key);
        if (row == section.rows.end()) {
            out.others.push_back(&entry);
            continue;
        }
        auto value = check_value(*row, entry.value);
        if (value)
            out.items[entry.key] = {entry.value.at, std::move(*value), true};
        else
            findings.error(entry.value.at, value.error().what, value.error().hint);
    }
    for (auto& row : section.rows) {
        bool given = std::ranges::find(table, row.key, &Entry::key) != table.end();
        if (!given && row.required)
            findings.error(at, fmt::format("{} has no {}", where, row.key),
                           row.sample.empty() ? "" : fmt::format("write {} = \"{}\"", row.key, row.sample));
        if (out.items.contains(row.key) || row.fallback.empty()) continue;
        if (auto value = check_value(row, fallback_node(row)))
            out.items[std::string(row.key)] = {at, std::move(*value), false};
    }
    return out;
}

void unknown_key(const Entry& entry, std::string_view where, std::span<const std::string_view> known,
                 Findings& findings) {
    auto near = nearest(entry.key, known);
    findings.error(entry.at, fmt::format("unknown key \"{}\" in {}", printable(entry.key), where),
                   near.empty() ? fmt::format("keys: {}", fmt::join(known, ", "))
                                : fmt::format("did you mean \"{}\"?", near));
}

}  // namespace gantry::document
