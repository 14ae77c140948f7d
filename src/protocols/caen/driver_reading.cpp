#include <algorithm>

#include <fmt/format.h>

#include "protocols/caen/driver.hpp"

// The part of the driver that reads tags: rounds of a command, and the framed stream (section 8).
namespace gantry::caen {

static constexpr std::chrono::seconds pause_after_fault{1}, pause_without_mode{30};
static constexpr std::size_t stream_report = 64;  // observations, then the report goes out
static constexpr std::chrono::milliseconds longest_gathering{250};
static constexpr std::int64_t restart_step_us = 60'000'000;
static constexpr std::chrono::seconds between_restarts{10};
static constexpr std::size_t kept_of_frame = 256;  // with a fault

bool CaenDriver::polls() const {
    auto mode = plan_.mode();
    return set_up_ && mode && mode != Mode::notify && !reader_.sources.empty();
}

bool CaenDriver::read_next(Now now) {
    poll_owed_ = false;
    if (source_ >= reader_.sources.size()) source_ = 0;
    auto& source = reader_.sources[source_];
    bool stream = plan_.mode() == Mode::framed;
    // A stream goes on for as long as ReadCycle says; rounds would, too, if it stayed endless.
    if (stream != (cycle_ != Cycle::untouched) && reader_.has(Command::set_source_config)) {
        ask(ReadingPlan::read_cycle(source, stream ? 0 : 1), Purpose::cycle, now);
        return true;
    }
    if (std::exchange(ask_cycle_, false)) {
        ask(ReadingPlan::get_read_cycle(source), Purpose::cycle_check, now);
        return true;
    }
    if (source_ == 0) round_start_ = now.steady;
    auto request = plan_.request(source);
    request.patience = inventory_patience();
    first_inventory_ = false;
    ask(request, stream ? Purpose::stream : Purpose::poll, now);
    return true;
}

void CaenDriver::round_goes_on(Now now) {
    if (++source_ < reader_.sources.size()) return;
    source_ = 0;
    auto period = std::max<std::chrono::microseconds>(options_.settings.duration("poll"), poll_floor);
    poll_at_ = std::max(poll_at_, std::max(now.steady, round_start_ + period));
}

// What every walk over tags is followed by.
void CaenDriver::took(Report& report, std::size_t from, const Walked& walked, ByteView bytes) {
    auto fresh = std::span(report.observations).subspan(from);
    count(Count::reads, fresh.size());
    look_for_restart(fresh, report.received);
    gather_.take_times(report, from);
    if (!walked.fault && walked.unusable == 0) return;
    count(Count::malformed, walked.unusable + (walked.fault ? 1 : 0));
    auto text = malformed_.pass(walked.fault ? fmt::format("malformed inventory: {}", walked.fault->text())
                                             : "a tag whose id is empty, too long or not all there",
                                report.received);
    if (!text) return;
    auto kept = bytes.first(std::min(bytes.size(), kept_of_frame));
    report.notices.emplace_back(
        FaultNotice{fault_malformed, std::move(*text), Bytes(kept.begin(), kept.end())});
}

// On a serial line a restart breaks no link; a clock that falls back shows it.
void CaenDriver::look_for_restart(std::span<const Observation> observations, Now now) {
    for (auto& each : observations) {
        auto time = each.reader_time_us;
        if (time == 0) continue;
        bool fell = time + restart_step_us < last_reader_time_us_;
        last_reader_time_us_ = time;
        if (!fell || now.steady < set_up_at_ + between_restarts) continue;
        set_up_ = false;
        fault(fault_reading, "the reader's clock fell back: it seems to have restarted, and is set up again",
              now);
    }
}

// A whole answer; its result, if it has one.
std::optional<std::uint16_t> CaenDriver::take_tags(ByteView message, Now now) {
    auto& report = gather_.open_for_tags(now);
    auto from = report.observations.size();
    walker_.restart();
    auto walked = walker_.walk(message.subspan(header_size), header_size, report.observations, report.data);
    took(report, from, walked, message);
    if (!walked.result && !walked.fault) count(Count::malformed);
    return walked.result;
}

void CaenDriver::on_poll(ByteView message, Now now) {
    bool stream = asked_->purpose == Purpose::stream;
    inventory_took(asked_->at, now);
    asked_.reset();
    if (stream) poll_at_ = std::max(poll_at_, now.steady + poll_floor);
    auto result = take_tags(message, now).value_or(static_cast<std::uint16_t>(ResultCode::success));
    if (stream && result == 0) return fall_back("the reader answers without a stream", now);
    reading_result(result, now);
    round_goes_on(now);
}

// What the reader says of the inventory of the present source.
void CaenDriver::reading_result(std::uint16_t result, Now now) {
    if (!set_up_ || source_ >= reader_.sources.size())
        return;  // of a stream that was not started by this set-up
    auto code = static_cast<ResultCode>(result);
    auto& name = reader_.sources[source_].name;
    if (code == ResultCode::success || code == ResultCode::tag_not_present) {
        plan_.worked();
        no_mode_told_ = false;
        source_faults_.erase(name);
        return;
    }
    bool refusal = code == ResultCode::invalid_function || code == ResultCode::invalid_command ||
                   code == ResultCode::invalid_parameter;
    if (refusal && plan_.refused(caen::describe(result))) return fall_back({}, now);
    auto& told = source_faults_[name];
    if (told != result) {
        told = result;
        fault(result, fmt::format("the inventory of {} failed: {}", name, caen::describe(result)), now);
    }
    bool no_source = code == ResultCode::invalid_source_name || code == ResultCode::source_not_found ||
                     code == ResultCode::source_disabled || code == ResultCode::bad_read_point;
    if (no_source && reader_.sources.size() > 1) {
        reader_.sources.erase(reader_.sources.begin() + static_cast<std::ptrdiff_t>(source_));
        source_ = source_ == 0 ? reader_.sources.size() : source_ - 1;  // round_goes_on() moves to the next
        return;
    }
    poll_at_ = now.steady + pause_after_fault;
}

// `why`: besides what the inventory itself has noted.
void CaenDriver::fall_back(std::string why, Now now) {
    if (!why.empty()) plan_.refused(std::move(why));
    describe();
    if (plan_.mode()) return;
    poll_at_ = now.steady + pause_without_mode;
    if (!std::exchange(no_mode_told_, true))
        fault(fault_reading, "the reader offers no way to read tags: " + plan_.detail(), now);
}

// --- the framed stream -------------------------------------------------------------------------------------

void CaenDriver::on_stream_head(ByteView bytes, Now now) {
    auto id = read_header(bytes)->id;
    if (!asked_ || asked_->purpose != Purpose::stream || id != asked_->id) return on_other_stream(id, now);
    inventory_took(asked_->at, now);
    asked_.reset();
    answer_came(now);
    look_after_silence(now);
    count(Count::frames);
    stream_ = Stream::on;
    stream_tags_ = stream_result_ = silent_stream_ = false;
    walker_.restart();
}

// One that was given up, or of an earlier run: nothing else is heard before it has ended. What it brings are
// reads all the same.
void CaenDriver::on_other_stream(std::uint16_t id, Now now) {
    if (came_late(id, Purpose::stream, now)) {
        count(Count::frames);
    } else {
        count(Count::unknown_code);
        ++trouble_;
    }
    if (stream_ != Stream::draining) abort_stream(now);
    stream_tags_ = stream_result_ = false;
    walker_.restart();
}

void CaenDriver::on_pair(ByteView bytes, Now now) {
    AvpReader reader(bytes, 0);
    auto pair = reader.next();
    if (!pair || pair->is(Attribute::command_name)) return;
    if (pair->is(Attribute::result_code))
        return on_stream_result(pair->number().value_or(0xFFFF) & 0xFFFF, now);
    // A tag's own pairs come after its id; a report goes out only between two tags.
    bool compact = options_.settings.boolean("compact");
    bool begins = pair->is(Attribute::source_name) || (compact && pair->is(Attribute::tag_id));
    if (begins && gather_.open(now).observations.size() >= stream_report) {
        gather_.flush();
        flush_at_.reset();
    }
    auto& report = gather_.open_for_tags(now);
    auto from = report.observations.size();
    auto walked = walker_.walk(bytes, 0, report.observations, report.data);
    if (report.observations.size() > from || walked.unusable > 0) {
        took(report, from, walked, bytes);
        if (stream_ != Stream::off && !std::exchange(stream_tags_, true))
            starts_with_result_ = stream_result_;
        plan_.worked();
        if (!flush_at_) {
            flush_end_ = now.steady + longest_gathering;
            flush_at_ = flush_end_;
        }
    }
}

// Some send a result code of 0 before the first tag, some only at the end, some both (section 8).
void CaenDriver::on_stream_result(std::uint16_t result, Now now) {
    bool draining = stream_ == Stream::draining;
    if (stream_ == Stream::off) {  // the end of one that was silent for too long
        framer_.stream_over();
        flush_at_.reset();
        ends_with_result_ = true;
        return;
    }
    bool told = std::exchange(stream_result_, true);
    bool may_be_early = result == 0 && !stream_tags_ && !told;
    if (may_be_early && (!draining || starts_with_result_ != false)) {
        if (!draining) plan_.worked();
        return;
    }
    if (draining && result == 0) {
        ends_with_result_ = true;
        if (!stream_tags_ && told) starts_with_result_ = true;
    }
    framer_.stream_over();
    stream_over(now, draining ? std::chrono::microseconds{0} : poll_floor);
    if (!draining || result != 0) reading_result(result, now);
}

void CaenDriver::stream_over(Now now, std::chrono::microseconds pause) {
    stream_ = Stream::off;
    silent_stream_ = false;
    poll_at_ = std::max(poll_at_, now.steady + pause);
    last_answer_ = std::max(last_answer_, last_heard_);
    flush_at_.reset();
    if (asked_) asked_->due = std::max(asked_->due, now.steady + asked_->request.patience);
}

void CaenDriver::abort_stream(Now now) {
    out().push_back(abort_byte);
    stream_ = Stream::draining;
    drain_end_ = now.steady + drain_limit;
    flush_at_.reset();
}

// A reader that ended a stream with a result code once is given the time to do so again. A code that may have
// been the start's or the end's is no reason to wait for long.
Steady CaenDriver::drained_at() const {
    bool code_comes = ends_with_result_ && (!stream_result_ || starts_with_result_ == true);
    auto silence = code_comes ? std::chrono::milliseconds{drain_wait} : drain_silence;
    return std::min(std::max(last_heard_, drain_end_ - drain_limit) + silence, drain_end_);
}

// Silence ends it. Whole pairs that come before the next message are of the stream still.
void CaenDriver::drained(Now now) {
    if (framer_.pending() > 0) framer_.drop();
    count_tally();
    if (silent_stream_ && !stream_result_)
        look_after_silent_stream(now);
    else if (!stream_result_)
        ends_with_result_ = false;
    stream_over(now, {});
}

}  // namespace gantry::caen
