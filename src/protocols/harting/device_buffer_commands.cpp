// [0x22], [0x31] to [0x34]: what a host does with the buffer (section 8).
#include <array>

#include "protocols/harting/device_call.hpp"
#include "protocols/harting/frame.hpp"
#include "wire/cursor.hpp"

namespace gantry::harting {

// In notification mode the buffer's sets belong to the channel.
static Status read_buffer(Call& call) {
    if (call.data.size() != 2) return Status::length_error;
    auto wanted = static_cast<std::size_t>(call.data[0] << 8 | call.data[1]);
    if (wanted == 0) return Status::parameter_range;
    auto& reader = call.reader;
    if (reader.mode() != Mode::buffered_read) return Status::command_not_available;
    call.buffer_read = 0;
    if (reader.buffer.size() == 0) return Status::no_valid_data;
    auto available = std::min(wanted, reader.buffer.size());
    call.buffer_read = append_sets(reader.buffer, available, false, reader.tx_buf - min_reply, reader.setup,
                                   reader.mac, call.answer);
    reader.buffer.was_sent(call.buffer_read);
    if (reader.buffer.overflowed()) {
        reader.buffer.told();
        return Status::buffer_overflow;
    }
    if (call.buffer_read < available) return Status::more_data;
    return reader.rf_warning() ? Status::rf_warning : Status::ok;
}

static Status read_data_buffer_info(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    wire::Writer writer(call.answer);
    writer.u16(call.reader.buffer.capacity());
    writer.u16(call.reader.buffer.first_place());
    writer.u16(call.reader.buffer.size());
    return call.reader.buffer.overflowed() ? Status::buffer_overflow : Status::ok;
}

static Status clear_data_buffer(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    if (call.reader.mode() == Mode::notification)
        return call.notifier.acknowledge(call.now) ? Status::ok : Status::no_valid_data;
    if (call.buffer_read == 0) return Status::no_valid_data;
    call.reader.buffer.clear(std::exchange(call.buffer_read, 0));
    return Status::ok;
}

static Status initialize_buffer(Call& call) {
    if (!call.data.empty()) return Status::length_error;
    call.buffer_read = 0;
    call.reader.buffer.initialize();
    call.reading.forget();
    call.notifier.buffer_emptied();
    return Status::ok;
}

static Status force_notify_trigger(Call& call) {
    if (call.data.size() != 1) return Status::length_error;
    if (call.data[0] != 0) return Status::parameter_range;
    if (call.reader.mode() != Mode::notification) return Status::command_not_available;
    call.notifier.tell_all();
    return Status::ok;
}

static constexpr std::array handlers = {
    HandlerRow{Command::read_buffer, read_buffer},
    HandlerRow{Command::read_data_buffer_info, read_data_buffer_info},
    HandlerRow{Command::clear_data_buffer, clear_data_buffer},
    HandlerRow{Command::initialize_buffer, initialize_buffer},
    HandlerRow{Command::force_notify_trigger, force_notify_trigger},
};
std::span<const HandlerRow> buffer_handlers() {
    return handlers;
}

}  // namespace gantry::harting
