#include "gateway/config_settings.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "gateway/config_secret.hpp"

namespace gantry::gateway {

namespace {
// What the owner's own checker takes: the value as text, if TOML said it in the right kind.
Result<std::string> setting_text(const SettingRow& row, const Node& node) {
    using Kind = SettingRow::Kind;
    auto refuse = [&](std::string_view expected) {
        return fail(fmt::format("{} is {}", row.name, node.kind()), fmt::format("expected {}", expected));
    };
    switch (row.kind) {
        case Kind::number: {
            if (auto* whole = node.get<std::int64_t>()) return fmt::format("{}", *whole);
            auto* number = node.get<double>();
            if (number == nullptr) return refuse("a number");
            if (!std::isfinite(*number))
                return fail(fmt::format("{} = {} is no number to work with", row.name, *number));
            return fmt::format("{}", *number);
        }
        case Kind::boolean:
            if (auto* yes = node.get<bool>()) return std::string(*yes ? "true" : "false");
            return refuse("true or false");
        case Kind::text:
        case Kind::duration:
        case Kind::choice:
        case Kind::hex:
            break;
    }
    if (auto* text = node.get<std::string>()) return *text;
    return refuse(row.kind == Kind::duration ? "a duration in quotes, like \"2s\"" : "text in quotes");
}
}  // namespace

bool SettingsCheck::take(const Entry& entry) {
    if (auto secret = secret_key(rows_, entry.key)) {
        take_secret(*secret->row, secret->from_file, entry);
        return true;
    }
    auto row = std::ranges::find(rows_, entry.key, &SettingRow::name);
    if (row == rows_.end()) return false;
    if (row->secret)
        findings_.error(entry.at, fmt::format("{} is a secret and does not stand here", row->name),
                        fmt::format("write {0}_file = \"/path\" or {0}_env = \"VARIABLE\"", row->name));
    else
        take_setting(*row, entry);
    return true;
}

void SettingsCheck::take_secret(const SettingRow& row, bool from_file, const Entry& entry) {
    auto* place = entry.value.get<std::string>();
    if (place == nullptr)
        return findings_.error(entry.value.at,
                               fmt::format("{} is {}, expected a text", entry.key, entry.value.kind()));
    if (std::ranges::any_of(given_, [&](auto& each) { return each.row == &row; }))
        return findings_.error(entry.at, fmt::format("{} is given twice", row.name),
                               fmt::format("one of {0}_file and {0}_env is enough", row.name));
    auto secret = read_secret({&row, from_file}, *place);
    if (!secret) return findings_.error(entry.value.at, secret.error().what, secret.error().hint);
    std::pair<std::string, std::string> one[] = {{std::string(row.name), *secret}};
    if (!Settings::make(rows_, one))
        return findings_.error(entry.value.at,
                               fmt::format("what {} leads to is no {}: {}", entry.key, row.name, row.help));
    given_.push_back({&row, entry.value.at, std::move(*secret)});
}

void SettingsCheck::take_setting(const SettingRow& row, const Entry& entry) {
    auto text = setting_text(row, entry.value);
    if (!text) return findings_.error(entry.value.at, text.error().what, text.error().hint);
    std::pair<std::string, std::string> one[] = {{entry.key, *text}};
    if (auto fine = Settings::make(rows_, one); !fine)
        return findings_.error(entry.value.at, fine.error().what, fine.error().hint);
    given_.push_back({&row, entry.value.at, std::move(*text)});
}

std::optional<Settings> SettingsCheck::settings() const {
    std::vector<std::pair<std::string, std::string>> all;
    for (auto& each : given_)
        all.emplace_back(each.row->name, each.text);
    auto made = Settings::make(rows_, all);
    if (!made) return {};
    return std::move(*made);
}

Place SettingsCheck::place(std::string_view name, Place otherwise) const {
    for (auto& each : given_)
        if (each.row->name == name) return each.at;
    return otherwise;
}

}  // namespace gantry::gateway
