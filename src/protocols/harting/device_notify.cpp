#include "protocols/harting/device_notify.hpp"

#include <algorithm>

#include "protocols/harting/device_info.hpp"

namespace gantry::harting {

static constexpr std::size_t max_waiting = 64 * 1024;  // in the output, of a host that does not read
static constexpr std::size_t max_input = 64 * 1024;
static constexpr std::size_t frame_overhead = min_reply;

Notifier::Notifier(const DeviceOptions& options, ReaderState& reader)
    : reader_(reader),
      connect_(options.settings.text("connect")),
      when_(options.settings.text("notify_trigger") == "time"   ? When::time
            : options.settings.text("notify_trigger") == "host" ? When::host
                                                                : When::continuous),
      period_(options.settings.duration("notify_period")),
      repeat_(options.settings.duration("repeat")),
      redial_(options.settings.duration("redial")),
      new_keepalive_(options.settings.text("keepalive") == "new"),
      answer_ack_(options.settings.boolean("answer_ack")),
      faults_(options.seed + 1) {}

// --- the link ----------------------------------------------------------------------------------------------

std::string Notifier::address() const {
    return connect_.empty() ? reader_.setup.notify.address : connect_;
}

bool Notifier::is_wanted() const {
    return active_ && !address().empty();
}

void Notifier::start(Now now) {
    connected_ = true;
    ended_ = false;
    faults_.link_up();
    dialled_ = address();
    hold_until_ = now.steady + reader_.setup.notify.hold;
    framer_.reset();
    ++tally_.connects;
    if (waiting_) waiting_->resend_at = now.steady;  // what was not acknowledged goes first
}

void Notifier::link_lost(Now now) {
    next_try_ = std::max(next_try_, ended_ ? now.steady : now.steady + redial_);
    connected_ = ended_ = false;
    hold_until_.reset();
    faults_.link_lost();
    drop_output();
}

void Notifier::dial_failed(Now now) {
    next_try_ = now.steady + redial_;
}

std::optional<Steady> Notifier::dial_at() const {
    bool has_news = waiting_ || to_tell() > 0;
    if (connected_ || !is_wanted()) return {};
    if (has_news) return next_try_;
    if (keepalive_at_) return std::max(*keepalive_at_, next_try_);
    return {};
}

bool Notifier::wants_input() const {
    return output().size() + faults_.late() < max_waiting && framer_.rest().size() < max_input;
}

void Notifier::say(ByteView frame, Now now) {
    hold_until_ = now.steady + reader_.setup.notify.hold;
    faults_.say(frame, now, out());
}

// On this link a host only acknowledges; it commands on the reader's own port (section 8).
void Notifier::received(ByteView bytes, Now now) {
    if (faults_.deaf() || !connected_) return;
    framer_.add(bytes);
    while (auto frame = framer_.next())
        on_request(*frame, now);
    step(now);
}

void Notifier::on_request(const Frame& frame, Now now) {
    if (frame.address != any_address && frame.address != reader_.setup.address) {
        ++tally_.ignored;
        return;
    }
    if (stuck_ack) {
        ++tally_.acks_lost;
        return;
    }
    auto status = Status::command_not_available;
    bool is_ack = frame.control == control_of(Command::clear_data_buffer);
    if (is_ack && !frame.data.empty())
        status = Status::length_error;
    else if (is_ack)
        status = acknowledge(now) ? Status::ok : Status::no_valid_data;
    if (is_ack && !answer_ack_) return;
    append_reply(out(), reader_.setup.address, frame.control, static_cast<std::uint8_t>(status), {});
}

// --- what it says ------------------------------------------------------------------------------------------

std::size_t Notifier::to_tell() const {
    if (!active_) return 0;
    return when_ == When::continuous ? reader_.buffer.size() : std::min(allowed_, reader_.buffer.size());
}

void Notifier::tell_all() {
    allowed_ = reader_.buffer.size();
}

void Notifier::event_added() {
    if (when_ != When::host) tell_all();
}

void Notifier::restart(Now now) {
    ended_ = connected_;
    waiting_.reset();
    allowed_ = 0;
    active_ = false;
    refresh(now);
}

void Notifier::refresh(Now now) {
    bool active = reader_.works() && reader_.mode() == Mode::notification;
    auto& setup = reader_.setup.notify;
    if (active && !active_) {
        tell_at_ = now.steady + period_;
        keepalive_at_.reset();
    }
    active_ = active;
    if (connected_ && (!active || dialled_ != address())) ended_ = true;
    if (!active || !setup.keepalive || setup.interval == 0s)
        keepalive_at_.reset();
    else if (!keepalive_at_ || *keepalive_at_ > now.steady + setup.interval)
        keepalive_at_ = now.steady + setup.interval;
}

bool Notifier::acknowledge(Now now) {
    if (!waiting_) return false;
    auto sets = std::exchange(waiting_, {})->sets;
    reader_.buffer.clear(sets);
    allowed_ -= std::min(allowed_, sets);
    ++tally_.acknowledged;
    tally_.sets_acknowledged += sets;
    hold_until_ = now.steady + reader_.setup.notify.hold;
    return true;
}

void Notifier::step(Now now) {
    if (!active_) return;
    if (tell_at_ && when_ == When::time && now.steady >= *tell_at_) {
        tell_all();
        tell_at_ = now.steady + period_;
    }
    if (!connected_ || ended_) return;
    faults_.time_passed(now, out());
    if (waiting_ && now.steady >= waiting_->resend_at) {
        ++tally_.repeated;
        waiting_->resend_at = now.steady + repeat_;
        say(waiting_->frame, now);
    }
    while (!waiting_ && to_tell() > 0 && output().size() + faults_.late() < max_waiting)
        tell(now);
    if (keepalive_at_ && now.steady >= *keepalive_at_) keep_alive(now);
    if (!waiting_ && to_tell() == 0 && hold_until_ && now.steady >= *hold_until_) ended_ = true;
}

// Events and tags go in messages of their own while a trigger decides when to read (section 8).
void Notifier::tell(Now now) {
    auto& setup = reader_.setup;
    auto& buffer = reader_.buffer;
    auto wanted = to_tell();
    Bytes data;
    auto sets = append_sets(buffer, wanted, setup.triggered, reader_.tx_buf - frame_overhead, setup,
                            reader_.mac, data);
    auto status = buffer.overflowed()    ? Status::buffer_overflow
                  : sets < wanted        ? Status::more_data
                  : reader_.rf_warning() ? Status::rf_warning
                                         : Status::ok;
    Bytes frame;
    append_reply(frame, setup.address, control_of(Command::read_buffer), static_cast<std::uint8_t>(status),
                 data);
    if (status == Status::buffer_overflow) buffer.told();
    buffer.was_sent(sets);
    ++tally_.messages;
    tally_.sets_sent += sets;
    say(frame, now);
    if (setup.notify.ack) {
        waiting_ = Waiting{std::move(frame), sets, now.steady + repeat_};
        return;
    }
    buffer.forget(sets);
    allowed_ -= std::min(allowed_, sets);
}

void Notifier::keep_alive(Now now) {
    Bytes frame;
    append_reply(frame, reader_.setup.address, control_of(Command::reader_diagnostic),
                 static_cast<std::uint8_t>(reader_.rf_warning() ? Status::rf_warning : Status::ok),
                 new_keepalive_ ? keepalive_records(reader_) : keepalive_flags(reader_));
    ++tally_.keepalives;
    say(frame, now);
    keepalive_at_ = now.steady + reader_.setup.notify.interval;
}

std::optional<Steady> Notifier::due() const {
    std::optional<Steady> due;
    auto sooner = [&](const std::optional<Steady>& at) {
        if (at && (!due || *at < *due)) due = at;
    };
    if (!active_) return due;
    if (when_ == When::time) sooner(tell_at_);
    if (!connected_ || ended_) return due;
    sooner(faults_.deadline());
    if (waiting_) sooner(waiting_->resend_at);
    sooner(keepalive_at_);
    if (!waiting_ && to_tell() == 0) sooner(hold_until_);
    return due;
}

}  // namespace gantry::harting
