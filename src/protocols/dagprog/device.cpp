#include "protocols/dagprog/device.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace gantry::dagprog {

static constexpr auto scan_time = 50ms;         // how often it looks into the field
static constexpr auto look_back = 450ms;        // in which every tag that is there is heard
static constexpr auto collision_pause = 200ms;  // between two messages about disturbed tags
static constexpr std::uint16_t antenna = 1;
static constexpr std::size_t most_asleep = 10'000;

static std::optional<bool> insisted_stx(const Settings& settings) {
    if (settings.text("stx") == "any") return {};
    return settings.text("stx") == "yes";
}

DagprogDevice::DagprogDevice(const DeviceOptions& options, Air& air)
    : air_(air),
      family_(options.settings.text("family") == "icode1" ? Family::icode1 : Family::iso15693),
      wants_stx_(insisted_stx(options.settings)),
      wants_separator_(parse_separator(options.settings.text("separator"))),
      reversed_(options.settings.text("byte_order") == "lsb"),
      crc8_(*find_crc8(options.settings.text("crc8"))),
      banner_stx_(options.settings.boolean("banner_stx")),
      version_(options.settings.text("version")),
      boot_time_(options.settings.duration("boot")),
      name_(options.name),
      faults_(options.seed) {}

// --- the link ----------------------------------------------------------------------------------------------

void DagprogDevice::power_on(Now now) {
    clock_ = now.steady;
    boots_at_ = now.steady + boot_time_;
    booting_ = true;
}

void DagprogDevice::start(Now now) {
    clock_ = now.steady;
    connected_ = true;
    faults_.link_up();
    ++total_.connects;
    if (std::exchange(reboot_waits_, false)) reboots_at_ = now.steady + reboot_after;
    framer_ = Framer(wire::Direction::to_reader);
}

void DagprogDevice::link_lost(Now now) {
    clock_ = now.steady;
    connected_ = false;
    faults_.link_lost();
    drop_output();
}

void DagprogDevice::received(ByteView bytes, Now now) {
    clock_ = now.steady;
    if (!connected_ || faults_.deaf() || booting_) return;
    scan(now);  // what was there before the command
    framer_.give(bytes);
    while (auto line = framer_.next())
        command(*line, now);
    framer_.settle();
}

void DagprogDevice::reboot(Now now) {
    ++total_.restarts;
    booting_ = true;
    mode_ = Mode::stopped;
    faults_.forget();
    framer_ = Framer(wire::Direction::to_reader);
    reboots_at_.reset();
    boots_at_ = now.steady + boot_time_;
}

// It has lost what SV did not keep.
void DagprogDevice::boot(Now now) {
    booting_ = false;
    boots_at_.reset();
    now_ = saved_;
    transmit_ = family_ == Family::icode1 ? transmit_data : transmit_data | transmit_serial;
    save_next_ = false;
    field_on_ = true;
    count_ = 0;
    asleep_.clear();
    // ICODE1 units always start in UR, others as TL says (section 6).
    mode_ = now_.power_up == 2 || now_.power_up == 3 ? Mode::once : Mode::forever;
    scanned_to_ = now.steady;
    next_scan_ = now.steady + scan_time;
    auto announce = [&](Code code, const std::vector<std::string>& values) {
        for (auto& row : messages()) {
            if (row.code != code) continue;
            Bytes line;
            append_line(line, banner_stx_, row.word, values, Separator::tab);
            send(line);
        }
    };
    auto* kind = family_ == Family::icode1 ? "ICODE1" : "ISO15693";
    announce(Code::banner, {fmt::format("DAGProg {} {}", kind, version_)});
    announce(Code::ready, {});
}

// --- reading -----------------------------------------------------------------------------------------------

AirAccess DagprogDevice::access(const event::TagId& tag, Steady at) const {
    return {.carrier = {.antenna = antenna}, .tag = tag, .now = at};
}

bool DagprogDevice::is_there(const event::TagId& tag, Steady at) {
    auto words = air_.read(access(tag, at), Bank::user, 0, 1);
    return words || words.error() != AirError::no_tag;
}

std::vector<event::TagId> DagprogDevice::in_the_field(Steady at) {
    std::vector<event::TagId> tags;
    if (!field_on_ || antenna_broken_) return tags;
    std::vector<AirSighting> heard;
    air_.inventory({.antenna = antenna}, at - look_back, at, heard);
    for (auto& sighting : heard)
        if (sighting.technology == technology(family_) && sighting.tag.size == 8 &&
            std::ranges::find(tags, sighting.tag) == tags.end() && is_there(sighting.tag, at))
            tags.push_back(sighting.tag);
    return tags;
}

std::optional<Bytes> DagprogDevice::read_block(const event::TagId& tag, std::uint32_t block, Steady at) {
    static constexpr std::uint32_t words = block_size / 2;
    auto data = air_.read(access(tag, at), Bank::user, block * words, words);
    if (!data || data->size() != block_size) return {};
    return std::move(*data);
}

void DagprogDevice::scan(Now now) {
    if (scanned_to_ >= now.steady) return;
    auto from = std::exchange(scanned_to_, now.steady);
    if (!reading() || antenna_broken_) return;
    // A tag that has left the field has no power, and is awake when it comes back.
    std::erase_if(asleep_, [&](auto& tag) { return !is_there(tag, now.steady); });
    std::vector<AirSighting> heard;
    air_.inventory({.antenna = antenna}, from, now.steady, heard);
    for (auto& sighting : heard)
        hear(sighting);
}

