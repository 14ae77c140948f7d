#include <array>
#include <fstream>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "sink/sink.hpp"
#include "sinks/nats/nats_sink.hpp"
#include "sinks/nats/sample.hpp"  // made by CMake from sample.toml

namespace gantry::sinks::nats {

using Row = SettingRow;
using Setting = SettingRow::Kind;

static constexpr std::uint16_t default_port = 4222;
static constexpr std::string_view schemes[] = {"nats", "tls"};
static constexpr std::string_view storages[] = {"file", "memory"};

static constexpr auto rows = std::to_array<SettingRow>({
    Row{"servers",
        Setting::text,
        "",
        "More servers of the cluster: \"nats-2:4222, nats-3:4222\".",
        {},
        0,
        2000},
    Row{"prefix", Setting::text, "gantry", "Subjects are <prefix>.<gateway id>.<reader>.events.", {}, 1, 256},
    Row{"stream", Setting::text, "GANTRY", "The stream; made if there is none.", {}, 1, 200},
    Row{"subjects", Setting::text, "", "Of a new stream: \"a.>, b.>\"; <prefix>.> if not set.", {}, 0, 2000},
    Row{"duplicate_window",
        Setting::duration,
        "1h",
        "So long at least the stream drops doubles.",
        {},
        3600,
        604'800},
    Row{"max_age",
        Setting::duration,
        "30d",
        "Of a new stream: how long it keeps events; 0s: for ever.",
        {},
        0,
        315'360'000},
    Row{"replicas", Setting::number, "1", "Servers of the cluster that keep each event.", {}, 1, 5},
    Row{"storage", Setting::choice, "file", "Of a new stream.", storages},
    Row{"window", Setting::number, "2000", "Messages under way without an answer.", {}, 1, 100'000},
    Row{"user", Setting::text, "", "User name at the server."},
    Row{.name = "password", .kind = Setting::text, .fallback = "", .help = "Its password.", .secret = true},
    Row{.name = "token",
        .kind = Setting::text,
        .fallback = "",
        .help = "A token instead of user and password.",
        .secret = true},
    Row{"credentials", Setting::text, "", "File with a user's JWT and seed, as nsc makes it."},
    Row{"tls_ca", Setting::text, "", "File of authorities to trust; those of the system if not set."},
    Row{"tls_cert", Setting::text, "", "File with our certificate, for servers that ask for one."},
    Row{"tls_key", Setting::text, "", "File with its key, without a password."},
    Row{"tls_insecure", Setting::boolean, "false", "Trust any certificate: anybody can be the server then."},
});

static Result<void> check_file(std::string_view setting, const std::string& path) {
    if (path.empty() || std::ifstream(path).good()) return {};
    return fail(fmt::format("{} = \"{}\" cannot be read", setting, printable(path)),
                "check the path and its rights");
}

static Result<void> read_servers(const sink::Options& options, Access& access) {
    auto first = sink::parse_server_url(options.url, default_port);
    if (!first) return tl::unexpected(first.error());
    access.tls = first->scheme == "tls";
    access.servers.push_back(*std::move(first));
    auto rest = options.settings.text("servers");
    while (!rest.empty()) {
        auto end = rest.find(',');
        auto server = sink::parse_server(trimmed(rest.substr(0, end)), default_port);
        if (!server) return tl::unexpected(server.error());
        access.servers.push_back(*std::move(server));
        rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
    }
    return {};
}

static Result<void> read_security(const sink::Options& options, Access& access) {
    auto& settings = options.settings;
    access.user = settings.text("user");
    access.password = settings.text("password");
    access.token = settings.text("token");
    access.credentials = settings.text("credentials");
    if (access.user.empty() && !access.password.empty())
        return fail("a password without a user", "set user, too");
    if (int(!access.user.empty()) + int(!access.token.empty()) + int(!access.credentials.empty()) > 1)
        return fail("user, token and credentials are three ways to do the same", "set one of them");
    if (auto fine = check_file("credentials", access.credentials); !fine) return fine;
    access.tls_insecure = settings.boolean("tls_insecure");
    for (auto [name, value] : {std::pair{"tls_ca", &access.tls_ca}, std::pair{"tls_cert", &access.tls_cert},
                               std::pair{"tls_key", &access.tls_key}}) {
        *value = settings.text(name);
        if (!value->empty() && !access.tls)
            return fail(fmt::format("{} is set, but nats:// is not encrypted", name), "write tls://");
        if (auto fine = check_file(name, *value); !fine) return fine;
    }
    if (access.tls_cert.empty() != access.tls_key.empty())
        return fail("tls_cert and tls_key come together", "set both or none");
    if (access.tls && access.tls_insecure)
        log::warn("sink", "{}: tls_insecure trusts any certificate", printable(options.name));
    if (access.tls) return {};
    for (auto& server : access.servers) {
        if (server.is_loopback()) continue;
        bool secret = !access.password.empty() || !access.token.empty();
        log::warn("sink", "{}: events{} go to {} unencrypted; tls:// would protect them",
                  printable(options.name), secret ? " and the password" : "", server.text());
        break;
    }
    return {};
}

static Result<void> read_stream(const Settings& settings, const Plan& plan, StreamPlan& stream) {
    using std::chrono::duration_cast;
    using std::chrono::seconds;
    stream.name = settings.text("stream");
    if (stream.name.find_first_of(".*>/\\ ") != std::string::npos || printable(stream.name) != stream.name)
        return fail(fmt::format("stream = \"{}\" is no name of a stream", printable(stream.name)),
                    "use letters, digits, '-' and '_'");
    auto given = settings.text("subjects");
    auto subjects = parse_subjects(given.empty() ? plan.prefix + ".>" : std::string(given));
    if (!subjects) return tl::unexpected(subjects.error());
    stream.subjects = *std::move(subjects);
    stream.wanted = Subjects(plan.prefix, plan.gateway_id).all_events();
    bool takes = false;
    for (auto& each : stream.subjects)
        takes = takes || covers(each, stream.wanted);
    if (!takes)
        return fail(fmt::format("subjects = \"{}\" do not have {} in them", printable(given), stream.wanted),
                    "add it");
    stream.duplicate_window = duration_cast<seconds>(settings.duration("duplicate_window"));
    stream.max_age = duration_cast<seconds>(settings.duration("max_age"));
    if (stream.max_age > 0s && stream.max_age < stream.duplicate_window)
        return fail("max_age is shorter than duplicate_window", "make it longer, or 0s for ever");
    stream.replicas = static_cast<int>(settings.number("replicas"));
    stream.in_memory = settings.text("storage") == "memory";
    return {};
}

static Result<std::unique_ptr<sink::Sink>> make(const sink::Options& options, sink::Host&) {
    auto& settings = options.settings;
    Plan plan;
    plan.prefix = settings.text("prefix");
    plan.gateway_id = options.gateway_id;
    plan.window = static_cast<std::size_t>(settings.number("window"));
    plan.access.name = fmt::format("gantry {} {}", options.gateway_id, options.name);
    if (auto fine = Subjects::check(plan.prefix); !fine) return tl::unexpected(fine.error());
    if (auto fine = read_servers(options, plan.access); !fine) return tl::unexpected(fine.error());
    if (auto fine = read_security(options, plan.access); !fine) return tl::unexpected(fine.error());
    if (auto fine = read_stream(settings, plan, plan.access.stream); !fine)
        return tl::unexpected(fine.error());
    start_library();
    return std::make_unique<NatsSink>(std::move(plan));
}

extern const sink::Kind kind;
constinit const sink::Kind kind{
    .name = "nats",
    .title = "NATS JetStream",
    .summary = "confirmed when the stream has it, on as many servers as it has replicas; doubles are dropped",
    .schemes = schemes,
    .settings = rows,
    .batch = 1000,
    .idempotent = true,
    .sample_toml = sample_toml,
    .make = &make,
};

}  // namespace gantry::sinks::nats
