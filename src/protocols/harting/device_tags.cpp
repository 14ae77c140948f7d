// Commands on one tag: [0xB0] 0x23 and 0x24, and all of [0xB3] (sections 6 and 7).
#include <algorithm>
#include <array>

#include "protocols/harting/device_call.hpp"
#include "protocols/harting/device_inventory.hpp"
#include "protocols/harting/frame.hpp"
#include "protocols/harting/tag_command.hpp"
#include "wire/cursor.hpp"

namespace gantry::harting {

namespace {

constexpr std::uint8_t word_size = 2;
constexpr std::uint8_t more_of_bank = 0x80;  // MODE, with READ_COMPLETE_BANK: the bit that Inventory has

// Gen2's own error codes, after Status::tag_error.
enum class TagError : std::uint8_t { other = 0x00, overrun = 0x03, locked = 0x04, power = 0x0B };

struct Request {
    Status status = Status::ok;  // not ok: nothing else is there
    TagCommand command = {};
    AirAccess access = {};
};

Status status_of(const wire::Fault& fault) {
    using wire::Errc;
    bool of_length =
        fault.code == Errc::truncated || fault.code == Errc::trailing_bytes || fault.code == Errc::bad_length;
    return of_length ? Status::length_error : Status::parameter_range;
}

std::uint32_t number_of(ByteView password) {
    std::uint32_t value = 0;
    for (auto byte : password)
        value = value << 8 | byte;
    return value;
}

// Where inventories tell the TID, it is what tags are addressed by.
bool has_uid(const ReaderState& reader, const Present& tag, ByteView uid, Steady now) {
    if (!reader.setup.with_tid) return std::ranges::equal(tag.sighting.tag.view(), uid);
    auto tid = reader.air.read({reader.carrier(tag.antenna), tag.sighting.tag, 0, now}, Bank::tid, 0, 0);
    return tid && tid->size() >= uid.size() && std::equal(uid.begin(), uid.end(), tid->begin());
}

// The tag that is meant. Not addressed: the strongest.
Status choose_tag(Call& call, Request& request) {
    auto now = call.now.steady;
    auto present = present_tags(call.reader, now);
    if (present.empty()) return call.reader.rf_warning() ? Status::rf_warning : Status::no_transponder;
    auto chosen = present.begin();
    if (request.command.is_addressed())
        chosen = std::ranges::find_if(
            present, [&](auto& tag) { return has_uid(call.reader, tag, request.command.uid, now); });
    if (chosen == present.end()) return Status::no_transponder;
    if (chosen->sighting.technology != event::Technology::epc_gen2 || !call.reader.setup.reads_gen2)
        return Status::wrong_transponder_type;
    request.access = {call.reader.carrier(chosen->antenna), chosen->sighting.tag, 0, now};
    return Status::ok;
}

struct Rules {
    std::uint8_t mode_bits = address_bits | uid_length | extended_address;
    std::uint8_t mode_needs = 0;
    bool must_address = false;
};

Request understand(Call& call, std::uint8_t control, const Rules& rules) {
    Request request;
    auto parsed = parse_tag_command(control, call.data);
    if (!parsed) return {status_of(parsed.error())};
    request.command = std::move(*parsed);
    auto& command = request.command;
    auto addressing = command.mode & address_bits;
    bool legal = (command.mode & ~unsigned{rules.mode_bits}) == 0 &&
                 (command.mode & rules.mode_needs) == rules.mode_needs &&
                 (addressing == addressed || (addressing == 0 && !rules.must_address)) &&
                 (!command.is_addressed() || (!command.uid.empty() && (command.mode & uid_length) != 0)) &&
                 (command.password.empty() || command.password.size() == 4);
    if (!legal) return {Status::parameter_range};
    request.status = choose_tag(call, request);
    request.access.password = number_of(command.password);
    return request;
}

// A password that the tag does not take ends the talk: that is no error code of the tag.
bool was_password_wrong(Call& call, const AirAccess& access) {
    if (access.password == 0) return false;
    auto pc = call.reader.air.read(access, Bank::epc, 1, 1);
    return !pc && pc.error() == AirError::locked;
}

Status refused(Call& call, const AirAccess& access, AirError error) {
    auto tag_says = [&](TagError code) {
        call.answer.push_back(static_cast<std::uint8_t>(code));
        return Status::tag_error;
    };
    switch (error) {
        case AirError::no_tag:
            return Status::no_transponder;
        case AirError::locked:
            return was_password_wrong(call, access) ? Status::authentication_error
                                                    : tag_says(TagError::locked);
        case AirError::bad_address:
            return tag_says(TagError::overrun);
        case AirError::insufficient_power:
            return tag_says(TagError::power);
        case AirError::unsupported:
            break;
    }
    return tag_says(TagError::other);
}

Bank bank_of(const TagCommand& command) {
    return static_cast<Bank>(command.bank & bank_bits);
}

bool is_bank_legal(std::uint8_t bank) {
    return (bank & ~unsigned{bank_bits | bank_password}) == 0;
}

// --- [0xB0] ------------------------------------------------------------------------------------------------

std::size_t most_blocks(const ReaderState& reader) {
    static constexpr std::size_t others = 10;  // section 6.4
    return std::min<std::size_t>(0xFF, (reader.tx_buf - others) / (word_size + 1));
}

Status read_complete(Call& call, const Request& request) {
    auto& next = call.reader.bank_next;
    auto first = request.command.address;
    if ((request.command.mode & more_of_bank) != 0) {
        if (!next) return Status::no_valid_data;
        first = *next;
    }
    next.reset();
    auto data = call.reader.air.read(request.access, bank_of(request.command), first, 0);
    if (!data) return refused(call, request.access, data.error());
    auto room = most_blocks(call.reader) * word_size;
    append_block_data(ByteView(*data).first(std::min(room, data->size())), word_size, call.answer);
    if (data->size() <= room) return Status::ok;
    next = static_cast<std::uint16_t>(first + room / word_size);
    return Status::more_data;
}

Status read_multiple_blocks(Call& call) {
    auto request = understand(
        call, host_command,
        {.mode_bits = address_bits | uid_length | extended_address | read_complete_bank | more_of_bank,
         .mode_needs = extended_address});
    if (request.status != Status::ok) return request.status;
    auto& command = request.command;
    if (!is_bank_legal(command.bank)) return Status::parameter_range;
    if ((command.mode & read_complete_bank) != 0) return read_complete(call, request);
    bool fits = command.count > 0 && command.count <= most_blocks(call.reader);
    if (!fits || (command.mode & more_of_bank) != 0) return Status::parameter_range;
    if (std::size_t{command.address} + command.count > 0x10000) return Status::address_error;
    auto data = call.reader.air.read(request.access, bank_of(command), command.address, command.count);
    if (!data) return refused(call, request.access, data.error());
    append_block_data(*data, word_size, call.answer);
    return Status::ok;
}

// DB-ADR-E: the first block that could not be written. All or none of them are, so it is the first one that
// the tag has not, or the first at all.
std::uint16_t first_failed(Call& call, const Request& request, AirError error) {
    auto& command = request.command;
    if (error != AirError::bad_address) return command.address;
    auto bank = call.reader.air.read(request.access, bank_of(command), 0, 0);
    auto words = bank ? bank->size() / word_size : 0;
    return static_cast<std::uint16_t>(std::max<std::size_t>(command.address, words));
}

Status write_multiple_blocks(Call& call) {
    auto request = understand(call, host_command, {.mode_needs = extended_address});
    if (request.status != Status::ok) return request.status;
    auto& command = request.command;
    if (!is_bank_legal(command.bank) || command.count == 0 || command.size != word_size)
        return Status::parameter_range;
    if (std::size_t{command.address} + command.count > 0x10000) return Status::address_error;
    auto done = call.reader.air.write(request.access, bank_of(command), command.address, command.data);
    if (done) return Status::ok;
    auto status = Status::write_error;  // the tag is there, and too far away for writing
    if (done.error() != AirError::insufficient_power) status = refused(call, request.access, done.error());
    if (status == Status::write_error || status == Status::tag_error)
        wire::Writer(call.answer).u16(first_failed(call, request, done.error()));
    return status;
}

// --- [0xB3] ------------------------------------------------------------------------------------------------

Status finish(Call& call, const Request& request, const AirResult<void>& done) {
    return done ? Status::ok : refused(call, request.access, done.error());
}

Status kill(Call& call) {
    auto request = understand(
        call, epc_command,
        {.mode_bits = address_bits | recommission | uid_length | extended_address, .must_address = true});
    if (request.status != Status::ok) return request.status;
    auto& command = request.command;
    if (command.password.size() != 4) return Status::parameter_range;
    // What a tag is recommissioned to, none of the virtual ones can be.
    if (command.recom.value_or(0) != 0) return refused(call, request.access, AirError::unsupported);
    auto password = std::exchange(request.access.password, 0);
    auto done = call.reader.air.kill(request.access, password);
    // A wrong password is all that a tag refuses a kill for.
    if (!done && done.error() == AirError::locked) return Status::authentication_error;
    return finish(call, request, done);
}

Status lock(Call& call) {
    auto request = understand(call, epc_command, {.must_address = true});
    if (request.status != Status::ok) return request.status;
    auto& command = request.command;
    if (command.type != type_epc_gen2) return Status::wrong_transponder_type;
    if (command.data.size() != 3) return Status::parameter_range;
    auto bits = lock_bits(command.data);
    return finish(call, request, call.reader.air.lock(request.access, {bits.mask, bits.action}));
}

constexpr Rules permalock_rules{.mode_needs = uid_length | extended_address, .must_address = true};
constexpr std::uint32_t blocks_of_group = 16;

bool is_range_legal(const TagCommand& command) {
    static constexpr std::uint8_t most_groups = 4;
    return is_bank_legal(command.bank) && bank_of(command) == Bank::user && command.count > 0 &&
           command.count <= most_groups;
}

Status block_permalock(Call& call) {
    auto request = understand(call, epc_command, permalock_rules);
    if (request.status != Status::ok) return request.status;
    auto& command = request.command;
    if (!is_range_legal(command)) return Status::parameter_range;
    return finish(call, request,
                  call.reader.air.permalock(request.access, Bank::user, command.address * blocks_of_group,
                                            command.data));
}

Status read_permalock_status(Call& call) {
    auto request = understand(call, epc_command, permalock_rules);
    if (request.status != Status::ok) return request.status;
    auto& command = request.command;
    if (!is_range_legal(command)) return Status::parameter_range;
    auto mask = call.reader.air.permalocked(request.access, Bank::user, command.address * blocks_of_group,
                                            std::uint32_t{command.count} * 2);
    if (!mask) return refused(call, request.access, mask.error());
    call.answer = std::move(*mask);
    return Status::ok;
}

// The bytes of these two are not public, and no virtual tag can do what they ask for.
Status not_published(Call& call) {
    if (call.data.size() < 2) return Status::length_error;
    if (present_tags(call.reader, call.now.steady).empty()) return Status::no_transponder;
    return Status::command_not_available;
}

constexpr std::array handlers = {
    HandlerRow{Command::read_multiple_blocks, read_multiple_blocks},
    HandlerRow{Command::write_multiple_blocks, write_multiple_blocks},
    HandlerRow{Command::kill, kill},
    HandlerRow{Command::lock, lock},
    HandlerRow{Command::block_permalock, block_permalock},
    HandlerRow{Command::read_permalock_status, read_permalock_status},
    HandlerRow{Command::untraceable, not_published},
    HandlerRow{Command::authenticate, not_published},
};

}  // namespace

std::span<const HandlerRow> tag_handlers() {
    return handlers;
}

}  // namespace gantry::harting
