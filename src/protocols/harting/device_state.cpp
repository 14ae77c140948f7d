#include "protocols/harting/device_state.hpp"

#include <algorithm>

namespace gantry::harting {

// In the range for administration by whoever owns the machine: no real reader has it.
static std::array<std::uint8_t, 6> mac_of(std::uint64_t seed) {
    std::array<std::uint8_t, 6> mac{0x02, 0x48, 0x41};
    for (std::size_t i = 0; i < 3; ++i)
        mac[5 - i] = static_cast<std::uint8_t>(seed >> (8 * i));
    return mac;
}

ReaderState::ReaderState(const DeviceOptions& options, Air& the_air)
    : air(the_air),
      seed(options.seed),
      sw_type(static_cast<std::uint8_t>(options.settings.number("sw_type"))),
      rx_buf(static_cast<std::size_t>(options.settings.number("rx_buf"))),
      tx_buf(static_cast<std::size_t>(options.settings.number("tx_buf"))),
      round(options.settings.duration("round")),
      mac(mac_of(options.seed)),
      buffer(static_cast<std::size_t>(options.settings.number("buffer"))),
      true_time_(options.settings.text("clock") == "set") {}

void ReaderState::power_on(Now now) {
    clock.start(now, true_time_);
    restart(now);
}

void ReaderState::restart(Now now) {
    config.start();
    changed();
    logged_in = rf_off_ = stays_host_ = false;
    rf_antenna_.reset();
    outputs.restart();
    trigger.restart(setup, input(0), now.steady);
    buffer.power_down();
}

// --- the radio ---------------------------------------------------------------------------------------------

void ReaderState::rf_output(std::uint8_t antenna, bool stays_host) {
    rf_off_ = antenna == 0;
    rf_antenna_.reset();
    if (!rf_off_) rf_antenna_ = antenna;
    stays_host_ = stays_host;
}

std::vector<std::uint16_t> ReaderState::antennas() const {
    if (rf_off_) return {};
    if (rf_antenna_) return {*rf_antenna_};
    return setup.antennas;
}

bool ReaderState::is_broken(std::uint16_t antenna) const {
    if (auto forced = broken_[antenna - 1u]) return *forced;
    auto connected = air.antennas();
    return std::ranges::find(connected, antenna) == connected.end();
}

bool ReaderState::rf_warning() const {
    return std::ranges::any_of(antennas(), [this](auto antenna) { return is_broken(antenna); });
}

std::uint8_t ReaderState::antenna_flags() const {
    unsigned flags = 0;
    for (auto antenna : setup.antennas)
        if (is_broken(antenna)) flags |= 1u << (antenna - 1);
    return static_cast<std::uint8_t>(flags);
}

Carrier ReaderState::carrier(std::uint16_t antenna) const {
    return {.antenna = antenna, .power_dbm = setup.power_dbm[antenna - 1u]};
}

static std::uint8_t rssi_byte(std::int16_t tenths) {  // -dBm
    return static_cast<std::uint8_t>(std::clamp((-tenths + 5) / 10, 0, 255));
}

void ReaderState::listen(std::uint16_t antenna, Steady from, Steady to, std::vector<AirSighting>& out) const {
    if (is_broken(antenna) || !setup.reads_gen2) return;
    auto before = static_cast<std::ptrdiff_t>(out.size());
    auto carried = carrier(antenna);
    air.inventory(carried, from, to, out);
    auto limit = setup.rssi_filter[antenna - 1u];
    auto ignored = [&](const AirSighting& sighting) {
        if (sighting.technology != event::Technology::epc_gen2) return true;
        if (limit != 0 && rssi_byte(sighting.rssi) > limit) return true;
        return !setup.masks.empty() &&
               !is_selected(setup.masks, air, {carried, sighting.tag, 0, sighting.at});
    };
    out.erase(std::remove_if(out.begin() + before, out.end(), ignored), out.end());
}

std::optional<TagRecord> ReaderState::identify(const AirSighting& sighting, std::uint16_t antenna) const {
    static constexpr std::uint32_t pc_word = 1, xpc_word = 0x21;
    static constexpr std::uint8_t xpc_follows = 0x02, epc_and_tid = 0x02;
    AirAccess access{carrier(antenna), sighting.tag, 0, sighting.at};
    TagRecord record;
    record.transponder_type = type_epc_gen2;
    std::optional<std::uint16_t> xpc;
    auto pc = air.read(access, Bank::epc, pc_word, 1);
    if (pc && ((*pc)[0] & xpc_follows) != 0)
        if (auto word = air.read(access, Bank::epc, xpc_word, 1))
            xpc = static_cast<std::uint16_t>((*word)[0] << 8 | (*word)[1]);
    Bytes tid;
    if (setup.with_tid) {
        record.iddt = epc_and_tid;
        auto read = air.read(access, Bank::tid, 0, 0);
        if (!read) return {};
        tid = std::move(*read);
        if (setup.tid_size != 0) tid.resize(std::min(tid.size(), setup.tid_size));
    }
    record.idd = gen2_idd(sighting.tag.view(), xpc, tid);
    record.antennas = {antenna_of(sighting, antenna)};
    record.time = clock.time_at(sighting.at);
    return record;
}

// An air that knows no phase: a number of the path, tag, antenna and strength, that holds still while they
// do. 4096 is a full turn.
static std::uint16_t phase_of(const AirSighting& sighting, std::uint16_t antenna) {
    std::uint32_t mixed = antenna * 131u + static_cast<std::uint16_t>(sighting.rssi);
    for (auto byte : sighting.tag.view())
        mixed = mixed * 31 + byte;
    return mixed >> 8 & 0x0FFF;
}

TagRecord::Antenna ReaderState::antenna_of(const AirSighting& sighting, std::uint16_t antenna) const {
    return {.number = static_cast<std::uint8_t>(antenna),
            .rssi = rssi_byte(sighting.rssi),
            .phase = phase_of(sighting, antenna)};
}

// --- selection masks ---------------------------------------------------------------------------------------

static bool fits_mask(const SelectionMask& mask, Air& air, const AirAccess& access) {
    auto first_word = static_cast<std::uint32_t>(mask.first_bit / 16);
    auto end_word = static_cast<std::uint32_t>((mask.first_bit + mask.bits + 15) / 16);
    auto memory = air.read(access, mask.bank, first_word, end_word - first_word);
    if (!memory) return false;
    auto bit = [](const Bytes& bytes, std::size_t at) { return bytes[at / 8] >> (7 - at % 8) & 1; };
    for (std::size_t i = 0; i < mask.bits; ++i)
        if (bit(*memory, mask.first_bit % 16 + i) != bit(mask.mask, i)) return false;
    return true;
}

// How masks combine (AND, OR) stands in bits that are not public: here a tag answers that fits one of those
// not negated, if there is one, and none of those negated.
bool is_selected(const std::vector<SelectionMask>& masks, Air& air, const AirAccess& access) {
    bool wanted = false, fits = false;
    for (auto& mask : masks) {
        bool here = fits_mask(mask, air, access);
        if (mask.negated && here) return false;
        if (mask.negated) continue;
        wanted = true;
        fits = fits || here;
    }
    return fits || !wanted;
}

// --- inputs ------------------------------------------------------------------------------------------------

bool ReaderState::input(std::size_t index) const {
    return levels[index] != (index == 0 && setup.input_1_inverted);
}

std::uint8_t ReaderState::inputs() const {
    unsigned bits = 0;
    for (std::size_t i = 0; i < input_count; ++i)
        if (input(i)) bits |= 1u << i;
    return static_cast<std::uint8_t>(bits);
}

}  // namespace gantry::harting
