#include "protocols/harting/driver_dialog.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace gantry::harting {

Request::Request(Command command, Bytes parameters) : control(control_of(command)) {
    if (has_sub(control)) {
        data.push_back(sub_of(command));
        patience = radio_patience;
    }
    data.insert(data.end(), parameters.begin(), parameters.end());
}

bool Request::is(Command command) const {
    return control == control_of(command) &&
           (!has_sub(control) || (!data.empty() && data.front() == sub_of(command)));
}

std::string_view Request::name() const {
    auto* known = row();
    return known != nullptr ? known->name : "an unknown command";
}

Request read_block(std::uint8_t number, bool eeprom) {
    return Request(Command::read_configuration,
                   {static_cast<std::uint8_t>(number | (eeprom ? cfg_eeprom : 0))});
}

Request write_block(std::uint8_t number, const Block& block, bool eeprom) {
    Bytes data{static_cast<std::uint8_t>(number | (eeprom ? cfg_eeprom : 0))};
    data.insert(data.end(), block.begin(), block.end());
    return Request(Command::write_configuration, std::move(data));
}

std::optional<Block> Reply::block() const {
    if (silent || data.size() != block_size) return {};
    bool with_data = is(Status::ok) || is(Status::rf_warning) || is(Status::firmware_activation) ||
                     is(Status::wrong_firmware) || is(Status::hardware_warning);
    if (!with_data) return {};
    Block out;
    std::ranges::copy(data, out.begin());
    return out;
}

std::string Reply::words() const {
    if (silent) return "no answer";
    if (is(Status::tag_error) && !data.empty())
        return fmt::format("{}: {}", describe(status), describe_tag_error(data.front()));
    return describe(status);
}

Mode KnownReader::mode() const {
    return static_cast<Mode>(get_number(config_row("CFG1.MODE"), interface));
}

void KnownReader::keep(std::uint8_t number, const Block& block) {
    constexpr std::uint8_t interface_block = 1, identity_block = 4, read_data_block = 11, scan_block = 13;
    if (auto ours = set.find(number); ours != set.end()) ours->second = block;
    switch (number) {
        case interface_block:
            interface = block;
            interface_known = true;
            return;
        case identity_block:
            tids.reset();
            return;
        case read_data_block:
            read_data = block;
            return;
        case scan_block:
            scan_format = block;
            return;
        default:
            return;
    }
}

Bank KnownReader::block_bank() const {
    return static_cast<Bank>(get_number(config_row("CFG11.BANK"), read_data) & 3);
}

}  // namespace gantry::harting
