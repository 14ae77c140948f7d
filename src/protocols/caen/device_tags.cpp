// The commands that read, write, lock and kill tags.
#include <algorithm>
#include <array>

#include "protocols/caen/device_call.hpp"
#include "protocols/caen/device_mask.hpp"

namespace gantry::caen {

using event::Technology;

static constexpr std::uint32_t max_value = 128;  // bytes of a TagValue (section 4, 0x4D)

static ResultCode code_of(AirError error) {
    switch (error) {
        case AirError::no_tag:
            return ResultCode::tag_not_present;
        case AirError::locked:
            return ResultCode::tag_locked;
        case AirError::bad_address:
            return ResultCode::bad_tag_address;
        case AirError::insufficient_power:
            return ResultCode::insufficient_power;
        case AirError::unsupported:
            return ResultCode::unsupported;
    }
    return ResultCode::tag_error;
}

// Does `work` with an AirAccess, on each read point of the source until the tag answers.
template <class Work>
static auto on_each_point(const Call& call, std::size_t source, const event::TagId& tag, Work work)
    -> decltype(work(AirAccess{})) {
    for (auto point : call.memory.points_of(source)) {
        if (call.memory.antenna(point) == ReaderMemory::Antenna::bad) continue;
        AirAccess access{call.memory.carrier(point), tag, call.arguments.number(Attribute::g2_password),
                         call.now.steady};
        auto done = work(access);
        if (done || done.error() != AirError::no_tag) return done;
    }
    return tl::unexpected(AirError::no_tag);
}

// The tag that a request is about, with its source.
struct Target {
    ResultCode result = ResultCode::success;
    std::size_t source = 0;
    event::TagId tag = {};
};

static Target source_alone(const Call& call) {
    auto [result, source] = choose_source(call.arguments, call.memory);
    if (result != ResultCode::success) return {result};
    if (call.memory.ram.sources[source].read_points == 0) return {ResultCode::source_disabled};
    return {.source = source};
}

static Target by_mask(const Call& call, Target target, ByteView id) {
    TagMask mask{
        .bank = static_cast<Bank>(call.arguments.of_mask(Attribute::memory_bank)->number().value_or(0)),
        .first_bit = 0,
        .bits = static_cast<std::uint32_t>(id.size() * 8),
        .bytes = Bytes(id.begin(), id.end())};
    if (const auto* position = call.arguments.of_mask(Attribute::tag_address))
        mask.first_bit = position->number().value_or(0);
    for (auto& tag : call.memory.present(target.source, Technology::epc_gen2, call.now.steady)) {
        AirAccess access{call.memory.carrier(tag.read_point), tag.sighting.tag, 0, call.now.steady};
        if (!mask.matches(call.memory.air, access, Technology::epc_gen2)) continue;
        target.tag = tag.sighting.tag;
        return target;
    }
    return {ResultCode::tag_not_present};
}

// TagID, or what a mask picks (section 6.2).
static Target choose_tag(const Call& call) {
    auto target = source_alone(call);
    if (target.result != ResultCode::success) return target;
    auto id = call.arguments.bytes(Attribute::tag_id);
    if (call.arguments.of_mask(Attribute::memory_bank) != nullptr) return by_mask(call, target, id);
    if (id.empty() || id.size() > event::TagId::max_size) return {ResultCode::tag_not_present};
    target.tag = event::TagId(id);
    return target;
}

// For commands that name no tag: the one that answers best.
static Target choose_nearest(const Call& call, Technology technology) {
    auto target = source_alone(call);
    if (target.result != ResultCode::success) return target;
    auto present = call.memory.present(target.source, technology, call.now.steady);
    if (present.empty()) return {ResultCode::tag_not_present};
    target.tag = present.front().sighting.tag;
    return target;
}

static ResultCode finish(const AirResult<void>& done) {
    return done ? ResultCode::success : code_of(done.error());
}
static ResultCode finish(Call& call, const AirResult<Bytes>& data) {
    if (!data) return code_of(data.error());
    append_bytes(call.answer, Attribute::tag_value, *data);
    return ResultCode::success;
}

// --- Gen2 --------------------------------------------------------------------------------------------------

// Addresses and lengths are bytes, and even (section 4, 0x4E and 0x50).
struct Words {
    ResultCode result = ResultCode::success;
    Bank bank = Bank::reserved;
    std::uint32_t first = 0, count = 0;
};
static Words words_of(const Call& call) {
    auto address = call.arguments.number(Attribute::tag_address);
    auto length = call.arguments.number(Attribute::length);
    if (length == 0 || length % 2 != 0 || length > max_value) return {ResultCode::invalid_parameter};
    if (address % 2 != 0) return {ResultCode::bad_tag_address};
    return {.bank = static_cast<Bank>(call.arguments.number(Attribute::memory_bank)),
            .first = address / 2,
            .count = length / 2};
}

static ResultCode g2_read(Call& call) {
    auto words = words_of(call);
    if (words.result != ResultCode::success) return words.result;
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    return finish(call, on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
                      return call.memory.air.read(access, words.bank, words.first, words.count);
                  }));
}

