#include "fleet.hpp"

#include <array>

#include <fmt/format.h>

#include "base/text.hpp"
#include "link/serial.hpp"
#include "protocols/registry.hpp"
#include "wire/layout.hpp"

namespace gantry::ledger {

using Given = std::vector<std::pair<std::string, std::string>>;

struct Fleet::Kind {
    std::string_view make, name;
    std::uint32_t count = 0;
    bool acknowledges = false;
    Given settings;
};

namespace {
constexpr std::uint32_t line_speed = 38400;

std::uint64_t number(const wire::Fields& fields, std::string_view name) {
    const auto* value = wire::find(fields, name);
    return value == nullptr ? 0 : static_cast<std::uint64_t>(wire::as_number(*value).value_or(0));
}

// Memory as large as the settings allow: a proof is about the gateway, not about full readers.
std::vector<std::pair<std::string, std::string>> silion_settings(bool acknowledges) {
    return {{"ack", acknowledges ? "true" : "false"},
            {"batch", "50ms"},
            {"buffer", "1000000"},
            {"redial", "50ms"},
            {"ack_wait", "5s"},
            {"heartbeat", "1s"}};
}
}  // namespace

Result<std::unique_ptr<Fleet>> Fleet::make(const FleetOptions& options) {
    std::unique_ptr<Fleet> fleet(new Fleet(options));
    const std::array kinds = {
        Kind{"silion", "silion", options.silion, true, silion_settings(true)},
        Kind{"silion", "plain", options.silion_plain, false, silion_settings(false)},
        Kind{
            "harting",
            "harting",
            options.harting,
            true,
            {{"round", "20ms"}, {"buffer", "65535"}, {"redial", "50ms"}, {"repeat", "1s"}, {"clock", "set"}}},
        Kind{"caen", "caen", options.caen, false, {{"round", "20ms"}, {"redial", "50ms"}}},
        Kind{"dagprog", "dagprog", options.dagprog, false, {{"boot", "50ms"}}},
    };
    for (auto& kind : kinds)
        if (auto added = fleet->add(kind); !added) return tl::unexpected(added.error());
    return fleet;
}

Result<void> Fleet::add(const Kind& kind) {
    const auto* plugin = find_plugin(kind.make);
    auto settings = Settings::make(plugin->device_settings, kind.settings);
    if (!settings) return tl::unexpected(settings.error());
    bool on_line = kind.make == "dagprog";
    for (std::uint32_t i = 1; i <= kind.count; ++i) {
        Member member;
        member.fixed.reader = static_cast<std::uint32_t>(members_.size()) + 1;
        member.fixed.make = kind.make;
        member.fixed.name = fmt::format("{}-{}", kind.name, i);
        member.fixed.acknowledges = kind.acknowledges;
        member.air = std::make_unique<PassingAir>(
            on_line ? PassingAir::Kind::hf : PassingAir::Kind::uhf, member.fixed.reader,
            on_line ? options_.dagprog_rate : options_.rate, options_.count);
        DeviceOptions device;
        device.name = member.fixed.name;
        device.seed = member.fixed.reader;
        device.settings = *settings;
        auto made = plugin->make_device(device, *member.air);
        if (on_line) {
            member.fixed.place = fmt::format("{}/{}", options_.pty_dir, member.fixed.name);
            auto host = link::DeviceHost::pty(loop_, std::move(made), member.fixed.place, line_speed);
            if (!host) return tl::unexpected(host.error());
            member.host = std::move(*host);
        } else if (plugin->device_dials) {
            auto target = link::parse_endpoint(options_.connect);
            if (!target) return tl::unexpected(target.error());
            member.host = link::DeviceHost::dial(loop_, std::move(made), *target);
        } else {
            auto host = link::DeviceHost::listen(loop_, std::move(made), {"127.0.0.1", 0});
            if (!host) return tl::unexpected(host.error());
            member.host = std::move(*host);
            member.fixed.place = link::to_text(member.host->local());
        }
        members_.push_back(std::move(member));
    }
    return {};
}

std::vector<Figures> Fleet::figures() {
    std::vector<Figures> out;
    for (auto& member : members_) {
        auto figures = member.fixed;
        member.host->with_device([&](Device& device, Now) {
            auto state = device.state();
            figures.generated = member.air->passed();
            figures.acknowledged = number(state, "reads_acked");
            figures.sent = number(state, "tags_sent");
            figures.connects = number(state, "connects");
            for (const auto* name : {"dropped", "lost_at_restart", "sets_overflowed", "sets_initialized",
                                     "sets_lost_at_reset", "tags_lost"})
                figures.dropped += number(state, name);
        });
        figures.connected = member.host->connected();
        out.push_back(std::move(figures));
    }
    return out;
}

void Fleet::set_rate(double reads_per_second) {
    for (auto& member : members_)
        if (member.fixed.make != "dagprog") member.air->set_rate(reads_per_second);
}

void Fleet::begin() {
    for (auto& member : members_)
        member.air->begin();
}

void Fleet::stop() {
    for (auto& member : members_)
        member.air->stop();
}

bool Fleet::drained() {
    for (auto& each : figures())
        if (each.acknowledges && each.acknowledged + each.dropped < each.generated) return false;
    return true;
}

std::string to_json(const std::vector<Figures>& all) {
    std::string out;
    for (auto& each : all) {
        std::string place;
        append_json_string(place, each.place);
        out += fmt::format(
            R"({}{{"reader":{},"make":"{}","name":"{}","place":{},"acknowledges":{},"connected":{},)"
            R"("generated":{},"acknowledged":{},"sent":{},"dropped":{},"connects":{}}})",
            out.empty() ? "" : ",", each.reader, each.make, each.name, place, each.acknowledges,
            each.connected, each.generated, each.acknowledged, each.sent, each.dropped, each.connects);
    }
    return "[" + out + "]";
}

}  // namespace gantry::ledger
