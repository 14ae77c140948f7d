#include "gateway/config_secret.hpp"

#include <sys/stat.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::gateway {

static constexpr std::string_view file_suffix = "_file", env_suffix = "_env";

std::optional<SecretKey> secret_key(std::span<const SettingRow> rows, std::string_view key) {
    for (auto& row : rows) {
        if (!row.secret || !key.starts_with(row.name)) continue;
        auto rest = key.substr(row.name.size());
        if (rest == file_suffix) return SecretKey{&row, true};
        if (rest == env_suffix) return SecretKey{&row, false};
    }
    return {};
}

Result<std::string> read_secret(const SecretKey& key, const std::string& place) {
    constexpr std::size_t longest = 4096;
    std::string secret;
    if (key.from_file) {
        struct ::stat about {};
        std::ifstream file(place, std::ios::binary);
        if (!file || ::stat(place.c_str(), &about) != 0)
            return fail(fmt::format("{}_file: cannot read {}: {}", key.row->name, printable(place),
                                    std::strerror(errno)),
                        "is it there, and may this user read it?");
        if ((about.st_mode & S_IROTH) != 0)
            return fail(fmt::format("{}_file: everybody can read {}", key.row->name, printable(place)),
                        fmt::format("chmod 640 {}", printable(place)));
        secret.resize(longest + 1);
        file.read(secret.data(), static_cast<std::streamsize>(secret.size()));
        secret.resize(static_cast<std::size_t>(file.gcount()));
        if (secret.size() > longest)
            return fail(fmt::format("{}_file: {} is too long for a secret", key.row->name, printable(place)));
    } else {
        const auto* value = std::getenv(place.c_str());  // NOLINT(concurrency-mt-unsafe): nobody sets it
        if (value == nullptr)
            return fail(
                fmt::format("{}_env: there is no {} in the environment", key.row->name, printable(place)));
        secret = value;
    }
    secret = std::string(trimmed(secret));
    if (secret.empty())
        return fail(fmt::format("{}_{}: {} holds no secret", key.row->name, key.from_file ? "file" : "env",
                                printable(place)));
    return secret;
}

}  // namespace gantry::gateway
