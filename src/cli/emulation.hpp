#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cli/link_watch.hpp"
#include "field/field.hpp"
#include "field/scene.hpp"
#include "link/device_host.hpp"
#include "reader/plugin.hpp"

namespace gantry::cli {

// A virtual reader that is to be: what it is, what it hears, and its one link.
struct VirtualReader {
    const Plugin* plugin = nullptr;
    DeviceOptions device;
    Air* air = nullptr;
    std::optional<link::Endpoint> connect, listen;  // of a make that dials, or is dialled; port 0: any
    std::string pty;                                // a serial line instead
    std::optional<std::uint32_t> baud;              // of that line; nothing: what is usual for the make

    // Some makes have readers that only dial; some have readers that are dialled until they are told to dial.
    bool dials() const {
        return pty.empty() && (plugin->device_dials || (connect && !plugin->dial_setting.empty()));
    }
};

// One process's virtual readers: a field that they are in, and a host with a link for each of them.
class Emulation {
public:
    Emulation() : loop_("emulate") {}

    field::Field& field() { return field_; }
    // In place of that field.
    field::Scene& play(const field::Scenario& scenario, Steady start, double speed) {
        scene_ = std::make_unique<field::Scene>(scenario, start, speed);
        return *scene_;
    }
    // Before the first that dials: how many will, and where, for people.
    void will_dial(const std::string& place, std::size_t readers);
    void add(VirtualReader reader);
    // Would inject() take it, once they are started? Nothing happens to them.
    Result<void> check(std::string_view command) const;
    // Gives all that were added their links.
    Result<void> start();

    // To all of them, or "NAME: COMMAND" to one.
    Result<void> inject(std::string_view command);
    void print_state(std::ostream& out);
    const std::vector<std::string>& places() const { return places_; }  // where they can be reached
    const LinkWatch* watch() const { return watch_.get(); }             // of readers that dial

private:
    field::Field field_;
    std::unique_ptr<field::Scene> scene_;
    struct Call {
        std::string_view only, command;  // the reader that is meant; empty: all
    };
    Result<Call> read(std::string_view command) const;
    Result<void> start(const VirtualReader& reader);

    std::vector<VirtualReader> readers_;
    std::vector<std::string> places_;
    std::unique_ptr<LinkWatch> watch_;
    std::size_t dialling_ = 0;
    link::Loop loop_;
    std::vector<std::unique_ptr<link::DeviceHost>> hosts_;  // go before the loop and the field that they use
};

}  // namespace gantry::cli
