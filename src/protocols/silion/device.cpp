#include "protocols/silion/device.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace gantry::silion {

static constexpr auto boot = 3s;        // from a restart to the first try to connect
static constexpr auto dwell = 100ms;    // on one antenna before the next
static constexpr auto forgotten = 30s;  // a tag that was away this long is first seen again
static constexpr std::size_t tag_bytes_1 = 340, tag_bytes_2 = 1500;  // data a frame, near what real ones send

static std::chrono::microseconds batch_of(const Settings& settings) {
    if (!settings.text("batch").empty()) return settings.duration("batch");
    return settings.text("generation") == "1" ? 500ms : 2s;
}

// The guide has CRCs on serial lines only. What gen 1 computes there is not known, only likely (section 4).
static std::optional<CrcKind> crc_of(const Settings& settings) {
    auto choice = settings.text("crc");
    if (choice == "auto") {
        if (!settings.boolean("serial")) return {};
        return settings.text("generation") == "1" ? CrcKind::modbus_swapped : CrcKind::modbus;
    }
    if (choice == "off" || choice == "false") return {};
    if (choice == "modbus-swapped") return CrcKind::modbus_swapped;
    if (choice == "ccitt") return CrcKind::ccitt;
    return CrcKind::modbus;
}

// A frame gets a CRC if it had none, and the CRC is wrong.
static void spoil_crc(Bytes& frame) {
    if ((frame[5] & flag_crc) == 0) {
        frame[5] |= flag_crc;
        auto crc = crc_bytes(CrcKind::modbus, frame);
        frame.insert(frame.end(), crc.begin(), crc.end());
    }
    frame.back() ^= 0x5A;
}

static std::string name_of(const DeviceOptions& options) {
    // Gen 2's own default: the MAC, in the vendor's range (section 10).
    return options.name.empty() ? fmt::format("0826ae1{:05x}", options.seed & 0xFFFFF)
                                : options.name.substr(0, 254);
}

SilionDevice::SilionDevice(const DeviceOptions& options, Air& air)
    : air_(air),
      generation_(options.settings.text("generation") == "1" ? 1 : 2),
      serial_(options.settings.boolean("serial")),
      acknowledge_(options.settings.boolean("ack")),
      first_seen_(generation_ == 2 && options.settings.boolean("first_seen")),
      crc_(crc_of(options.settings)),
      ack_wait_(options.settings.duration("ack_wait")),
      batch_(batch_of(options.settings)),
      heartbeat_(options.settings.duration("heartbeat")),
      redial_(options.settings.duration("redial")),
      antennas_(static_cast<std::uint16_t>(options.settings.number("antennas"))),
      bank_words_(generation_ == 2 ? static_cast<std::uint32_t>(options.settings.number("bank_words")) : 0),
      name_(name_of(options)),
      random_(options.seed * 2 + 1),
      buffer_(static_cast<std::size_t>(options.settings.number("buffer"))),
      framer_(wire::Direction::to_reader, crc_rule()),
      faults_(options.seed, &spoil_crc) {}

// Gen 1 does not look at the CRC of what it gets (section 4).
CrcRule SilionDevice::crc_rule() const {
    return generation_ == 1 ? CrcRule::unchecked() : CrcRule::only(crc_kind());
}

std::uint64_t SilionDevice::random() {
    random_ ^= random_ << 13;
    random_ ^= random_ >> 7;
    random_ ^= random_ << 17;
    return random_;
}

// --- the link ----------------------------------------------------------------------------------------------

void SilionDevice::power_on(Now now) {
    dial_at_ = now.steady;
    scanned_to_ = now.steady;
    batch_at_ = now.steady + batch_;
    next_scan_ = first_seen_ ? now.steady + dwell : batch_at_;
}

std::optional<Steady> SilionDevice::dial_at() const {
    return connected_ ? std::nullopt : dial_at_;
}

void SilionDevice::dial_failed(Now now) {
    dial_at_ = std::max(now.steady + redial_, booted_at_.value_or(now.steady));
}

void SilionDevice::start(Now now) {
    connected_ = true;
    hang_up_ = greeted_ = false;
    faults_.link_up();
    ++total_.connects;
    if (std::exchange(reboot_waits_, false)) restart_at_ = now.steady + reboot_after;
    framer_ = Framer(wire::Direction::to_reader, crc_rule());
    // Gen 1 lets a random while pass, so that not all readers of a site speak at once (section 2).
    hello_at_ = std::max(now.steady, booted_at_.value_or(now.steady)) +
                (gen2() ? 0us : std::chrono::milliseconds{100 + random() % 4901});
    time_passed(now);
}

void SilionDevice::link_lost(Now now) {
    connected_ = hang_up_ = false;
    faults_.link_lost();
    hello_at_.reset();
    heartbeat_at_.reset();
    pending_.reset();
    drop_output();
    dial_at_ = std::max(now.steady + redial_, booted_at_.value_or(now.steady));
}

