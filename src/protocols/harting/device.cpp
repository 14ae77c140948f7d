#include "protocols/harting/device.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/log.hpp"
#include "protocols/harting/device_scan.hpp"

namespace gantry::harting {

static constexpr std::size_t max_input = 128 * 1024;   // two of the longest frames
static constexpr std::size_t max_output = 256 * 1024;  // waiting for a host that does not read
static constexpr auto tcp_gap = 2s;  // 12 ms are for serial lines; TCP delivers late without meaning it

HartingDevice::HartingDevice(const DeviceOptions& options, Air& air)
    : dials_(!options.settings.text("connect").empty()),
      serial_(options.settings.boolean("serial")),
      boot_(options.settings.duration("boot")),
      byte_gap_(serial_ ? options.settings.duration("byte_gap") : tcp_gap),
      reader_(options, air),
      reading_(reader_),
      notifier_(std::make_shared<Notifier>(options, reader_)),
      faults_(options.seed) {
    preset(options.settings);
}

// What somebody has configured before the reader came here.
void HartingDevice::preset(const Settings& settings) {
    auto apply = [this](std::string_view assignment) {
        if (auto done = reader_.config.preset(assignment); !done)
            log::error("emulate", "setting config: {}", done.error().text());
    };
    if (dials_) {
        // No host can configure it over its one link: all antennas, each read with antenna and time, the
        // reader's MAC, and a sign that it is there. A tag that stays is told often enough not to seem to go.
        for (std::string_view each :
             {"CFG1.MODE=Notification", "CFG11.TR-DATA1=0xE1", "CFG11.TR-DATA2=0x12",
              "CFG12.TRANSPONDER-VALID-TIME=5", "CFG15.ENABLE=1", "CFG15.ANTENNAS=4", "CFG49.KEEPALIVE=1",
              "CFG49.KEEPALIVE-INTERVAL=10", "CFG49.HOLD-TIME=30"})
            apply(each);
        apply(settings.boolean("ack") ? "CFG49.ACK=1" : "CFG49.ACK=0");
    }
    auto list = settings.text("config");
    while (!list.empty()) {
        auto comma = std::min(list.find(','), list.size());
        apply(list.substr(0, comma));
        list.remove_prefix(std::min(comma + 1, list.size()));
    }
}

// --- the link ----------------------------------------------------------------------------------------------

void HartingDevice::power_on(Now now) {
    last_seen_ = now;
    powered_ = reader_.running = true;
    booted_at_ = now.steady;
    reader_.power_on(now);
    refresh(now);
}

void HartingDevice::start(Now now) {
    connected_ = true;
    ++total_.connects;
    if (std::exchange(reboot_waits_, false)) reboots_at_ = now.steady + reboot_after;
    // A serial line is always there; what comes before the boot is over finds nobody.
    hang_up_ = !serial_ && !is_up(now);
    faults_.link_up();
    drop_input();
    if (!dials_) return;
    notifier_->start(now);
    time_passed(now);
}

void HartingDevice::link_lost(Now now) {
    connected_ = hang_up_ = false;
    pending_.reset();
    faults_.link_lost();
    drop_input();
    drop_output();
    if (dials_) notifier_->link_lost(now);
}

bool HartingDevice::finished() const {
    return connected_ && (hang_up_ || faults_.dropped() || (dials_ && notifier_->finished()));
}

std::optional<Steady> HartingDevice::dial_at() const {
    if (!dials_ || connected_ || !reader_.running) return {};
    return notifier_->dial_at();
}

void HartingDevice::dial_failed(Now now) {
    notifier_->dial_failed(now);
}

std::vector<std::shared_ptr<DialOut>> HartingDevice::dial_outs() const {
    if (dials_ || !notifier_->is_wanted()) return {};
    return {notifier_};
}

bool HartingDevice::wants_input() const {
    if (dials_ && !notifier_->wants_input()) return false;
    return framer_.rest().size() < max_input && output().size() + faults_.late() < max_output;
}

// As the only link what the notifier says goes out here.
void HartingDevice::pump() {
    if (!dials_ || output().size() >= max_output) return;
    auto said = notifier_->output();
    out().insert(out().end(), said.begin(), said.end());
    notifier_->output_sent(said.size());
}

void HartingDevice::say(ByteView bytes, Now now) {
    if (connected_ && !silent_) faults_.say(bytes, now, out());
}

// --- requests ----------------------------------------------------------------------------------------------

void HartingDevice::received(ByteView bytes, Now now) {
    last_seen_ = now;
    if (!connected_ || hang_up_ || faults_.deaf() || !is_up(now)) return;
    if (dials_) {
        notifier_->received(bytes, now);
        pump();
        return;
    }
    if (give_up_at_ && now.steady >= *give_up_at_) drop_input();
    framer_.add(bytes);
    take_requests(now);
}

void HartingDevice::take_requests(Now now) {
    while (!pending_ && !hang_up_ && is_up(now)) {
        auto frame = framer_.next();
        if (!frame) break;
        on_request(*frame, now);
    }
    give_up_at_.reset();
    if (framer_.partial() && !pending_) give_up_at_ = now.steady + byte_gap_;
}

void HartingDevice::drop_input() {
    framer_.drop();
    framer_.reset();
    give_up_at_.reset();
}

std::optional<Status> HartingDevice::disturbed(const Frame& frame) {
    if (auto forced = std::exchange(next_status_, std::nullopt)) return static_cast<Status>(*forced);
    if (frame.bytes.size() > reader_.rx_buf) return Status::length_error;
    // In EE-Init mode a reset is all that helps (manual, section 7).
    if (reader_.config.eeprom_failed() && frame.control != control_of(Command::system_reset))
        return Status::eeprom_failure;
    if (busy_) return Status::busy;
    return {};
}

static bool is_available(When when, const ReaderState& reader) {
    switch (when) {
        case When::host_mode:
            return reader.mode() == Mode::host;
        case When::buffer_mode:
            return reader.stores();
        case When::always:
            break;
    }
    return true;
}

void HartingDevice::on_request(const Frame& frame, Now now) {
    if (frame.address != any_address && frame.address != reader_.setup.address) {
        ++total_.foreign;
        return;
    }
    if (silent_) return;
    // On this link a host acknowledges what it has read by clearing it.
    if (stuck_ack_ && frame.control == control_of(Command::clear_data_buffer)) {
        ++total_.acks_lost;
        return;
    }
    ++total_.requests;
    if (auto status = disturbed(frame)) return answer(frame.control, *status, {}, now);
    const auto* row = find_request(frame.control, frame.data);
    if (has_sub(frame.control) && frame.data.empty())
        return answer(frame.control, Status::length_error, {}, now);
    if (row == nullptr || !row->of_manual) return answer(frame.control, Status::unknown_command, {}, now);
    if (!is_available(row->when, reader_))
        return answer(frame.control, Status::command_not_available, {}, now);
    run(*row, frame, now);
}

void HartingDevice::run(const CommandRow& row, const Frame& frame, Now now) {
    auto* handler = find_handler(static_cast<Command>(row.control << 8 | row.sub));
    if (handler == nullptr)  // a test holds that no command of the manual comes here
        return answer(frame.control, Status::unknown_command, {}, now);
    Call call{.data = frame.data,
              .reader = reader_,
              .reading = reading_,
              .notifier = *notifier_,
              .inventory = inventory_,
              .buffer_read = buffer_read_,
              .now = now};
    auto status = handler(call);
    // A warning goes with what was done all the same (status 0x84).
    if (status == Status::ok && row.on_tags && !call.takes_time && reader_.rf_warning())
        status = Status::rf_warning;
    if (call.takes_time) {
        pending_ = Pending{frame.control, now.steady + inventory_.takes(reader_)};
        return;
    }
    answer(frame.control, status, call.answer, now);
    if (call.restart)
        reset(now, boot_);
    else
        refresh(now);
}

void HartingDevice::answer(std::uint8_t control, Status status, ByteView data, Now now) {
    if (!has_data(static_cast<std::uint8_t>(status))) ++total_.refused;
    Bytes frame;
    append_reply(frame, reader_.setup.address, control, static_cast<std::uint8_t>(status), data);
    say(frame, now);
}

// --- time --------------------------------------------------------------------------------------------------

std::optional<Steady> HartingDevice::deadline() const {
    std::optional<Steady> due;
    auto sooner = [&](const std::optional<Steady>& at) {
        if (at && (!due || *at < *due)) due = at;
    };
    sooner(start_at_);
    sooner(reboots_at_);
    sooner(give_up_at_);
    sooner(faults_.deadline());
    if (pending_) sooner(pending_->due);
    if (!reader_.running) return due;
    sooner(reader_.outputs.deadline());
    sooner(reader_.trigger.deadline(reader_.setup));
    sooner(reading_.deadline());
    sooner(notifier_->due());
    return due;
}

void HartingDevice::time_passed(Now now) {
    last_seen_ = now;
    if (reboots_at_ && now.steady >= *reboots_at_) {
        reboots_at_.reset();
        if (powered_) reset(now, boot_);
    }
    if (start_at_ && now.steady >= *start_at_) {
        start_at_.reset();
        reader_.running = true;
        refresh(now);
    }
    if (give_up_at_ && now.steady >= *give_up_at_) drop_input();
    reader_.outputs.time_passed(now.steady);
    if (reader_.running) {
        read(now);
        auto change = reader_.trigger.time_passed(reader_.setup, now.steady);
        if (change.timed_out) store_event(reader_.setup.timeout_event, now);
    }
    if (pending_ && now.steady >= pending_->due) {
        auto due = *std::exchange(pending_, {});
        Bytes data;
        auto status = inventory_.finish(reader_, now.steady, data);
        answer(due.control, status, data, now);
        take_requests(now);  // what waited for it
    }
    faults_.time_passed(now, out());
    notifier_->step(now);
    pump();
}

void HartingDevice::read(Now now) {
    std::vector<TagRecord> cycle;
    while (reading_.step(now.steady, cycle))
        store(cycle, now);
}

void HartingDevice::store(std::vector<TagRecord>& cycle, Now now) {
    for (auto& record : cycle)
        for (auto& antenna : record.antennas)
            reader_.outputs.on_read(antenna.number, reader_.setup, now.steady);
    if (reader_.mode() == Mode::scan) {
        // There is no scan mode but over a serial line (manual, section 5).
        bool heard = serial_ && connected_ && output().size() < max_output;
        Bytes block;
        append_scan(cycle, reader_.setup, block);
        if (heard) say(block, now);
        (heard ? total_.scans : total_.scans_lost) += cycle.size();
    } else {
        for (auto& record : cycle)
            reader_.buffer.add({std::move(record)});
    }
    cycle.clear();
}

// An input or the trigger has changed. `reported`: CFG12 wants to know; CFG11 must have a place for it.
void HartingDevice::store_event(bool reported, Now now) {
    auto& setup = reader_.setup;
    bool has_place = (setup.tr1 & tr1_extension) != 0 && (setup.tr2 & tr2_input) != 0;
    if (reported && has_place && reader_.works() && reader_.stores()) {
        TagRecord record;
        record.transponder_type = 0;
        record.time = reader_.clock.time_at(now.steady);
        record.input = {reader_.inputs(), reader_.trigger.status(setup), to_us(record.time)};
        reader_.buffer.add({std::move(record), true});
        if (setup.triggered) notifier_->event_added();
    }
    refresh(now);
}

// Something was changed that the parts depend on.
void HartingDevice::refresh(Now now) {
    reading_.refresh(now.steady);
    notifier_->refresh(now);
    notifier_->step(now);
    pump();
}

// RAM, buffer and links are gone; the EEPROM is read again.
void HartingDevice::reset(Now now, std::chrono::microseconds boot) {
    ++total_.resets;
    pending_.reset();
    faults_.forget();
    inventory_.forget();
    reading_.forget();
    buffer_read_ = 0;
    reader_.restart(now);
    reader_.running = false;
    booted_at_ = now.steady + boot;
    start_at_ = booted_at_;
    reading_.refresh(now.steady);
    notifier_->restart(now);
    if (serial_)
        drop_input();
    else
        hang_up_ = connected_;
}

}  // namespace gantry::harting
