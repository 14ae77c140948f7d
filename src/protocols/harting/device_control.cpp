// Control commands of a virtual reader: resets, radio, lines, clock, login and keys (sections 3 and 9).
#include <algorithm>
#include <array>

#include "protocols/harting/device_call.hpp"
#include "wire/cursor.hpp"

namespace gantry::harting {

// --- resets ------------------------------------------------------------------------------------------------

// The host has found the baud rate when there is an answer at all.
static Status baud_rate_detection(Call& call) {
    return call.data.empty() ? Status::ok : Status::length_error;
}

static Status rf_controller_reset(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    call.restart = true;
    return Status::ok;
}

static Status system_reset(Call& call) {
    if (call.data.size() != 1) return Status::length_error;
    if (call.data[0] != 0) return Status::parameter_range;  // there is no controller beside the first
    call.restart = true;
    return Status::ok;
}

// --- the radio ---------------------------------------------------------------------------------------------

// The field goes off for a moment: tags forget that they were read.
static Status rf_reset(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    call.reading.forget();
    return Status::ok;
}

static Status rf_output(Call& call) {
    static constexpr std::uint8_t antenna_bits = 0x0F, direct_current = 0x10, stays_host = 0x80;
    if (call.data.size() != 1) return Status::length_error;
    auto output = call.data[0];
    auto antenna = static_cast<std::uint8_t>(output & antenna_bits);
    bool known = (output & ~unsigned{antenna_bits | direct_current | stays_host}) == 0;
    if (!known || antenna > antenna_count) return Status::parameter_range;
    call.reader.rf_output(antenna, (output & stays_host) != 0);
    return antenna != 0 && call.reader.is_broken(antenna) ? Status::rf_warning : Status::ok;
}

// --- lines -------------------------------------------------------------------------------------------------

// OUT-NR: digital outputs 1 and 2, relay 1; this reader has no buzzer, and its LEDs are its own.
static std::optional<std::size_t> line_of(std::uint8_t number) {
    switch (number) {
        case 0x01:
            return 0;
        case 0x02:
            return 1;
        case 0x81:
            return 2;
        default:
            return {};
    }
}

static Status set_output(Call& call) {
    static constexpr std::size_t head = 2, each = 4;
    if (call.data.size() < head) return Status::length_error;
    auto count = call.data[1];
    if (call.data.size() != head + count * each) return Status::length_error;
    if (call.data[0] != 0x01 || count == 0) return Status::parameter_range;
    for (std::size_t i = 0; i < count; ++i)
        if (!line_of(call.data[head + i * each])) return Status::parameter_range;
    wire::Reader in(call.data.subspan(head));
    for (std::size_t i = 0; i < count; ++i) {
        auto line = *line_of(in.u8("OUT-NR"));
        auto state = in.u8("OUT-S");
        auto time = in.u16("OUT-TIME");
        call.reader.outputs.set(line, static_cast<OutputMode>(state & 3), state >> 2 & 3, time,
                                call.now.steady);
    }
    return Status::ok;
}

static Status get_input(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    call.answer.push_back(call.reader.inputs());
    return Status::ok;
}

// --- the clock ---------------------------------------------------------------------------------------------

static Status set_system_timer(Call& call) {
    if (call.data.size() != timer_size) return Status::length_error;
    return call.reader.clock.set_timer(call.data, call.now.steady) ? Status::ok : Status::parameter_range;
}

static Status get_system_timer(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    call.reader.clock.append_timer(call.now.steady, call.answer);
    return Status::ok;
}

static Status set_system_time_and_date(Call& call) {
    if (call.data.size() != date_size + timer_size) return Status::length_error;
    bool fine = call.reader.clock.set_date_and_timer(call.data.first(date_size), call.data.subspan(date_size),
                                                     call.now.steady);
    return fine ? Status::ok : Status::parameter_range;
}

static Status get_system_time_and_date(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    call.reader.clock.append_date(call.now.steady, call.answer);
    call.reader.clock.append_timer(call.now.steady, call.answer);
    return Status::ok;
}

// --- login and keys ----------------------------------------------------------------------------------------

static Status reader_login(Call& call) {
    if (call.data.size() != 4) return Status::length_error;
    auto password = call.reader.config.bytes("CFG0.PASSWORD");
    call.reader.logged_in = std::ranges::equal(call.data, password);  // a wrong one logs out
    return call.reader.logged_in ? Status::ok : Status::login_error;
}

// A reader with a password keeps its keys, and what cannot be undone, behind it.
static bool needs_login(const ReaderState& reader) {
    auto password = reader.config.bytes("CFG0.PASSWORD");
    return !reader.logged_in && std::ranges::any_of(password, [](auto byte) { return byte != 0; });
}

static Status take_key(Call& call, ByteView head, std::uint8_t last_type) {
    static constexpr std::size_t aes_128 = 16, aes_192 = 24, aes_256 = 32;
    if (needs_login(call.reader)) return Status::login_request;
    auto size = head.back();
    if (call.data.size() != head.size() + size) return Status::length_error;
    bool fits = size == aes_128 || size == aes_192 || size == aes_256;
    if (!fits || head[0] > 1 || head[head.size() - 2] > last_type) return Status::parameter_range;
    ++call.reader.keys;
    return Status::ok;
}

// MODE, KEY-INDEX, AUTH-MODE, KEY-LEN, KEY. The values of AUTH-MODE are not public.
static Status write_aes_reader_keys(Call& call) {
    if (call.data.size() < 4) return Status::length_error;
    return take_key(call, call.data.first(4), 0xFF);
}

// MODE, KEY-TYPE, KEY-LEN, KEY.
static Status write_reader_authentication_key(Call& call) {
    static constexpr std::uint8_t last_key_type = 2;
    if (call.data.size() < 3) return Status::length_error;
    return take_key(call, call.data.first(3), last_key_type);
}

// Its parameters are not public, and it cannot be undone: nobody can mean one that is taken.
static Status lock_region(Call& call) {
    if (call.data.empty()) return Status::length_error;
    return needs_login(call.reader) ? Status::login_request : Status::command_not_available;
}

static constexpr std::array handlers = {
    HandlerRow{Command::baud_rate_detection, baud_rate_detection},
    HandlerRow{Command::rf_controller_reset, rf_controller_reset},
    HandlerRow{Command::system_reset, system_reset},
    HandlerRow{Command::rf_reset, rf_reset},
    HandlerRow{Command::rf_output, rf_output},
    HandlerRow{Command::set_output, set_output},
    HandlerRow{Command::get_input, get_input},
    HandlerRow{Command::set_system_timer, set_system_timer},
    HandlerRow{Command::get_system_timer, get_system_timer},
    HandlerRow{Command::set_system_time_and_date, set_system_time_and_date},
    HandlerRow{Command::get_system_time_and_date, get_system_time_and_date},
    HandlerRow{Command::lock_region, lock_region},
    HandlerRow{Command::reader_login, reader_login},
    HandlerRow{Command::write_aes_reader_keys, write_aes_reader_keys},
    HandlerRow{Command::write_reader_authentication_key, write_reader_authentication_key},
};
std::span<const HandlerRow> control_handlers() {
    return handlers;
}

Handler find_handler(Command command) {
    for (auto rows : {control_handlers(), config_handlers(), info_handlers(), inventory_handlers(),
                      tag_handlers(), buffer_handlers()})
        for (auto& row : rows)
            if (row.command == command) return row.handler;
    return nullptr;
}

}  // namespace gantry::harting