static ResultCode g2_write(Call& call) {
    auto words = words_of(call);
    auto data = call.arguments.bytes(Attribute::tag_value);
    if (words.result != ResultCode::success) return words.result;
    if (data.size() != words.count * 2) return ResultCode::invalid_parameter;
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    return finish(on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
        return call.memory.air.write(access, words.bank, words.first, data);
    }));
}

static ResultCode g2_lock(Call& call) {
    auto payload = call.arguments.number(Attribute::payload);
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    AirLock lock{static_cast<std::uint16_t>(payload >> 10 & 0x3FF),
                 static_cast<std::uint16_t>(payload & 0x3FF)};
    return finish(on_each_point(call, target.source, target.tag,
                                [&](const AirAccess& access) { return call.memory.air.lock(access, lock); }));
}

// A wrong password is all that a tag refuses a kill for.
static ResultCode finish_kill(const AirResult<void>& done) {
    return !done && done.error() == AirError::locked ? ResultCode::kill_error : finish(done);
}

static ResultCode g2_kill(Call& call) {
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    auto password = call.arguments.number(Attribute::g2_password);
    return finish_kill(on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
        auto without = access;  // the password is the kill password
        without.password = 0;
        return call.memory.air.kill(without, password);
    }));
}

// Writes length and numbering system into the PC word and the EPC after it, in one go.
static ResultCode g2_program(Call& call) {
    static constexpr std::uint32_t max_nsi = 0x1FF, pc_word = 1,
                                   kept_bits = 0x0600;  // the tag's own: UMI, XI
    auto id = call.arguments.bytes(Attribute::tag_id);
    auto nsi = call.arguments.number(Attribute::g2_nsi);
    if (id.empty() || id.size() % 2 != 0 || id.size() > event::TagId::max_size)
        return ResultCode::invalid_parameter;
    if (nsi > max_nsi) return ResultCode::bad_parameter_value;
    auto target = choose_nearest(call, Technology::epc_gen2);
    if (target.result != ResultCode::success) return target.result;
    return finish(
        on_each_point(call, target.source, target.tag, [&](const AirAccess& access) -> AirResult<void> {
            auto before = call.memory.air.read(access, Bank::epc, pc_word, 1);
            if (!before) return tl::unexpected(before.error());
            auto kept = (std::uint32_t{(*before)[0]} << 8 | (*before)[1]) & kept_bits;
            auto pc = static_cast<std::uint32_t>(id.size() / 2) << 11 | kept | nsi;
            Bytes data{static_cast<std::uint8_t>(pc >> 8), static_cast<std::uint8_t>(pc & 0xFF)};
            data.insert(data.end(), id.begin(), id.end());
            return call.memory.air.write(access, Bank::epc, pc_word, data);
        }));
}

static ResultCode g2_query(Call& call) {
    return choose_nearest(call, Technology::epc_gen2).result;
}

static ResultCode g2_query_ack(Call& call) {
    auto target = choose_nearest(call, Technology::epc_gen2);
    if (target.result == ResultCode::success) append_bytes(call.answer, Attribute::tag_id, target.tag.view());
    return target.result;
}

// A virtual tag knows no maker's own commands: it does not understand any.
static ResultCode g2_custom(Call& call) {
    if (call.arguments.number(Attribute::length) > max_value) return ResultCode::invalid_parameter;
    if (const auto* size = call.arguments.of_mask(Attribute::length);
        size != nullptr && size->number() != call.arguments.bytes(Attribute::tag_value).size())
        return ResultCode::invalid_parameter;
    auto target =
        call.arguments.has(Attribute::tag_id) ? choose_tag(call) : choose_nearest(call, Technology::epc_gen2);
    if (target.result != ResultCode::success) return target.result;
    auto heard = on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
        return call.memory.air.read(access, Bank::tid, 0, 1);
    });
    return heard ? ResultCode::unsupported : code_of(heard.error());
}

// --- ISO 18000-6B ------------------------------------------------------------------------------------------

static ResultCode read_data(Call& call) {
    auto length = call.arguments.number(Attribute::length);
    if (length == 0 || length > max_value) return ResultCode::invalid_parameter;
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    auto address = call.arguments.number(Attribute::tag_address);
    return finish(call, on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
                      return call.memory.air.read_bytes(access, address, length);
                  }));
}

// BlockWriteTag differs in speed only: four bytes at a time.
static ResultCode write_data(Call& call) {
    auto data = call.arguments.bytes(Attribute::tag_value);
    if (data.empty() || data.size() != call.arguments.number(Attribute::length))
        return ResultCode::invalid_parameter;
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    auto address = call.arguments.number(Attribute::tag_address);
    return finish(on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
        return call.memory.air.write_bytes(access, address, data);
    }));
}

