#include "protocols/caen/device_state.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

namespace gantry::caen {

static constexpr std::uint32_t usual_q = 3;
static constexpr double poor_loss_db = 10;  // of an antenna with a low quality connection

bool is_dotted_decimal(std::string_view text) {
    unsigned parts = 0;
    for (;;) {
        unsigned value = 0;
        auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (error != std::errc{} || value > 255 || end - text.data() > 3) return false;
        text.remove_prefix(static_cast<std::size_t>(end - text.data()));
        ++parts;
        if (text.empty()) return parts == 4;
        if (text[0] != '.' || parts == 4) return false;
        text.remove_prefix(1);
    }
}

// A plugin gives only names of models() to choose from; one from elsewhere must not end in nothing.
static const ModelRow& model_of(const DeviceOptions& options) {
    const auto* model = find_model(options.settings.text("model"));
    return model != nullptr ? *model : *find_model("all");
}

static bool by_setting(std::string_view choice, std::string_view yes, bool automatic) {
    return choice == "auto" ? automatic : choice == yes;
}

static std::string text_or(std::string_view text, std::string otherwise) {
    return text.empty() ? std::move(otherwise) : std::string(text);
}

ReaderMemory::ReaderMemory(const DeviceOptions& options, Air& the_air)
    : model(model_of(options)),
      serial(text_or(options.settings.text("serial"), fmt::format("{:07}", options.seed % 10'000'000))),
      firmware(text_or(options.settings.text("firmware"), std::string(model.firmware)).substr(0, 199)),
      round(options.settings.duration("round")),
      stream_starts_with_result(options.settings.text("stream_start") == "result"),
      stream_ends_with_result(options.settings.text("stream_end") == "result"),
      // Revisions 4 to 12 say 0 bad, 1 poor, 2 good; revision 19 the other way round (section 4, 0x56).
      good_is_zero(by_setting(options.settings.text("status_order"), "good_first", model.revision >= 19)),
      // The old manuals answer 0 when the two are associated (section 12, I5).
      associated_is_one(
          by_setting(options.settings.text("check_polarity"), "true_is_1", model.revision >= 19)),
      any_order(options.settings.text("attribute_order") == "any"),
      // Revision 19 prints 4 bytes, the maker's own library takes 2 only (section 4, 0x7D).
      pc_size(options.settings.text("pc_size") == "4" ? 4 : 2),
      air(the_air),
      clock_(options.settings.text("clock")),
      forced_(model.read_points) {}

void ReaderMemory::restart(Now now) {
    ram = Ram{};
    ram.power = model.power_default_mw;
    // Separate lines: inputs are the low bits (section 4, 0x69).
    ram.directions = line_mask() & ~((1u << model.inputs) - 1);
    for (unsigned i = 0; i < model.sources; ++i) {
        SourceMemory source;
        if (i < model.read_points) source.read_points = 1u << i;  // tables 4.2 and 4.4
        source[Config::read_cycle] = 1;
        source[Config::observed_threshold] = 1;
        source[Config::lost_threshold] = 1;
        source[Config::starting_q] = usual_q;
        source[Config::max_q] = 15;
        source[Config::tid_length] = 12;
        ram.sources.push_back(source);
    }
    clock_set_ = clock_ != "zero";
    base_ = now.steady;
    base_us_ = clock_ == "set" ? to_us(now.wall) : 0;
}

std::int64_t ReaderMemory::time_at(Steady at) const {
    if (!clock_set_) return 0;
    auto passed = std::chrono::duration_cast<std::chrono::microseconds>(at - base_).count();
    return std::max<std::int64_t>(0, base_us_ + passed);
}

void ReaderMemory::set_time(Steady at, std::int64_t micros) {
    base_ = at;
    base_us_ = micros;
    clock_set_ = true;
}

static std::optional<unsigned> numbered(std::string_view name, std::string_view prefix, unsigned count) {
    if (!name.starts_with(prefix)) return {};
    auto digits = name.substr(prefix.size());
    for (unsigned i = 0; i < count; ++i)
        if (digits == fmt::format("{}", i)) return i;
    return {};
}

std::optional<std::size_t> ReaderMemory::source(std::string_view name) const {
    return numbered(name, "Source_", model.sources);
}

std::optional<unsigned> ReaderMemory::read_point(std::string_view name) const {
    return numbered(name, "Ant", model.read_points);
}

std::vector<unsigned> ReaderMemory::points_of(std::size_t source) const {
    std::vector<unsigned> points;
    for (unsigned i = 0; i < model.read_points; ++i)
        if ((ram.sources[source].read_points >> i & 1u) != 0) points.push_back(i);
    return points;
}

std::chrono::microseconds ReaderMemory::slot(const SourceMemory& source) const {
    auto dwell = source[Config::dwell_time];
    return dwell != 0 ? std::chrono::milliseconds{dwell} : round;
}

Carrier ReaderMemory::carrier(unsigned read_point) const {
    double dbm = 10 * std::log10(std::max(1.0, static_cast<double>(ram.power)));
    if (antenna(read_point) == Antenna::poor) dbm -= poor_loss_db;
    return {.antenna = static_cast<std::uint16_t>(read_point + 1), .power_dbm = dbm};
}

ReaderMemory::Antenna ReaderMemory::antenna(unsigned read_point) const {
    if (forced_[read_point]) return *forced_[read_point];
    auto connected = air.antennas();
    bool there = std::ranges::find(connected, read_point + 1) != connected.end();
    return there ? Antenna::good : Antenna::bad;
}

void ReaderMemory::force_antenna(unsigned read_point, std::optional<Antenna> state) {
    forced_[read_point] = state;
}

static bool speaks(std::uint32_t protocol, event::Technology technology) {
    constexpr std::uint32_t multiprotocol = 4, unspecified = 255;  // section 4, 0x54
    auto type = tag_type_of(technology);
    if (type < 0) return false;  // HF tags
    return protocol == multiprotocol || protocol == unspecified || type == std::int64_t{protocol};
}

void ReaderMemory::listen(unsigned read_point, std::size_t source, Steady::duration sent, Steady from,
                          Steady to, std::vector<AirSighting>& out) const {
    if (antenna(read_point) == Antenna::bad) return;
    auto before = static_cast<std::ptrdiff_t>(out.size());
    auto sending = carrier(read_point);
    sending.dwell = std::chrono::ceil<std::chrono::microseconds>(sent);
    // Until a host changes them, the field says what suits its tags.
    const auto& config = ram.sources[source];
    if (config[Config::session] != 0) sending.session = static_cast<std::uint8_t>(config[Config::session]);
    if (config[Config::starting_q] != usual_q)
        sending.q = static_cast<std::uint8_t>(config[Config::starting_q]);
    air.inventory(sending, from, to, out);
    auto deaf = [this](const AirSighting& sighting) { return !speaks(ram.protocol, sighting.technology); };
    out.erase(std::remove_if(out.begin() + before, out.end(), deaf), out.end());
}

std::vector<ReaderMemory::Present> ReaderMemory::present(std::size_t source, event::Technology technology,
                                                         Steady now) const {
    std::vector<Present> tags;
    std::vector<AirSighting> heard;
    for (auto point : points_of(source)) {
        if (antenna(point) == Antenna::bad) continue;
        heard.clear();
        air.inventory(carrier(point), now - still_there, now, heard);
        for (auto& sighting : heard) {
            if (sighting.technology != technology) continue;
            auto same = [&](auto& tag) {
                return tag.read_point == point && tag.sighting.tag == sighting.tag;
            };
            auto known = std::ranges::find_if(tags, same);
            if (known == tags.end())
                tags.push_back({point, sighting});
            else if (sighting.rssi > known->sighting.rssi)
                known->sighting = sighting;
        }
    }
    std::ranges::stable_sort(tags, std::greater{}, [](auto& tag) { return tag.sighting.rssi; });
    return tags;
}

std::uint32_t ReaderMemory::io_register() const {
    return ((inputs & ~ram.directions) | (ram.outputs & ram.directions)) & line_mask();
}

}  // namespace gantry::caen
