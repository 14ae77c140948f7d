#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "reader/plugin.hpp"

// Settings that are secrets come from a file or from the environment, never from the configuration itself.
namespace gantry::gateway {

// The row whose secret a key names: "password_file" and "password_env" belong to `password`.
struct SecretKey {
    const SettingRow* row = nullptr;
    bool from_file = false;
};
std::optional<SecretKey> secret_key(std::span<const SettingRow> rows, std::string_view key);

// The secret without the white space around it. A file that others than its owner and group can read is
// refused.
Result<std::string> read_secret(const SecretKey& key, const std::string& place);

}  // namespace gantry::gateway
