// [0x80], [0x81], [0x83]: the configuration blocks as hosts read and write them (sections 3 and 9).
#include <algorithm>
#include <array>

#include "protocols/harting/device_call.hpp"

namespace gantry::harting {

// A bit a block from byte 8 of CFG0 on; the last one is for CFG22 to CFG29 together.
bool is_locked(const ReaderState& reader, std::size_t block) {
    static constexpr std::size_t locks = 8, first_of_group = 22, last_of_group = 29;
    if (reader.logged_in) return false;
    if (block > last_of_group) return false;
    auto bit = std::min(block, first_of_group);
    return (reader.config.block(0, false)[locks + bit / 8] >> bit % 8 & 1u) != 0;
}

static Status refused(const ReaderState& reader, std::size_t block, Status when_reserved) {
    if (blocks()[block].reserved) return when_reserved;
    return is_locked(reader, block) ? Status::login_request : Status::ok;
}

static Status read_configuration(Call& call) {
    if (call.data.size() != 1) return Status::length_error;
    auto where = call.data[0];
    if ((where & cfg_all) != 0) return Status::parameter_range;  // a reply has room for one block
    auto number = std::size_t{where} & cfg_number;
    if (auto status = refused(call.reader, number, Status::read_protect); status != Status::ok) return status;
    auto& block = call.reader.config.block(number, (where & cfg_eeprom) != 0);
    call.answer.assign(block.begin(), block.end());
    return Status::ok;
}

static void changed(Call& call) {
    call.reader.changed();
    call.reader.trigger.restart(call.reader.setup, call.reader.input(0), call.now.steady);
}

static Status write_configuration(Call& call) {
    if (call.data.size() != 1 + block_size) return Status::length_error;
    auto where = call.data[0];
    if ((where & cfg_all) != 0) return Status::parameter_range;
    auto number = std::size_t{where} & cfg_number;
    if (auto status = refused(call.reader, number, Status::write_protect); status != Status::ok)
        return status;
    Block block;
    std::ranges::copy(call.data.subspan(1), block.begin());
    if (!is_legal(number, block)) return Status::parameter_range;
    call.reader.config.write(number, block, (where & cfg_eeprom) != 0);
    changed(call);
    return Status::ok;
}

// All blocks at once: none of them if one is locked.
static Status reset_configuration(Call& call) {
    if (call.data.size() != 1) return Status::length_error;
    auto where = call.data[0];
    bool all = (where & cfg_all) != 0;
    auto first = all ? 0 : std::size_t{where} & cfg_number;
    auto last = all ? block_count - 1 : first;
    for (auto i = first; i <= last; ++i) {
        auto status = refused(call.reader, i, Status::write_protect);
        if (status != Status::ok && !(all && blocks()[i].reserved)) return status;
    }
    for (auto i = first; i <= last; ++i)
        call.reader.config.to_factory(i, (where & cfg_eeprom) != 0);
    changed(call);
    return Status::ok;
}

static constexpr std::array handlers = {
    HandlerRow{Command::read_configuration, read_configuration},
    HandlerRow{Command::write_configuration, write_configuration},
    HandlerRow{Command::reset_configuration, reset_configuration},
};
std::span<const HandlerRow> config_handlers() {
    return handlers;
}

}  // namespace gantry::harting
