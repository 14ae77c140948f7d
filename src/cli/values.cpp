#include "cli/values.hpp"

#include <charconv>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"

namespace gantry::cli {

namespace {
Result<std::chrono::milliseconds> read_duration(const std::string& text) {
    auto duration = parse_duration(text);
    if (!duration || *duration < 1ms)
        return fail(fmt::format("{} is no duration", printable(text)), "write it like 500ms, 10s or 5min");
    return std::chrono::ceil<std::chrono::milliseconds>(*duration);
}

Result<Wall> read_moment(const std::string& text) {
    if (auto time = parse_rfc3339(text)) return *time;
    if (auto ago = parse_duration(text))
        return std::chrono::floor<std::chrono::microseconds>(std::chrono::system_clock::now()) - *ago;
    return fail(fmt::format("{} is no time", printable(text)),
                "write 2026-11-21T23:04:00Z, or 10min for ten minutes ago");
}

Result<std::uint64_t> read_count(const std::string& text, std::uint64_t least, std::uint64_t most) {
    std::uint64_t count = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
    if (error != std::errc{} || end != text.data() + text.size() || count < least || count > most)
        return fail(fmt::format("{} cannot be", printable(text)),
                    most == UINT64_MAX ? fmt::format("write a whole number, {} or more", least)
                                       : fmt::format("write a whole number, {} to {}", least, most));
    return count;
}

// Read twice, to check and to keep: CLI11 has no way to hand over what a check has read.
template <class Into, class Read>
CLI::Option& add_value(CLI::App& command, const std::string& names, Into& into, const std::string& help,
                       const Read& read) {
    auto keep = [&into, read](const std::string& text) {
        if (auto value = read(text)) into = *value;
    };
    auto* option = command.add_option_function<std::string>(names, keep, help);
    must(*option,
         [read](const std::string& text) -> Result<void> { return read(text).map([](const auto&) {}); });
    return *option;
}
}  // namespace

void must(CLI::Option& option, std::function<Result<void>(const std::string&)> check) {
    auto complaint = [check = std::move(check)](const std::string& text) {
        auto fine = check(text);
        return fine ? std::string() : fine.error().text();
    };
    option.check(complaint, "");
}

void add_duration(CLI::App& command, const std::string& names, std::optional<std::chrono::milliseconds>& into,
                  const std::string& help) {
    add_value(command, names, into, help, read_duration).type_name("DURATION");
}

void add_moment(CLI::App& command, const std::string& names, std::optional<Wall>& into,
                const std::string& help) {
    add_value(command, names, into, help, read_moment).type_name("TIME");
}

CLI::Option& add_count(CLI::App& command, const std::string& names, std::uint64_t& into, std::uint64_t least,
                       const std::string& help, std::uint64_t most) {
    auto read = [least, most](const std::string& text) { return read_count(text, least, most); };
    return *add_value(command, names, into, help, read).type_name("NUMBER");
}

void add_endpoint(CLI::App& command, const std::string& names, std::optional<link::Endpoint>& into,
                  const std::string& help) {
    add_value(command, names, into, help, link::parse_endpoint).type_name("HOST:PORT");
}

}  // namespace gantry::cli
