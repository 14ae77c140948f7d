#include "protocols/harting/device_inventory.hpp"

#include <algorithm>
#include <array>
#include <unordered_map>

#include "protocols/harting/device_call.hpp"
#include "protocols/harting/frame.hpp"

namespace gantry::harting {

Status HostInventory::finish(ReaderState& reader, Steady now, Bytes& data) {
    auto look_back = std::max<Steady::duration>(takes(reader), still_there);
    std::unordered_map<event::TagId, std::size_t, event::TagIdHash> known;
    std::vector<AirSighting> heard;
    warned_ = false;
    for (auto antenna : order_.antennas) {
        warned_ = warned_ || reader.is_broken(antenna);
        heard.clear();
        reader.listen(antenna, now - look_back, now, heard);
        for (auto& sighting : heard) {
            auto [place, fresh] = known.try_emplace(sighting.tag, left_.size());
            if (fresh) {
                auto record = reader.identify(sighting, antenna);
                if (record)
                    left_.push_back(std::move(*record));
                else
                    known.erase(place);
                continue;
            }
            auto& antennas = left_[place->second].antennas;
            auto same = std::ranges::find(antennas, antenna, &TagRecord::Antenna::number);
            if (same == antennas.end())
                antennas.push_back(reader.antenna_of(sighting, antenna));
            else
                *same = reader.antenna_of(sighting, antenna);
        }
    }
    return give(reader, data);
}

Status HostInventory::more(ReaderState& reader, Bytes& data) {
    return left_.empty() ? Status::no_valid_data : give(reader, data);
}

// As many tags as fit into TX-BUF, and as DATA-SETS can count.
Status HostInventory::give(ReaderState& reader, Bytes& data) {
    if (left_.empty()) return warned_ ? Status::rf_warning : Status::no_transponder;
    static constexpr std::uint8_t most = 0xFF;
    auto room = reader.tx_buf - min_reply;
    data.push_back(0);
    while (!left_.empty() && data[0] < most) {
        auto before = data.size();
        append_inventory_tag(left_.front(), order_.tells_antennas, data);
        if (data.size() > room && data[0] > 0) {
            data.resize(before);
            break;
        }
        ++data[0];
        left_.pop_front();
    }
    reader.tags_sent += data[0];
    if (!left_.empty()) return Status::more_data;
    return warned_ ? Status::rf_warning : Status::ok;
}

std::vector<Present> present_tags(const ReaderState& reader, Steady now) {
    std::vector<Present> tags;
    std::vector<AirSighting> heard;
    for (auto antenna : reader.antennas()) {
        if (reader.is_broken(antenna)) continue;
        heard.clear();
        reader.air.inventory(reader.carrier(antenna), now - still_there, now, heard);
        for (auto& sighting : heard) {
            auto same = [&](auto& tag) { return tag.sighting.tag == sighting.tag; };
            auto known = std::ranges::find_if(tags, same);
            if (known == tags.end())
                tags.push_back({antenna, sighting});
            else if (sighting.rssi > known->sighting.rssi)
                *known = {antenna, sighting};
        }
    }
    std::ranges::stable_sort(tags, std::greater{}, [](auto& tag) { return tag.sighting.rssi; });
    return tags;
}

// --- the command -------------------------------------------------------------------------------------------

static Status inventory(Call& call) {
    auto size = call.data.size();
    if (size < 2) return Status::length_error;
    auto mode = call.data[1];
    bool selects = (mode & inventory_antennas) != 0;
    if ((mode & ~unsigned{inventory_more | inventory_antennas}) != 0) return Status::parameter_range;
    if (size != (selects ? 3u : 2u)) return Status::length_error;
    if ((mode & inventory_more) != 0) return call.inventory.more(call.reader, call.answer);
    HostInventory::Order order{call.reader.antennas(), selects};
    if (selects) {
        auto chosen = call.data[2];
        if (chosen == 0 || chosen >> antenna_count != 0) return Status::parameter_range;
        bool off = order.antennas.empty();
        order.antennas.clear();
        for (std::uint16_t i = 0; i < antenna_count && !off; ++i)
            if ((chosen >> i & 1) != 0) order.antennas.push_back(static_cast<std::uint16_t>(i + 1));
    }
    call.inventory.begin(std::move(order));
    call.takes_time = true;
    return Status::ok;
}

static constexpr std::array handlers = {HandlerRow{Command::inventory, inventory}};
std::span<const HandlerRow> inventory_handlers() {
    return handlers;
}

}  // namespace gantry::harting
