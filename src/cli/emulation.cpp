#include "cli/emulation.hpp"

#include <algorithm>
#include <ostream>

#include <fmt/format.h>
#include <boost/json.hpp>

#include "api/json_text.hpp"
#include "api/message_json.hpp"
#include "base/text.hpp"
#include "link/serial.hpp"

namespace gantry::cli {

void Emulation::will_dial(const std::string& place, std::size_t readers) {
    watch_ = std::make_unique<LinkWatch>(place, readers);
}

void Emulation::add(VirtualReader reader) {
    readers_.push_back(std::move(reader));
}

Result<void> Emulation::start() {
    for (auto& reader : readers_)
        if (auto started = start(reader); !started) return started;
    return {};
}

Result<void> Emulation::start(const VirtualReader& reader) {
    auto& name = reader.device.name;
    auto device = reader.plugin->make_device(reader.device, *reader.air);
    if (!reader.pty.empty()) {
        auto line = std::ranges::find(reader.plugin->schemes, LinkKind::serial, &Scheme::kind);
        auto baud = reader.baud.value_or(link::baud_of(line->line));
        auto host = link::DeviceHost::pty(loop_, std::move(device), reader.pty, baud);
        if (!host) return tl::unexpected(host.error());
        places_.push_back(reader.pty);
        hosts_.push_back(std::move(*host));
    } else if (reader.dials()) {
        auto tell = [watch = watch_.get(), number = dialling_++, name](const link::LinkNews& news) {
            watch->told(number, name, news, link::read_clocks().steady);
        };
        hosts_.push_back(link::DeviceHost::dial(loop_, std::move(device), *reader.connect, tell));
    } else {
        auto place = reader.listen.value_or(link::Endpoint{"127.0.0.1", 0});
        auto host = link::DeviceHost::listen(loop_, std::move(device), place);
        if (!host) return tl::unexpected(host.error());
        places_.push_back(link::to_text((*host)->local()));
        hosts_.push_back(std::move(*host));
    }
    return {};
}

Result<Emulation::Call> Emulation::read(std::string_view command) const {
    std::string_view only;
    if (auto colon = command.find(": "); command.find(' ') == colon + 1 && colon != std::string_view::npos) {
        only = command.substr(0, colon);
        command.remove_prefix(colon + 2);
        std::vector<std::string_view> names;
        for (auto& reader : readers_)
            names.push_back(reader.device.name);
        if (std::ranges::find(names, only) == names.end())
            return fail(fmt::format("there is no virtual reader \"{}\"", printable(only)),
                        fmt::format("there is {}", fmt::join(names, ", ")));
    }
    return Call{only, command};
}

// Not every make can have every fault: one that has taken it is enough. Tried with readers of the same kind
// that nobody sees, in a field of their own.
Result<void> Emulation::check(std::string_view command) const {
    auto call = read(command);
    if (!call) return tl::unexpected(call.error());
    field::Field apart;
    auto now = link::read_clocks();
    Result<void> refused;
    for (auto& reader : readers_) {
        if (!call->only.empty() && reader.device.name != call->only) continue;
        auto device = reader.plugin->make_device(reader.device, apart.add_reader(reader.device.name, 1));
        device->power_on(now);
        refused = device->inject(call->command, now);
        if (refused) break;
    }
    return refused;
}

Result<void> Emulation::inject(std::string_view command) {
    auto call = read(command);
    if (!call) return tl::unexpected(call.error());
    Result<void> refused;
    bool taken = hosts_.empty();
    for (std::size_t i = 0; i < hosts_.size(); ++i) {
        if (!call->only.empty() && readers_[i].device.name != call->only) continue;
        hosts_[i]->with_device([&](Device& device, Now now) {
            if (auto fine = device.inject(call->command, now))
                taken = true;
            else
                refused = fine;
        });
    }
    return taken ? Result<void>{} : refused;
}

void Emulation::print_state(std::ostream& out) {
    for (std::size_t i = 0; i < hosts_.size(); ++i) {
        wire::Fields state;
        hosts_[i]->with_device([&](Device& device, Now) { state = device.state(); });
        std::string line = R"({"name":)";
        append_json_string(line, readers_[i].device.name);
        line += fmt::format(R"(,"connected":{},"state":{}}})", hosts_[i]->connected(),
                            api::json_text(api::to_json(state)));
        out << line << '\n';
    }
    out << std::flush;
}

}  // namespace gantry::cli
