#include <array>

#include "sink/sink.hpp"
#include "sinks/postgres/postgres.hpp"
#include "sinks/postgres/sample.hpp"

namespace gantry::sinks::postgres {

using Setting = SettingRow::Kind;

static constexpr std::array<std::string_view, 2> schemes = {"postgres", "postgresql"};

static constexpr std::array<std::string_view, 5> sslmodes = {"", "disable", "require", "verify-ca",
                                                             "verify-full"};
static constexpr std::array rows = {
    SettingRow{
        "schema", Setting::text, "gantry", "schema of our tables, created if it is not there", {}, 0, 48},
    SettingRow{"table", Setting::text, "events", "table of the events", {}, 0, 48},
    SettingRow{"present_tags", Setting::boolean, "false",
               "keep the view present_tags up to date: the tags that are there now"},
    SettingRow{.name = "password",
               .kind = Setting::text,
               .fallback = "",
               .help = "of the user that the url names",
               .secret = true},
    SettingRow{"sslmode", Setting::choice, "",
               "TLS as libpq names it; unset: verify-full, on loopback whatever the server offers", sslmodes},
    SettingRow{"tls_ca", Setting::text, "",
               "file with the certificates that may sign the server's; unset: the system's"},
    SettingRow{"tls_cert", Setting::text, "", "file with a certificate of ours"},
    SettingRow{"tls_key", Setting::text, "", "file with its key"},
    SettingRow{"tls_insecure", Setting::boolean, "false", "encrypt, but trust any server"},
    SettingRow{"lock_timeout",
               Setting::duration,
               "5s",
               "how long a lock that somebody else holds is waited for at a time",
               {},
               0.1,
               600},
};

static Result<std::unique_ptr<sink::Sink>> make(const sink::Options& options, sink::Host& /*host*/) {
    auto target = make_target(options);
    if (!target) return tl::unexpected(target.error());
    return std::make_unique<PostgresSink>(std::move(*target));
}

const sink::Kind kind{
    .name = "postgres",
    .title = "PostgreSQL and TimescaleDB",
    .summary = "rows of a table; confirmed when the server has committed them to its disk",
    .schemes = schemes,
    .settings = rows,
    .batch = 1000,
    .idempotent = true,
    .sample_toml = sample_toml,
    .make = make,
};

}  // namespace gantry::sinks::postgres