void SilionDevice::say(ByteView frame, Now now) {
    faults_.say(frame, now, out());
}

void SilionDevice::upload(Code code, std::uint8_t flags, std::uint32_t status, ByteView data, Now now) {
    Bytes frame;
    append_to_host(frame, static_cast<std::uint8_t>(code), flags | own_flags(), status, as_bytes(name_), data,
                   crc_kind());
    say(frame, now);
}

// --- reading and sending -----------------------------------------------------------------------------------

std::vector<std::uint16_t> SilionDevice::working_antennas() {
    auto antennas = air_.antennas();
    std::erase_if(antennas, [this](auto antenna) {
        return antenna < 1 || antenna > antennas_ || (broken_ >> antenna & 1) != 0;
    });
    return antennas;
}

void SilionDevice::inventory(Now now) {
    auto antennas = working_antennas();
    std::vector<AirSighting> heard;
    while (scanned_to_ < now.steady) {
        // The antennas take turns on a grid of time, so the result does not depend on when we are called.
        auto slot = scanned_to_.time_since_epoch() / dwell;
        auto to = std::min(now.steady, Steady{} + (slot + 1) * dwell);
        if (!antennas.empty()) {
            auto antenna = antennas[static_cast<std::size_t>(slot) % antennas.size()];
            heard.clear();
            air_.inventory({.antenna = antenna}, scanned_to_, to, heard);
            for (auto& sighting : heard)
                hear(antenna, sighting, now);
        }
        scanned_to_ = to;
    }
}

