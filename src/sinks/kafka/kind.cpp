#include <array>

#include "sink/sink.hpp"
#include "sinks/kafka/kafka.hpp"
#include "sinks/kafka/sample.hpp"

namespace gantry::sinks::kafka {

using Setting = SettingRow::Kind;

static constexpr std::array<std::string_view, 2> schemes = {"kafka", "kafkas"};

static constexpr std::array<std::string_view, 2> keys = {"tag", "reader"};
static constexpr std::array<std::string_view, 5> compressions = {"none", "gzip", "snappy", "lz4", "zstd"};
static constexpr std::array<std::string_view, 4> mechanisms = {"", "plain", "scram-sha-256", "scram-sha-512"};
static constexpr std::array rows = {
    SettingRow{"topic", Setting::text, "gantry.events", "topic of the events", {}, 0, 249},
    SettingRow{"key", Setting::choice, "tag",
               "order is kept for each key: tag (the reader, where there is none) or reader", keys},
    SettingRow{"compression", Setting::choice, "none", "of batches of messages", compressions},
    SettingRow{"max_message",
               Setting::number,
               "1000000",
               "most bytes of a message: what the topic's max.message.bytes allows",
               {},
               1000,
               100000000},
    SettingRow{"sasl", Setting::choice, "", "how we say who we are; unset: not at all", mechanisms},
    SettingRow{"user", Setting::text, "", "with sasl"},
    SettingRow{.name = "password", .kind = Setting::text, .fallback = "", .help = "of user", .secret = true},
    SettingRow{"tls_ca", Setting::text, "",
               "file with the certificates that may sign the brokers'; unset: the system's"},
    SettingRow{"tls_cert", Setting::text, "", "file with a certificate of ours"},
    SettingRow{"tls_key", Setting::text, "", "file with its key"},
    SettingRow{"tls_insecure", Setting::boolean, "false", "encrypt, but trust any broker"},
};

static Result<std::unique_ptr<sink::Sink>> make(const sink::Options& options, sink::Host& /*host*/) {
    auto target = make_target(options);
    if (!target) return tl::unexpected(target.error());
    return std::make_unique<KafkaSink>(std::move(*target));
}

const sink::Kind kind{
    .name = "kafka",
    .title = "Kafka",
    .summary = "messages of a topic; confirmed when all in-sync replicas have them",
    .schemes = schemes,
    .settings = rows,
    .batch = 1000,
    .idempotent = false,
    .sample_toml = sample_toml,
    .make = make,
};

}  // namespace gantry::sinks::kafka