void DagprogDevice::hear(const AirSighting& sighting) {
    if (sighting.technology != technology(family_) || sighting.tag.size != 8) return;
    if (mode_ == Mode::once) {
        if (std::ranges::find(asleep_, sighting.tag) != asleep_.end() || asleep_.size() >= most_asleep)
            return;
        asleep_.push_back(sighting.tag);
        return detect(sighting.tag, sighting.at);
    }
    // Two tags disturb each other (section 6).
    auto others = in_the_field(sighting.at);
    if (std::ranges::none_of(others, [&](auto& tag) { return !(tag == sighting.tag); }))
        return detect(sighting.tag, sighting.at);
    ++total_.collisions;
    if (family_ == Family::icode1 || sighting.at < told_collision_ + collision_pause) return;
    told_collision_ = sighting.at;
    say_number(Code::error, 2);
}

void DagprogDevice::detect(const event::TagId& tag, Steady at) {
    ++total_.detections;
    auto count = count_++;
    std::vector<Bytes> blocks;
    for (std::uint32_t i = 0; i <= now_.block_count; ++i) {
        auto data = read_block(tag, now_.first_block + i, at);
        if (!data) return say_number(Code::error, 2);
        if (std::exchange(spoil_crc_, false)) data->back() ^= 0x5A;
        if (mode_ == Mode::checked && !crc8_fits(crc8_, *data)) return say_number(Code::error, 1);
        blocks.push_back(std::move(*data));
    }
    if ((transmit_ & transmit_serial) != 0) {
        Serial serial{};
        std::ranges::copy(tag.view(), serial.begin());
        say_serial(serial);
    }
    if ((transmit_ & transmit_data) == 0) return;
    for (auto& data : blocks)
        say(Code::block_data, {fmt::format("{:02X}", count), to_hex(data)});
}

// --- saying ------------------------------------------------------------------------------------------------

void DagprogDevice::say(const MessageRow& row, std::span<const std::string> values) {
    Bytes line;
    append_line(line, true, row.word, values, Separator::tab);
    send(line);
}

void DagprogDevice::say(Code code, std::initializer_list<std::string> values) {
    for (auto& row : messages())
        if (row.code == code && row.direction == wire::Direction::to_host)
            return say(row, std::vector<std::string>(values));
}

void DagprogDevice::say_number(Code code, std::uint32_t value) {
    for (auto& row : messages())
        if (row.code == code && row.direction == wire::Direction::to_host)
            return say(row, std::vector{written(row.parts[0], value)});
}

void DagprogDevice::say_serial(const Serial& serial) {
    auto bytes = serial;
    if (reversed_) std::ranges::reverse(bytes);
    say(Code::serial_number, {to_hex(bytes)});
}

void DagprogDevice::say_result(std::uint8_t result) {
    say(Code::serial_number, {fmt::format("{:016}", result)});
}

void DagprogDevice::send(ByteView line) {
    if (connected_ && !silent_) faults_.say(line, {clock_, {}}, out());
}

// --- time --------------------------------------------------------------------------------------------------

std::optional<Steady> DagprogDevice::deadline() const {
    std::optional<Steady> due = boots_at_;
    auto sooner = [&](Steady at) { due = due ? std::min(*due, at) : at; };
    if (reading()) sooner(next_scan_);
    if (reboots_at_) sooner(*reboots_at_);
    if (auto late = faults_.deadline()) sooner(*late);
    return due;
}

void DagprogDevice::time_passed(Now now) {
    clock_ = now.steady;
    if (reboots_at_ && now.steady >= *reboots_at_) reboot(now);
    if (boots_at_ && now.steady >= *boots_at_) boot(now);
    faults_.time_passed(now, out());
    if (reading() && now.steady >= next_scan_) {
        scan(now);
        next_scan_ = now.steady + scan_time;
    }
}

static std::string mode_text(std::uint8_t mode) {
    static constexpr std::array<std::string_view, 4> names = {"stopped", "UR", "RC", "SR"};
    return std::string(names[mode]);
}

wire::Fields DagprogDevice::state() const {
    wire::Fields fields;
    auto add = [&](std::string_view name, wire::Value value) {
        fields.push_back({std::string(name), std::move(value)});
    };
    add("name", wire::Value(name_));
    add("family", wire::Value(std::string(to_text(family_))));
    add("connected", wire::Value(connected_));
    add("mode",
        wire::Value(booting_ ? std::string("starting") : mode_text(static_cast<std::uint8_t>(mode_))));
    add("field", wire::Value(field_on_));
    add("first_block", wire::Value(now_.first_block));
    add("block_count", wire::Value(now_.block_count));
    add("transmit", wire::Value(transmit_));
    add("power_up", wire::Value(now_.power_up));
    add("saved_first_block", wire::Value(saved_.first_block));
    add("saved_block_count", wire::Value(saved_.block_count));
    add("saved_power_up", wire::Value(saved_.power_up));
    add("save_next", wire::Value(save_next_));
    add("asleep", wire::Value(asleep_.size()));
    add("commands", wire::Value(total_.commands));
    add("refused", wire::Value(total_.refused));
    add("tags_sent", wire::Value(total_.detections));
    add("detections", wire::Value(total_.detections));
    add("collisions", wire::Value(total_.collisions));
    add("writes", wire::Value(total_.writes));
    add("restarts", wire::Value(total_.restarts));
    add("connects", wire::Value(total_.connects));
    return fields;
}

}  // namespace gantry::dagprog
