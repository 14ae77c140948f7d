#include <array>
#include <fstream>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "sink/sink.hpp"
#include "sinks/mqtt/mqtt_sink.hpp"
#include "sinks/mqtt/sample.hpp"  // made by CMake from sample.toml

namespace gantry::sinks::mqtt {

using Row = SettingRow;
using Setting = SettingRow::Kind;

static constexpr std::string_view schemes[] = {"mqtt", "mqtts"};
static constexpr std::string_view versions[] = {"5", "3.1.1"};

static constexpr auto rows = std::to_array<SettingRow>({
    Row{"version", Setting::choice, "5", "MQTT's version; only 5 tells why a message is refused.", versions},
    Row{"base", Setting::text, "", "The topic above all others; gantry/<gateway id> if not set.", {}, 0, 512},
    Row{"client_id",
        Setting::text,
        "",
        "Unique at the broker; made of gateway and sink if not set.",
        {},
        0,
        200},
    Row{"user", Setting::text, "", "User name at the broker."},
    Row{.name = "password", .kind = Setting::text, .fallback = "", .help = "Its password.", .secret = true},
    Row{"keepalive",
        Setting::duration,
        "30s",
        "Silence after which the other end counts as gone.",
        {},
        5,
        3600},
    Row{"window", Setting::number, "100", "Messages under way without a confirmation.", {}, 1, 60'000},
    Row{"array", Setting::boolean, "false", "Each message is a JSON array of a reader's events."},
    Row{"array_size", Setting::number, "100", "The most events of an array.", {}, 1, 10'000},
    Row{"array_bytes",
        Setting::number,
        "131072",
        "The most bytes of an array of several.",
        {},
        1024,
        16'777'216},
    Row{"status", Setting::boolean, "true", "Retained state of the bridge and of each reader, with a will."},
    Row{"home_assistant", Setting::boolean, "false", "Discovery for Home Assistant."},
    Row{"discovery_prefix", Setting::text, "homeassistant", "Its topic for discovery.", {}, 1, 200},
    Row{"tls_ca", Setting::text, "", "File of authorities to trust; those of the system if not set."},
    Row{"tls_cert", Setting::text, "", "File with our certificate, for brokers that ask for one."},
    Row{"tls_key", Setting::text, "", "File with its key, without a password."},
    Row{"tls_insecure", Setting::boolean, "false", "Trust any certificate: anybody can be the broker then."},
});

static Result<void> check_file(std::string_view setting, const std::string& path) {
    if (path.empty() || std::ifstream(path).good()) return {};
    return fail(fmt::format("{} = \"{}\" cannot be read", setting, printable(path)),
                "check the path and its rights");
}

static Result<void> read_tls(const sink::Options& options, Access& access) {
    auto& settings = options.settings;
    access.tls = access.server.scheme == "mqtts";
    access.tls_insecure = settings.boolean("tls_insecure");
    for (auto [name, value] : {std::pair{"tls_ca", &access.tls_ca}, std::pair{"tls_cert", &access.tls_cert},
                               std::pair{"tls_key", &access.tls_key}}) {
        *value = settings.text(name);
        if (!value->empty() && !access.tls)
            return fail(fmt::format("{} is set, but mqtt:// is not encrypted", name), "write mqtts://");
        if (auto fine = check_file(name, *value); !fine) return fine;
    }
    if (access.tls_cert.empty() != access.tls_key.empty())
        return fail("tls_cert and tls_key come together", "set both or none");
    if (access.tls && access.tls_insecure)
        log::warn("sink", "{}: tls_insecure trusts any certificate", printable(options.name));
    if (!access.tls && !access.server.is_loopback())
        log::warn("sink", "{}: events{} go to {} unencrypted; mqtts:// would protect them",
                  printable(options.name), access.user.empty() ? "" : " and the password",
                  access.server.text());
    return {};
}

static Result<Plan> read_plan(const sink::Options& options) {
    auto& settings = options.settings;
    Plan plan;
    auto server = sink::parse_server_url(options.url, options.url.starts_with("mqtts:") ? 8883 : 1883);
    if (!server) return tl::unexpected(server.error());
    auto& access = plan.access;
    access.server = *std::move(server);
    access.version_5 = settings.text("version") == "5";
    access.user = settings.text("user");
    access.password = settings.text("password");
    if (access.user.empty() && !access.password.empty())
        return fail("a password without a user", "set user, too");
    access.client_id = settings.text("client_id");
    if (access.client_id.empty())
        access.client_id = fmt::format("gantry-{}-{}", options.gateway_id, options.name);
    if (printable(access.client_id) != access.client_id)
        return fail(fmt::format("client_id = \"{}\" has characters that no broker takes",
                                printable(access.client_id)));
    access.keepalive = std::chrono::duration_cast<std::chrono::seconds>(settings.duration("keepalive"));
    access.window = static_cast<std::uint16_t>(settings.number("window"));
    if (auto fine = read_tls(options, access); !fine) return tl::unexpected(fine.error());

    plan.gateway_id = options.gateway_id;
    plan.base = settings.text("base");
    if (plan.base.empty()) plan.base = Topics::default_base(options.gateway_id);
    if (auto fine = Topics::check(plan.base); !fine) return tl::unexpected(fine.error());
    plan.grouping = {.array = settings.boolean("array"),
                     .array_size = static_cast<std::size_t>(settings.number("array_size")),
                     .array_bytes = static_cast<std::size_t>(settings.number("array_bytes"))};
    plan.commands = options.commands;
    plan.status = settings.boolean("status");
    if (plan.status) access.will_topic = Topics(plan.base).bridge_state();
    if (!settings.boolean("home_assistant")) return plan;
    plan.discovery_prefix = settings.text("discovery_prefix");
    if (auto fine = Topics::check(plan.discovery_prefix); !fine) return tl::unexpected(fine.error());
    if (!plan.status)
        return fail("home_assistant = true needs the status of the readers", "leave status = true");
    if (plan.grouping.array)
        return fail("home_assistant = true needs one event a message",
                    "leave array = false, or give it a sink of its own");
    return plan;
}

static Result<std::unique_ptr<sink::Sink>> make(const sink::Options& options, sink::Host& host) {
    auto plan = read_plan(options);
    if (!plan) return tl::unexpected(plan.error());
    start_library();
    return std::make_unique<MqttSink>(*std::move(plan), host);
}

extern const sink::Kind kind;
constinit const sink::Kind kind{
    .name = "mqtt",
    .title = "MQTT 5 and 3.1.1",
    .summary =
        "QoS 1; confirmed when the broker has it (PUBACK), in its memory or wherever it keeps messages",
    .schemes = schemes,
    .settings = rows,
    .batch = 1000,
    .takes_requests = true,
    .idempotent = false,
    .sample_toml = sample_toml,
    .make = &make,
};

}  // namespace gantry::sinks::mqtt
