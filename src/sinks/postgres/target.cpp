#include "sinks/postgres/target.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "base/time.hpp"

namespace gantry::sinks::postgres {

namespace {

// Where distributions keep the certificates of all that is trusted.
constexpr std::array system_lists = {"/etc/ssl/certs/ca-certificates.crt", "/etc/pki/tls/certs/ca-bundle.crt",
                                     "/etc/ssl/cert.pem"};

std::vector<std::string> split(std::string_view list) {
    std::vector<std::string> out;
    for (;;) {
        auto comma = list.find(',');
        out.emplace_back(list.substr(0, comma));
        if (comma == std::string_view::npos) return out;
        list.remove_prefix(comma + 1);
    }
}

bool is_loopback(const Target::Host& host) {
    // Not "127.example.com", which is a name like any other.
    bool is_127 =
        host.name.starts_with("127.") && host.name.find_first_not_of("0123456789.") == std::string::npos;
    return host.is_directory() || host.name == "localhost" || is_127 || host.name == "::1";
}

std::string_view value_of(const Parameters& parameters, std::string_view name) {
    auto it = std::ranges::find(parameters, name, &Parameters::value_type::first);
    return it == parameters.end() ? std::string_view() : it->second;
}

Result<std::vector<Target::Host>> hosts_of(const Parameters& url) {
    auto names = split(value_of(url, "host")), ports = split(value_of(url, "port"));
    if (ports.size() != 1 && ports.size() != names.size())
        return fail("the url has more ports than hosts",
                    "write it like \"postgres://user@a:5432,b:5433/rfid\"");
    std::vector<Target::Host> hosts;
    for (std::size_t i = 0; i < names.size(); ++i) {
        auto& port = ports.size() == 1 ? ports.front() : ports[i];
        if (!std::ranges::all_of(port, [](char c) { return c >= '0' && c <= '9'; }))
            return fail("the url has a port that is no number");
        hosts.push_back({.name = names[i], .port = port.empty() ? "5432" : port, .sslmode = {}});
    }
    return hosts;
}

Result<void> set_tls(Target& target, const Settings& settings) {
    std::string mode(settings.text("sslmode"));
    bool insecure = settings.boolean("tls_insecure");
    if (insecure && !mode.empty() && mode != "require")
        return fail(fmt::format("tls_insecure = true and sslmode = \"{}\" contradict each other", mode));
    if (insecure) mode = "require";
    bool checks = false;
    for (auto& host : target.hosts) {
        host.sslmode = !mode.empty() ? mode : is_loopback(host) ? "prefer" : "verify-full";
        checks = checks || host.sslmode.starts_with("verify");
        if (is_loopback(host)) continue;
        if (host.sslmode == "disable")
            target.warning = fmt::format("events go to {} in the clear: sslmode = \"disable\"", host.shown());
        if (host.sslmode == "require")
            target.warning = fmt::format("nobody checks that {} is the right server: {}", host.shown(),
                                         insecure ? "tls_insecure = true" : "sslmode = \"require\"");
    }
    if (settings.text("tls_cert").empty() != settings.text("tls_key").empty())
        return fail("tls_cert and tls_key go together");
    for (auto& [setting, keyword] : {std::pair{"tls_ca", "sslrootcert"}, std::pair{"tls_cert", "sslcert"},
                                     std::pair{"tls_key", "sslkey"}}) {
        std::string file(settings.text(setting));
        if (file.empty()) continue;
        if (::access(file.c_str(), R_OK) != 0)
            return fail(fmt::format("{}: cannot read {}", setting, printable(file)));
        target.parameters.emplace_back(keyword, file);
    }
    if (!checks || !settings.text("tls_ca").empty()) return {};
    for (const auto* file : system_lists)
        if (::access(file, R_OK) == 0) {
            target.parameters.emplace_back("sslrootcert", file);
            return {};
        }
    return fail("this system has no list of trusted certificates", "name one with tls_ca");
}

}  // namespace

std::string Target::Host::shown() const {
    if (is_directory()) return name.empty() ? "the local socket" : printable(name);
    return name.find(':') != std::string::npos ? fmt::format("[{}]:{}", printable(name), printable(port))
                                               : fmt::format("{}:{}", printable(name), printable(port));
}

Result<Target> make_target(const sink::Options& options) {
    auto url = parse_url(options.url);
    if (!url) return tl::unexpected(url.error());
    Target target;
    auto hosts = hosts_of(*url);
    if (!hosts) return tl::unexpected(hosts.error());
    target.hosts = std::move(*hosts);
    auto database = value_of(*url, "dbname");
    if (database.empty())
        return fail("the url names no database", "write it like \"postgres://user@host/database\"");
    auto& settings = options.settings;
    target.parameters = {{"dbname", std::string(database)},
                         {"client_encoding", "UTF8"},
                         {"application_name", fmt::format("gantry {}", options.gateway_id)},
                         {"gssencmode", "disable"},  // it would ask the network without patience
                         {"keepalives_idle", "10"},
                         {"keepalives_interval", "5"},
                         {"keepalives_count", "3"},
                         {"tcp_user_timeout", "30000"}};
    if (auto user = value_of(*url, "user"); !user.empty()) target.parameters.emplace_back("user", user);
    if (auto password = settings.text("password"); !password.empty())
        target.parameters.emplace_back("password", password);
    if (auto set = set_tls(target, settings); !set) return tl::unexpected(set.error());

    target.names = {std::string(settings.text("schema")), std::string(settings.text("table"))};
    for (auto* setting : {"schema", "table"})
        if (auto fine = check_name(setting, settings.text(setting)); !fine)
            return tl::unexpected(fine.error());
    target.present_tags = settings.boolean("present_tags");
    target.gateway = options.gateway_id;
    target.lock_timeout =
        std::chrono::duration_cast<std::chrono::milliseconds>(settings.duration("lock_timeout"));
    return target;
}

}  // namespace gantry::sinks::postgres