static ResultCode lock_data(Call& call) {
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    auto address = call.arguments.number(Attribute::tag_address);
    return finish(on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
        return call.memory.air.lock_byte(access, address);
    }));
}

// Compares eight bytes of memory, of which the mask says which count: its highest bit is the first byte.
static bool selected(std::uint32_t operation, std::uint32_t mask, ByteView memory, ByteView value) {
    int order = 0;
    for (std::size_t i = 0; i < value.size() && order == 0; ++i)
        if ((mask >> (7 - i) & 1u) != 0) order = int{memory[i]} - int{value[i]};
    switch (operation & 3u) {
        case 0:
            return order == 0;
        case 1:
            return order != 0;
        case 2:
            return order > 0;
        default:
            return order < 0;
    }
}

// Answers the tags that are selected afterwards: those that match, or on unselect those that do not.
static ResultCode group_select(Call& call) {
    static constexpr std::uint32_t unselect = 4;
    auto operation = call.arguments.number(Attribute::sel_unsel_op);
    auto mask = call.arguments.number(Attribute::bitmask) & 0xFFu;  // the low 8 bits count (0x67)
    auto address = call.arguments.number(Attribute::tag_address);
    auto value = call.arguments.bytes(Attribute::tag_value);
    if (value.empty() || value.size() > 8) return ResultCode::invalid_parameter;
    auto target = source_alone(call);
    if (target.result != ResultCode::success) return target.result;
    auto present = call.memory.present(target.source, Technology::iso18000_6b, call.now.steady);
    if (present.empty()) return ResultCode::tag_not_present;
    std::vector<event::TagId> chosen;
    for (auto& tag : present) {
        AirAccess access{call.memory.carrier(tag.read_point), tag.sighting.tag, 0, call.now.steady};
        auto memory = call.memory.air.read_bytes(access, address, static_cast<std::uint32_t>(value.size()));
        if (!memory || selected(operation, mask, *memory, value) == (operation >= unselect)) continue;
        if (std::ranges::find(chosen, tag.sighting.tag) == chosen.end()) chosen.push_back(tag.sighting.tag);
    }
    if (chosen.empty()) return ResultCode::select_error;
    for (auto& id : chosen)
        append_bytes(call.answer, Attribute::tag_id, id.view());
    return ResultCode::success;
}

// --- EPC Gen1 and EPC 1.19 ---------------------------------------------------------------------------------

static ResultCode program(Call& call, const Target& target, const event::TagId& id, std::uint32_t password,
                          bool lock) {
    return finish(on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
        return call.memory.air.program(access, id, password, lock);
    }));
}

static ResultCode gen1_program(Call& call) {
    auto id = call.arguments.bytes(Attribute::tag_id);
    if (id.empty() || id.size() > event::TagId::max_size) return ResultCode::invalid_parameter;
    auto target = choose_nearest(call, Technology::epc_gen1);
    if (target.result != ResultCode::success) return target.result;
    return program(call, target, event::TagId(id), call.arguments.number(Attribute::epc_password),
                   call.arguments.number(Attribute::boolean) != 0);
}

static ResultCode gen1_kill(Call& call) {
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    return finish_kill(on_each_point(call, target.source, target.tag, [&](const AirAccess& access) {
        return call.memory.air.kill(access, call.arguments.number(Attribute::epc_password));
    }));
}

static ResultCode e119_program(Call& call) {
    auto id = call.arguments.bytes(Attribute::tag_value);
    if (id.empty() || id.size() > event::TagId::max_size) return ResultCode::invalid_parameter;
    auto target = choose_tag(call);
    if (target.result != ResultCode::success) return target.result;
    return program(call, target, event::TagId(id), 0, false);
}

// --- the table ---------------------------------------------------------------------------------------------

static constexpr std::array tag_rows = {
    HandlerRow{Command::g2_read, g2_read},
    HandlerRow{Command::g2_write, g2_write},
    HandlerRow{Command::g2_lock, g2_lock},
    HandlerRow{Command::g2_kill, g2_kill},
    HandlerRow{Command::g2_program_id, g2_program},
    HandlerRow{Command::g2_query, g2_query},
    HandlerRow{Command::g2_query_ack, g2_query_ack},
    HandlerRow{Command::g2_custom, g2_custom},
    HandlerRow{Command::read_tag_data, read_data},
    HandlerRow{Command::write_tag_data, write_data},
    HandlerRow{Command::block_write_tag, write_data},
    HandlerRow{Command::lock_tag, lock_data},
    HandlerRow{Command::group_select_unselect, group_select},
    HandlerRow{Command::program_id, gen1_program},
    HandlerRow{Command::kill_tag, gen1_kill},
    HandlerRow{Command::e119_program_id, e119_program},
};

std::span<const HandlerRow> tag_handlers() {
    return tag_rows;
}

}  // namespace gantry::caen
