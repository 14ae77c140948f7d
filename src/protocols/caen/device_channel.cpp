#include "protocols/caen/device_channel.hpp"

#include <utility>

#include "protocols/caen/device_state.hpp"
#include "protocols/caen/message.hpp"

namespace gantry::caen {

static constexpr std::size_t max_report = 60'000;    // a message says its length in 16 bits
static constexpr std::size_t max_waiting = 256'000;  // a host that does not read gets no more

NotifyChannel::NotifyChannel(std::string name, std::string address, std::chrono::microseconds redial,
                             std::size_t capacity, std::uint64_t seed, Now now)
    : name_(std::move(name)),
      address_(std::move(address)),
      redial_(redial),
      capacity_(capacity),
      dial_at_(now.steady),
      faults_(seed) {}

void NotifyChannel::start(Now) {
    connected_ = true;
    faults_.link_up();
}

void NotifyChannel::received(ByteView, Now) {}  // a host says nothing here

void NotifyChannel::link_lost(Now now) {
    connected_ = false;
    faults_.link_lost();
    drop_output();
    dial_at_ = now.steady + redial_;
}

std::optional<Steady> NotifyChannel::dial_at() const {
    return connected_ || ended_ ? std::nullopt : dial_at_;
}

void NotifyChannel::dial_failed(Now now) {
    dial_at_ = now.steady + redial_;
}

void NotifyChannel::add(const Event& event) {
    if (std::exchange(no_place_, false)) {
        ++dropped_;
        return;
    }
    if (events_.size() >= capacity_) {
        events_.pop_front();
        ++dropped_;
    }
    events_.push_back(event);
}

void NotifyChannel::overflow() {
    no_place_ = events_.empty();
    dropped_ += events_.size();
    events_.clear();
}

void NotifyChannel::report(Now now) {
    while (connected_ && !events_.empty() && output().size() + faults_.late() < max_waiting)
        report_some(now);
}

// The pairs of table 3.1 in its order, for each tag. Code and first field are not published (section 9).
void NotifyChannel::report_some(Now now) {
    Bytes said;
    Builder message(said, to_host_head, id_++);
    message.command(Command::report_buffer);
    while (!events_.empty() && said.size() < max_report) {
        auto& event = events_.front();
        message.time(Attribute::time_stamp, event.time_us)
            .number(Attribute::tag_id_len, event.tag.size)
            .bytes(Attribute::tag_id, event.tag.view())
            .text(Attribute::source_name, source_name(event.source))
            .number(Attribute::event_type, static_cast<std::uint32_t>(event.event));
        events_.pop_front();
    }
    message.result(ResultCode::success);
    if (message.finish())
        faults_.say(said, now, out());
    else
        ++dropped_;  // cannot be: max_report and one event fit
}

void NotifyChannel::kill(Now now) {
    if (ended_) return;
    report(now);
    Bytes said;
    Builder message(said, to_host_head, id_++);
    message.command(Command::kill_message);
    if (message.finish()) faults_.say(said, now, out());
    ended_ = true;
}

void NotifyChannel::end() {
    drop_output();
    ended_ = true;
}

}  // namespace gantry::caen
