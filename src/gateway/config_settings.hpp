#pragma once
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "gateway/config_rows.hpp"
#include "reader/plugin.hpp"

// The keys of a section that its make or its kind of sink adds to those that all have.
namespace gantry::gateway {

class SettingsCheck {
public:
    SettingsCheck(std::span<const SettingRow> rows, Findings& findings) : rows_(rows), findings_(findings) {}

    // Takes the entry if it is one of the settings, good or not. False: it is another key.
    bool take(const Entry& entry);
    // What was given and good, the rest with its fallback; nothing when there was an error.
    std::optional<Settings> settings() const;
    struct Given {
        const SettingRow* row = nullptr;
        Place at;
        std::string text;
    };
    const std::vector<Given>& given() const { return given_; }
    Place place(std::string_view name, Place otherwise) const;

private:
    void take_secret(const SettingRow& row, bool from_file, const Entry& entry);
    void take_setting(const SettingRow& row, const Entry& entry);

    std::span<const SettingRow> rows_;
    Findings& findings_;
    std::vector<Given> given_;
};

}  // namespace gantry::gateway
