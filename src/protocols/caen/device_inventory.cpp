#include "protocols/caen/device_inventory.hpp"

#include <algorithm>

#include "protocols/caen/device_call.hpp"

namespace gantry::caen {

using event::Technology;

static constexpr std::uint16_t known_flags = flag_rssi | flag_framed | flag_continuous | flag_compact |
                                             flag_tid | flag_event_trigger | flag_xpc | flag_match | flag_pc;
static constexpr std::size_t max_reads = 5000;  // kept for one answer and read point
// A message could be twice as long, but a known client library counts its bytes in 16 bits with a sign.
static constexpr std::size_t max_answer = 32'000;

Inventory::Wanted Inventory::order_of(const Parsed& request, Command command, const Arguments& arguments,
                                      const ReaderMemory& memory) {
    auto [result, source] = choose_source(arguments, memory);
    if (result != ResultCode::success) return {result};
    Order order{.id = request.header.id, .command = command, .source = source};
    if (command == Command::inventory_tag) {
        auto flags = arguments.number(Attribute::bitmask);
        if ((flags & ~std::uint32_t{known_flags}) != 0) return {ResultCode::bad_parameter_value};
        order.flags = static_cast<std::uint16_t>(flags);
        // Framed and continuous go together, and the event trigger needs them (section 7).
        bool framed = (flags & flag_framed) != 0, continuous = (flags & flag_continuous) != 0;
        if (framed != continuous || (!framed && (flags & flag_event_trigger) != 0))
            return {ResultCode::invalid_parameter};
        auto mask = arguments.bytes(Attribute::tag_id);
        order.mask.bits = arguments.number(Attribute::length);
        order.mask.first_bit = arguments.number(Attribute::tag_address);
        order.mask.bytes.assign(mask.begin(), mask.end());
        if (order.mask.bits > mask.size() * 8) return {ResultCode::invalid_parameter};
        if (arguments.has(Attribute::memory_bank))
            order.mask.bank = static_cast<Bank>(arguments.number(Attribute::memory_bank));
    }
    if (memory.points_of(source).empty()) return {ResultCode::source_disabled};
    return {.order = order};
}

Inventory::Inventory(const Order& order, const ReaderMemory& memory, Now now, Bytes& out)
    : order_(order), memory_(memory) {
    for (auto number : memory.points_of(order.source))
        points_.push_back({.number = number});
    auto cycles = memory.ram.sources[order.source][Config::read_cycle];
    endless_ = framed() && cycles == 0;  // elsewhere 0 has no meaning
    cycles_left_ = std::max(cycles, 1u);
    waits_ = (order.flags & flag_event_trigger) != 0;
    begin_slot(now.steady);
    if (!framed()) return;
    Builder head(out, to_host_head, order.id);
    head.command(order.command);
    if (memory.stream_starts_with_result) head.result(ResultCode::success);
    head.finish_undefined();
}

void Inventory::begin_slot(Steady at) {
    slot_start_ = at;
    slot_end_ = at + memory_.slot(memory_.ram.sources[order_.source]);
}

void Inventory::trigger(Now now) {
    if (!std::exchange(waits_, false)) return;
    begin_slot(now.steady);
}

void Inventory::abort(Bytes& out) {
    over_ = true;
    if (memory_.stream_ends_with_result)
        append_number(out, Attribute::result_code, static_cast<std::uint16_t>(ResultCode::success));
}

// --- time --------------------------------------------------------------------------------------------------

void Inventory::time_passed(Now now, bool room, Bytes& out) {
    while (!over_ && !waits_ && now.steady >= slot_end_) {
        auto& point = points_[current_];
        listen(point);
        if (framed()) stream(point, room, out);
        next_slot(now, out);
    }
}

void Inventory::next_slot(Now now, Bytes& out) {
    // A host process that slept does not have to make up for every round.
    auto at = now.steady - slot_end_ > 1s ? now.steady : slot_end_;
    if (++current_ == points_.size()) {
        current_ = 0;
        at += std::chrono::milliseconds{memory_.ram.sources[order_.source][Config::quiet_time]};
        if (!endless_ && --cycles_left_ == 0) {
            answer(out);
            return;
        }
    }
    begin_slot(at);
}

// What is heard: in the first round all tags that are there, then what was heard since this read point's
// last.
void Inventory::listen(Point& point) {
    auto stay = std::max<Steady::duration>(slot_end_ - slot_start_, still_there);
    auto from = std::max(point.heard_to.value_or(slot_end_ - stay), slot_end_ - stay);
    std::vector<AirSighting> heard;
    memory_.listen(point.number, order_.source, slot_end_ - slot_start_, from, slot_end_, heard);
    point.heard_to = slot_end_;
    for (auto& sighting : heard) {
        AirAccess access{memory_.carrier(point.number), sighting.tag, 0, slot_end_};
        auto known = point.index.find(sighting.tag);
        if (known == point.index.end()) {
            if (point.reads.size() >= max_reads ||
                !order_.mask.matches(memory_.air, access, sighting.technology))
                continue;
            known = point.index.try_emplace(sighting.tag, point.reads.size()).first;
            point.reads.push_back({sighting.tag, sighting.technology, sighting.rssi, {}, {}});
        }
        auto& read = point.reads[known->second];
        read.rssi = sighting.rssi;
        read.at = std::max(sighting.at, slot_start_);
        read.phase = sighting.phase;
    }
}

// --- answers -----------------------------------------------------------------------------------------------

void Inventory::stream(Point& point, bool room, Bytes& out) {
    for (auto& read : point.reads) {
        if (room)
            append_tag(point.number, read, out);
        else
            ++lost_;
    }
    if (room) tags_ += point.reads.size();
    point.reads.clear();
    point.index.clear();
}

void Inventory::answer(Bytes& out) {
    over_ = true;
    if (framed()) {
        abort(out);
        return;
    }
    auto start = out.size();
    Builder message(out, to_host_head, order_.id);
    message.command(order_.command);
    for (auto& point : points_) {
        if (order_.command == Command::raw_read_ids) {
            if (out.size() - start < max_answer) append_group(point, out);
            tags_ += point.reads.size();
            continue;
        }
        for (auto& read : point.reads) {
            if (out.size() - start >= max_answer) break;
            append_tag(point.number, read, out);
            ++tags_;
        }
    }
    message.result(ResultCode::success);
    if (message.finish()) return;
    // The last group was too much: none of it, rather than a message that cannot be told.
    Builder refused(out, to_host_head, order_.id);
    refused.command(order_.command).result(ResultCode::unknown_error);
    if (!refused.finish()) out.resize(start);
}

static std::uint16_t shortened(std::size_t size) {
    return static_cast<std::uint16_t>(size);
}

// RawReadIDs: one group a read point, one length for all of its ids (section 11); ids of another length make
// another group.
void Inventory::append_group(const Point& point, Bytes& out) const {
    std::vector<const Read*> left;
    for (auto& read : point.reads)
        left.push_back(&read);
    auto start = out.size();
    while (!left.empty()) {
        auto size = left.front()->tag.size;
        auto others = std::stable_partition(left.begin(), left.end(),
                                            [&](const Read* read) { return read->tag.size == size; });
        auto latest =
            (*std::max_element(left.begin(), others, [](auto* a, auto* b) { return a->at < b->at; }))->at;
        append_text(out, Attribute::source_name, source_name(order_.source));
        append_text(out, Attribute::read_point_name, read_point_name(point.number));
        append_time(out, Attribute::time_stamp, memory_.time_at(latest));
        append_number(out, Attribute::tag_id_len, size);
        for (auto it = left.begin(); it != others && out.size() - start < max_answer / 4; ++it)
            append_bytes(out, Attribute::tag_id, (*it)->tag.view());
        left.erase(left.begin(), others);
    }
}

// The order of section 7.
void Inventory::append_tag(unsigned point, const Read& read, Bytes& out) const {
    auto has = [this](InventoryFlag flag) { return (order_.flags & flag) != 0; };
    AirAccess access{memory_.carrier(point), read.tag, 0, read.at};
    bool gen2 = read.technology == Technology::epc_gen2;
    if (!has(flag_compact)) {
        append_text(out, Attribute::source_name, source_name(order_.source));
        append_text(out, Attribute::read_point_name, read_point_name(point));
        append_time(out, Attribute::time_stamp, memory_.time_at(read.at));
        append_number(out, Attribute::tag_type, static_cast<std::uint64_t>(tag_type_of(read.technology)));
        append_number(out, Attribute::tag_id_len, read.tag.size);
    }
    append_bytes(out, Attribute::tag_id, read.tag.view());
    if (has(flag_rssi)) append_number(out, Attribute::rssi, static_cast<std::uint16_t>(read.rssi));
    // One client of the Lepton modules asks so for the phase, and reads it here (section 7).
    if (has(flag_match) && memory_.model.phase) append_number(out, Attribute::phase, phase_of(point, read));
    if (has(flag_tid)) {
        auto tid = gen2 ? tid_of(access) : Bytes{};
        append_number(out, Attribute::length, shortened(tid.size()));
        if (!tid.empty()) append_bytes(out, Attribute::tag_value, tid);
    }
    static constexpr std::uint32_t pc_word = 1, xpc_word = 0x21, xpc_follows = 0x0200;
    auto pc = gen2 ? epc_word(access, pc_word) : 0;
    if (has(flag_xpc)) {  // zeros where the tag sends none
        auto xpc = (pc & xpc_follows) != 0 ? epc_word(access, xpc_word) : 0;
        append_bytes(out, Attribute::xpc,
                     Bytes{static_cast<std::uint8_t>(xpc >> 8), static_cast<std::uint8_t>(xpc & 0xFF), 0, 0});
    }
    if (has(flag_pc)) {
        Bytes value(memory_.pc_size);
        value[value.size() - 2] = static_cast<std::uint8_t>(pc >> 8);
        value[value.size() - 1] = static_cast<std::uint8_t>(pc & 0xFF);
        append_bytes(out, Attribute::pc, value);
    }
}

// Where the field knows none: a number of the path, tag, read point and strength, that holds still while they
// do. 4096 is the full circle.
std::uint16_t Inventory::phase_of(unsigned point, const Read& read) {
    if (read.phase) return *read.phase;
    std::uint32_t mixed = point * 131 + static_cast<std::uint16_t>(read.rssi);
    for (auto byte : read.tag.view())
        mixed = mixed * 31 + byte;
    return mixed >> 8 & 0x0FFF;
}

// As many bytes as the source is set to read, or as the tag has.
Bytes Inventory::tid_of(const AirAccess& access) const {
    auto size = memory_.ram.sources[order_.source][Config::tid_length];
    if (size == 0) return {};
    auto tid = memory_.air.read(access, Bank::tid, 0, (size + 1) / 2);
    if (!tid) tid = memory_.air.read(access, Bank::tid, 0, 0);
    if (!tid) return {};
    if (tid->size() > size) tid->resize(size);
    return std::move(*tid);
}

std::uint32_t Inventory::epc_word(const AirAccess& access, std::uint32_t word) const {
    auto data = memory_.air.read(access, Bank::epc, word, 1);
    return data && data->size() == 2 ? std::uint32_t{(*data)[0]} << 8 | (*data)[1] : 0;
}

}  // namespace gantry::caen
