#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/caen/driver.hpp"

// The part of the driver that keeps in step with the reader: what is late, cut short, left from before, or
// makes no sense; and whether the reader is still the one that was set up.
namespace gantry::caen {

static constexpr std::size_t leftover_bytes = 256;  // that make no sense before the first answer
static constexpr std::size_t most_given_up = 8;
static constexpr std::chrono::seconds still_flows{1};
static constexpr std::chrono::minutes between_doubts{1};

// Moves the framer's tally into the counters.
void CaenDriver::count_tally() {
    auto& tally = framer_.tally();
    auto messages = tally.messages - counted_.messages;
    auto skipped = tally.skipped_bytes - counted_.skipped_bytes;
    auto resyncs = tally.resyncs - counted_.resyncs;
    counted_ = tally;
    count(Count::frames, messages);
    count(Count::skipped_bytes, skipped);
    count(Count::resyncs, resyncs);
    if (messages > 0) {
        astray_ = 0;
        if (tally.messages % 8 == 0 && trouble_ > 0) --trouble_;
    }
    astray_ += skipped;
    trouble_ += static_cast<unsigned>(resyncs);
}

// Gives up on a stream that makes no sense.
void CaenDriver::check_stream(Now now) {
    auto before = counted_.skipped_bytes;
    count_tally();
    if (counted_.skipped_bytes > before && stream_ == Stream::on && !framer_.in_stream()) abort_stream(now);
    if (!ever_answered_ && !leftover_tried_ && astray_ >= leftover_bytes) abort_leftover(now);
    if (astray_ > max_astray)
        finish(ever_answered_ ? fmt::format("{} bytes without a message", astray_)
                              : fmt::format("no CAEN reader: the connection began with \"{}\"",
                                            printable(as_text(first_bytes_))));
    else if (trouble_ >= max_trouble)
        finish(fmt::format("lost step with the reader {} times: {} of its bytes made no sense", trouble_,
                           counted_.skipped_bytes));
}

// On a serial line the reader may still be sending the stream of an earlier run: nothing else is heard before
// that is aborted.
void CaenDriver::abort_leftover(Now now) {
    leftover_tried_ = true;
    if (!asked_) return;
    out().push_back(abort_byte);
    leftover_quiet_at_ = now.steady + drain_silence;
    leftover_end_ = now.steady + drain_limit;
}

// --- answers -----------------------------------------------------------------------------------------------

void CaenDriver::answer_came(Now now) {
    ever_answered_ = true;
    first_bytes_ = {};
    leftover_quiet_at_.reset();
    timeouts_ = 0;
    last_answer_ = silent_since_ = now.steady;
}

// An inventory takes what dwell time, read points, ReadCycle and quiet time make of it, and nobody but the
// reader knows them all: the last one shows how long the next may take, and each silence doubles that.
std::chrono::microseconds CaenDriver::inventory_patience() const {
    auto patience = first_inventory_ ? Request::first_inventory_patience : inventory_patience_;
    return std::min<std::chrono::microseconds>(patience * (1U << timeouts_), longest_patience);
}

Steady CaenDriver::silence_end() const {
    return silent_since_ + std::max<std::chrono::microseconds>(silence_limit, 2 * inventory_patience_);
}

void CaenDriver::inventory_took(Steady asked_at, Now now) {
    auto took = std::chrono::duration_cast<std::chrono::microseconds>(now.steady - asked_at);
    inventory_patience_ =
        std::min<std::chrono::microseconds>(took + Request::usual_patience, longest_patience);
}

// Of an inventory that is asked for or was given up; nullptr: of something else.
const CaenDriver::Asked* CaenDriver::inventory_with(std::uint16_t id) const {
    auto fits = [id](const Asked& asked) { return asked.id == id && asked.is_inventory(); };
    if (asked_ && fits(*asked_)) return &*asked_;
    auto found = std::ranges::find_if(given_up_, fits);
    return found != given_up_.end() ? &*found : nullptr;
}

// The reader was busy with an inventory for longer than we waited, and what it was asked since comes after
// it.
bool CaenDriver::came_late(std::uint16_t id, Purpose purpose, Now now) {
    auto late = std::ranges::find_if(
        given_up_, [&](const Asked& each) { return each.id == id && each.purpose == purpose; });
    if (late == given_up_.end()) return false;
    inventory_took(late->at, now);
    given_up_.erase(late);
    answer_came(now);
    doubted_ = false;
    if (asked_) {
        auto patience = asked_->is_inventory() ? inventory_patience() : asked_->request.patience;
        asked_->due = std::max(asked_->due, now.steady + patience);
    }
    return true;
}

bool CaenDriver::answer_flows(Now now) const {
    auto header = read_header(framer_.rest());
    return header && header->id == asked_->id && now.steady < last_heard_ + still_flows &&
           now.steady < asked_->at + longest_patience;
}

void CaenDriver::timed_out(Now now) {
    if (answer_flows(now)) {
        asked_->due = std::min(last_heard_ + still_flows, asked_->at + longest_patience);
        return;
    }
    count(Count::timeouts);
    if (asked_->is_inventory()) {
        given_up_.push_back(*asked_);
        if (given_up_.size() > most_given_up) given_up_.pop_front();
    }
    salvage(now);
    if (++timeouts_ >= max_timeouts || now.steady >= silence_end()) {
        auto name = asked_->request.name();
        finish(!ever_answered_ && !first_bytes_.empty()
                   ? fmt::format("no CAEN reader: the connection began with \"{}\"",
                                 printable(as_text(first_bytes_)))
                   : fmt::format("the reader left {} commands in a row without an answer, the last {}",
                                 timeouts_, name));
        return;
    }
    bool job = asked_->purpose == Purpose::task && (doing_ == Doing::job || doing_ == Doing::output);
    if (job || asked_->is_inventory() || asked_->purpose == Purpose::keep_alive) doubted_ = true;
    answered(Reply{.silent = true}, now);
}

// An answer ends in the middle: the tags that are whole count, the rest is skipped.
void CaenDriver::salvage(Now now) {
    auto rest = framer_.rest();
    std::size_t used = 0;
    auto header = read_header(rest);
    auto* asked = header && !framer_.in_stream() ? inventory_with(header->id) : nullptr;
    AvpReader pairs(rest.subspan(std::min(rest.size(), header_size)));
    auto first = asked != nullptr ? pairs.next() : std::nullopt;
    if (first && first->is(Attribute::command_name) && first->number() == asked->request.command) {
        auto& report = gather_.open_for_tags(now);
        auto from = report.observations.size();
        walker_.restart();
        auto walked = walker_.walk(rest.subspan(header_size), header_size, report.observations, report.data);
        used = walked.fault ? walked.fault->offset : rest.size();
        if (walked.fault && walked.fault->code == wire::Errc::truncated) walked.fault.reset();
        took(report, from, walked, rest);
    }
    framer_.drop(used);
    count_tally();
}

// --- is it still set up? -----------------------------------------------------------------------------------

// On a serial line a restart breaks no link. A reader that was silent and is there again may have restarted,
// and has lost its settings then. A reader that is often silent is not set up again all the time.
void CaenDriver::look_after_silence(Now now) {
    if (!doubted_ || !set_up_ || now.steady < next_doubt_) return;
    doubted_ = false;
    next_doubt_ = now.steady + between_doubts;
    set_up_ = false;
}

// A stream without a tag for long was aborted, and the reader said nothing to that. One that always ends its
// streams with a result code had none to end; another is asked whether it still has its ReadCycle.
void CaenDriver::look_after_silent_stream(Now now) {
    if (std::exchange(ends_with_result_, false)) {
        doubted_ = true;
        look_after_silence(now);
    } else {
        ask_cycle_ = cycle_ == Cycle::endless && reader_.has(Command::get_source_config);
    }
}

void CaenDriver::cycle_told(const Reply& reply, Now now) {
    auto value = reply.parsed.number(Attribute::config_value);
    if (!reply.ok() || !value || *value == 0) return;
    set_up_ = false;
    fault(fault_reading, "the reader has lost its ReadCycle: it seems to have restarted, and is set up again",
          now);
}

}  // namespace gantry::caen