void SilionDevice::hear(std::uint16_t antenna, const AirSighting& sighting, Now now) {
    using event::Technology;
    if (sighting.technology != Technology::epc_gen2 && sighting.technology != Technology::iso18000_6b) return;
    auto number = static_cast<std::uint8_t>(antenna);
    if (buffer_.add(number, sighting) && bank_words_ > 0)
        if (auto bank = air_.read({.carrier = {.antenna = antenna}, .tag = sighting.tag, .now = sighting.at},
                                  Bank::user, 0, bank_words_))
            buffer_.set_bank(std::move(*bank));
    if (!first_seen_) return;
    auto [seen, fresh] = seen_.try_emplace(sighting.tag, sighting.at);
    if ((fresh || sighting.at - seen->second > forgotten) && may_upload() && greeted_)
        upload(Code::first_seen, 0, 0, single_tag(number, sighting), now);
    seen->second = sighting.at;
    if (seen_.size() > 10'000)
        std::erase_if(seen_, [&](auto& each) { return now.steady - each.second > forgotten; });
}

bool SilionDevice::may_upload() const {
    return connected_ && greeted_ && !waiting_ && !pending_ && !hang_up_;
}

void SilionDevice::send_waiting(Now now) {
    if (!may_upload()) return;
    if (std::exchange(fault_due_, false)) {
        if (gen2()) {
            auto text = describe_status(status_).text;
            upload(Code::fault, 0, status_, as_bytes(text), now);
        } else {
            upload(Code::fault, 0, status_, Bytes(24, 0), now);
        }
    }
    if (std::exchange(inputs_due_, false)) upload(Code::inputs, 0, 0, inputs_data(), now);
    while (buffer_.ready() && may_upload()) {
        if (gen2() && status_ != 0) return;  // no tag batches while it is faulty (section 6)
        send_tags(now);
    }
}

void SilionDevice::send_tags(Now now) {
    auto segment = buffer_.take(gen2() ? tag_bytes_2 : tag_bytes_1);
    Bytes frame;
    std::uint8_t flags = own_flags() | (acknowledge_ ? flag_answer : std::uint8_t{0});
    append_to_host(frame, static_cast<std::uint8_t>(Code::tags), flags, 0, as_bytes(name_), segment.data,
                   crc_kind());
    ++total_.frames;
    total_.tags += segment.tags;
    total_.reads += segment.reads;
    last_tags_ = frame;
    say(frame, now);
    if (std::exchange(repeat_tags_, false)) say(frame, now);
    if (acknowledge_)
        waiting_ = Unacknowledged{std::move(frame), segment.tags, segment.reads, now.steady + ack_wait_};
}

void SilionDevice::send_again(Now now) {
    ++total_.resent;
    waiting_->resend_at = now.steady + ack_wait_;
    say(waiting_->frame, now);
}

void SilionDevice::send_heartbeat(Now now) {
    Bytes data;
    wire::Writer out(data);
    auto connected = working_antennas();
    if (antennas_ == 1) connected.clear();  // a one-antenna module lists none (section 5)
    out.u8(1);
    out.u8(antennas_ == 1 ? 14 : 10);
    out.u32(gen2() ? 0x0A00000F : 0x0A000000);
    out.u8(connected.size());
    for (auto antenna : connected)
        out.u8(antenna);
    out.u32(heartbeat_count_++);
    ++total_.heartbeats;
    upload(Code::heartbeat, 0, status_, data, now);
    heartbeat_at_ = now.steady + heartbeat_;
}

// --- time --------------------------------------------------------------------------------------------------

std::optional<Steady> SilionDevice::deadline() const {
    std::optional<Steady> due = next_scan_;
    auto sooner = [&](const std::optional<Steady>& at) {
        if (at) due = std::min(*due, *at);
    };
    sooner(restart_at_);
    sooner(faults_.deadline());
    for (auto& output : outputs_)
        sooner(output.reverts);
    if (!connected_ || hang_up_) return due;
    if (!greeted_) sooner(hello_at_);
    if (pending_) sooner(pending_->at);
    if (greeted_ && waiting_ && !pending_) sooner(waiting_->resend_at);
    if (may_upload()) sooner(heartbeat_at_);
    return due;
}

void SilionDevice::time_passed(Now now) {
    if (restart_at_ && now.steady >= *restart_at_) reboot(now);
    faults_.time_passed(now, out());
    for (auto& output : outputs_)
        if (output.reverts && now.steady >= *output.reverts) {
            output.on = !output.on;
            output.reverts.reset();
        }
    if (pending_ && now.steady >= pending_->at) {
        auto due = *std::exchange(pending_, {});
        answer(Code::set_outputs, due.flags, 0, {}, now);
        take_commands(now);
    }
    if (now.steady >= next_scan_) {
        inventory(now);
        if (now.steady >= batch_at_) {
            buffer_.close_batch();
            batch_at_ = now.steady + batch_;
        }
        next_scan_ = first_seen_ ? std::min(now.steady + dwell, batch_at_) : batch_at_;
    }
    if (!connected_ || hang_up_) return;
    if (!greeted_ && hello_at_ && now.steady >= *hello_at_) {
        greeted_ = true;
        // What was not acknowledged goes first on a new connection; else a heartbeat says who this is.
        heartbeat_at_ = now.steady + heartbeat_;
        if (waiting_)
            send_again(now);
        else
            send_heartbeat(now);
    }
    if (greeted_ && waiting_ && !pending_ && now.steady >= waiting_->resend_at) send_again(now);
    if (may_upload() && heartbeat_at_ && now.steady >= *heartbeat_at_) send_heartbeat(now);
    send_waiting(now);
}

void SilionDevice::reboot(Now now) {
    ++total_.restarts;
    // Its RAM is gone: tags not sent, or sent and not acknowledged, are lost, as on a real one.
    total_.lost += buffer_.clear() + (waiting_ ? waiting_->tags : 0);
    waiting_.reset();
    outputs_ = {};
    status_ = 0;
    heartbeat_count_ = 0;
    fault_due_ = inputs_due_ = false;
    seen_.clear();
    pending_.reset();
    last_tags_.clear();
    restart_at_.reset();
    booted_at_ = now.steady + boot;
    scanned_to_ = *booted_at_;
    batch_at_ = *booted_at_ + batch_;
    next_scan_ = first_seen_ ? *booted_at_ + dwell : batch_at_;
    dial_at_ = booted_at_;
    if (!serial_) {
        hang_up_ = connected_;
        return;
    }
    // A line does not go away with the reader. It begins anew there: with a heartbeat.
    framer_ = Framer(wire::Direction::to_reader, crc_rule());
    faults_.forget();
    greeted_ = false;
    heartbeat_at_.reset();
    hello_at_ = booted_at_;
}

wire::Fields SilionDevice::state() const {
    wire::Fields fields;
    auto add = [&](std::string_view name, wire::Value value) {
        fields.push_back({std::string(name), std::move(value)});
    };
    add("name", wire::Value(name_));
    add("generation", wire::Value(generation_));
    add("connected", wire::Value(connected_));
    std::string outputs, inputs;
    for (std::size_t i = 0; i < (gen2() ? 5u : 4u); ++i)
        outputs += outputs_[i].on ? '1' : '0';
    for (bool input : inputs_)
        inputs += input ? '1' : '0';
    add("outputs", wire::Value(outputs));
    add("inputs", wire::Value(inputs));
    add("status", wire::Value(status_));
    add("buffered", wire::Value(buffer_.size()));
    add("waiting_for_ack", wire::Value(waiting_.has_value()));
    add("frames_sent", wire::Value(total_.frames));
    add("tags_sent", wire::Value(total_.tags));
    add("reads_sent", wire::Value(total_.reads));
    add("acks", wire::Value(total_.acknowledgements));
    add("tags_acked", wire::Value(total_.tags_acknowledged));
    add("reads_acked", wire::Value(total_.reads_acknowledged));
    add("resent", wire::Value(total_.resent));
    add("heartbeats", wire::Value(total_.heartbeats));
    add("dropped", wire::Value(buffer_.dropped()));
    add("lost_at_restart", wire::Value(total_.lost));
    add("restarts", wire::Value(total_.restarts));
    add("connects", wire::Value(total_.connects));
    return fields;
}

}  // namespace gantry::silion
