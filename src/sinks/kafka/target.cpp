#include "sinks/kafka/target.hpp"

#include <unistd.h>

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::kafka {

namespace {

constexpr std::string_view usual_form = "write it like \"kafkas://broker-1:9093,broker-2:9093\"";

struct Broker {
    std::string host, port;
    bool is_loopback() const { return host == "localhost" || host.starts_with("127.") || host == "[::1]"; }
};

Result<Broker> parse_broker(std::string_view text, std::string_view usual_port) {
    auto host_end = text.starts_with('[') ? text.find(']') : std::string_view::npos;
    auto colon = text.find(':', host_end == std::string_view::npos ? 0 : host_end);
    Broker broker{std::string(text.substr(0, colon)), std::string(usual_port)};
    if (colon != std::string_view::npos) broker.port = text.substr(colon + 1);
    auto fine_in_host = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
               c == '-' || c == '_' || c == '[' || c == ']' || c == ':';
    };
    bool fine_port = !broker.port.empty() && broker.port.size() <= 5 &&
                     std::ranges::all_of(broker.port, [](char c) { return c >= '0' && c <= '9'; });
    if (broker.host.empty() || !std::ranges::all_of(broker.host, fine_in_host) || !fine_port)
        return fail("the url has a broker that is no host with a port", std::string(usual_form));
    return broker;
}

Result<std::vector<Broker>> parse_brokers(std::string_view url, bool tls) {
    auto list = url.substr(std::min(url.find("://"), url.size()));
    if (list.empty()) return fail("the url is none of Kafka brokers", std::string(usual_form));
    list.remove_prefix(3);
    if (list.find('@') != std::string_view::npos)
        return fail("the url holds a user",
                    "take it out: the settings sasl, user and password_file say who we are");
    if (list.ends_with('/')) list.remove_suffix(1);
    if (list.find_first_of("/?#") != std::string_view::npos)
        return fail("the url says more than brokers", "the topic and all else are settings of the sink");
    std::vector<Broker> brokers;
    for (;;) {
        auto comma = list.find(',');
        auto broker = parse_broker(list.substr(0, comma), tls ? "9093" : "9092");
        if (!broker) return tl::unexpected(broker.error());
        brokers.push_back(std::move(*broker));
        if (comma == std::string_view::npos) return brokers;
        list.remove_prefix(comma + 1);
    }
}

Result<void> check_topic(std::string_view topic) {
    constexpr std::size_t longest = 249;
    auto fine = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
               c == '_' || c == '-';
    };
    if (topic.empty() || topic.size() > longest || topic == "." || topic == ".." ||
        !std::ranges::all_of(topic, fine))
        return fail(fmt::format("topic = \"{}\" is no name for one", printable(topic)),
                    fmt::format("letters, digits, '.', '_' and '-', at most {}", longest));
    return {};
}

Result<void> set_security(Target& target, const Settings& settings, bool tls, bool loopback) {
    std::string sasl(settings.text("sasl"));
    std::ranges::transform(sasl, sasl.begin(),
                           [](char c) { return c >= 'a' && c <= 'z' ? char(c - 'a' + 'A') : c; });
    auto user = settings.text("user"), password = settings.text("password");
    if (sasl.empty() != user.empty() || (sasl.empty() && !password.empty()))
        return fail("sasl, user and a password go together");
    if (!sasl.empty() && password.empty())
        return fail("there is no password", "set password_file or password_env");
    target.words.emplace_back("security.protocol",
                              fmt::format("{}{}", sasl.empty() ? "" : "sasl_", tls ? "ssl" : "plaintext"));
    if (!sasl.empty())
        for (auto& [word, value] : {std::pair{"sasl.mechanism", std::string_view(sasl)},
                                    std::pair{"sasl.username", user}, std::pair{"sasl.password", password}})
            target.words.emplace_back(word, value);
    if (!tls && !loopback)
        target.warning = fmt::format("events{} go to {} in the clear: kafkas:// is with TLS",
                                     sasl == "PLAIN" ? " and the password" : "", target.brokers);

    bool insecure = settings.boolean("tls_insecure");
    if (settings.text("tls_cert").empty() != settings.text("tls_key").empty())
        return fail("tls_cert and tls_key go together");
    for (auto& [setting, word] :
         {std::pair{"tls_ca", "ssl.ca.location"}, std::pair{"tls_cert", "ssl.certificate.location"},
          std::pair{"tls_key", "ssl.key.location"}}) {
        std::string file(settings.text(setting));
        if (file.empty()) continue;
        if (!tls) return fail(fmt::format("{} is for TLS", setting), "the url must begin with kafkas://");
        if (::access(file.c_str(), R_OK) != 0)
            return fail(fmt::format("{}: cannot read {}", setting, printable(file)));
        target.words.emplace_back(word, file);
    }
    if (!insecure) return {};
    if (!tls) return fail("tls_insecure is for TLS", "the url must begin with kafkas://");
    target.words.emplace_back("enable.ssl.certificate.verification", "false");
    target.words.emplace_back("ssl.endpoint.identification.algorithm", "none");
    target.warning =
        fmt::format("nobody checks that {} are the right brokers: tls_insecure = true", target.brokers);
    return {};
}

}  // namespace

Result<Target> make_target(const sink::Options& options) {
    bool tls = options.url.starts_with("kafkas://");
    if (!tls && !options.url.starts_with("kafka://"))
        return fail("the url is none of Kafka brokers", std::string(usual_form));
    auto brokers = parse_brokers(options.url, tls);
    if (!brokers) return tl::unexpected(brokers.error());
    auto& settings = options.settings;
    Target target;
    for (auto& broker : *brokers)
        target.brokers += fmt::format("{}{}:{}", target.brokers.empty() ? "" : ",", broker.host, broker.port);
    target.topic = settings.text("topic");
    if (auto fine = check_topic(target.topic); !fine) return tl::unexpected(fine.error());
    target.key = settings.text("key") == "reader" ? Key::reader : Key::tag;
    target.max_message = static_cast<std::size_t>(settings.number("max_message"));
    constexpr std::size_t room = 1000;  // a batch of the largest size, and some that make no batch at all
    target.words = {{"bootstrap.servers", target.brokers},
                    {"client.id", fmt::format("gantry-{}", options.gateway_id)},
                    {"enable.idempotence", "true"},
                    {"acks", "all"},
                    {"message.timeout.ms", "0"},        // our patience decides
                    {"linger.ms", "1000"},              // every batch is flushed as soon as it is handed over
                    {"partitioner", "murmur2_random"},  // the same key goes where Java clients send it
                    {"message.max.bytes", std::to_string(target.max_message)},
                    {"queue.buffering.max.messages", std::to_string(options.batch + room)},
                    {"queue.buffering.max.kbytes", std::to_string(65536 + target.max_message / 1024)},
                    {"compression.type", std::string(settings.text("compression"))},
                    {"socket.keepalive.enable", "true"},
                    {"socket.nagle.disable", "true"},
                    {"reconnect.backoff.max.ms", "1000"},  // the gateway itself waits longer each time
                    {"log.connection.close", "false"}};
    bool loopback = std::ranges::all_of(*brokers, &Broker::is_loopback);
    if (auto set = set_security(target, settings, tls, loopback); !set) return tl::unexpected(set.error());
    return target;
}

}  // namespace gantry::sinks::kafka
