#include "protocols/silion/driver.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/silion/walker.hpp"

namespace gantry::silion {

static CrcRule crc_rule(std::string_view choice) {
    if (choice == "modbus-swapped") return CrcRule::only(CrcKind::modbus_swapped);
    if (choice == "ccitt") return CrcRule::only(CrcKind::ccitt);
    if (choice == "auto") return CrcRule::any();
    if (choice == "off") return CrcRule::unchecked();
    return CrcRule::only(CrcKind::modbus);
}

SilionDriver::SilionDriver(const Settings& settings, LinkKind link)
    : on_line_(link == LinkKind::serial),
      heartbeat_(settings.duration("heartbeat")),
      identify_within_(settings.duration("identify_within")),
      framer_(wire::Direction::to_host, crc_rule(settings.text("crc"))),
      repeats_(settings.duration("ack_wait"), on_line_),
      commands_(
          [this](Code code, ByteView data) {
              auto flags = flag_answer | (reader_uses_crc_ ? flag_crc : 0);
              append_to_reader(out(), static_cast<std::uint8_t>(code), static_cast<std::uint8_t>(flags), data,
                               framer_.crc().kind());
          },
          [this](JobId job, JobResult result) {
              signals_.emplace_back(JobEnded{job, std::move(result)});
          }) {}

void SilionDriver::start(Now now) {
    started_ = last_heard_ = now.steady;
    repeats_.start(now.steady);
}

void SilionDriver::finish(std::string reason) {
    if (finished_) return;
    finished_ = true;
    finish_reason_ = std::move(reason);
}

// --- input -------------------------------------------------------------------------------------------------

void SilionDriver::received(ByteView bytes, Now now) {
    if (finished_) return;
    count(Count::bytes, bytes.size());
    if (!identified_ && first_bytes_.size() < 32)
        first_bytes_.insert(
            first_bytes_.end(), bytes.begin(),
            bytes.begin() + static_cast<std::ptrdiff_t>(std::min(bytes.size(), 32 - first_bytes_.size())));
    framer_.give(bytes);
    take_frames(now);
    if (!framer_.settle() && !finished_)
        finish(holding() ? "the reader sent too much before it was let in" : "the frame buffer overflowed");
    watch_gap(now);
}

// A byte that a line has lost leaves a frame that waits for it and takes those that follow for its own.
void SilionDriver::watch_gap(Now now) {
    gap_at_.reset();
    if (on_line_ && !framer_.kept().empty()) gap_at_ = now.steady + character_gap;
}

void SilionDriver::take_frames(Now now) {
    while (!finished_ && !holding()) {
        auto frame = framer_.next();
        check_stream();
        if (!frame || finished_) break;
        if (!identify(*frame)) {
            framer_.put_back();
            held_ = now;
            break;
        }
        if (!finished_) on_frame(*frame, now);
    }
    flush();
}

// The name in the first frame says who this is. False: the frame must wait for admitted().
bool SilionDriver::identify(const Frame& frame) {
    if (!identified_) {
        identified_ = true;
        name_ = as_text(frame.name);
        framer_.expect_name(name_);
        first_bytes_ = {};
        if (!on_line_) signals_.emplace_back(Identified{name_});
        return admitted_;
    }
    // Gen 2 leaves its name out of some answers (section 2); any other name is another reader's.
    if (!frame.name.empty() && as_text(frame.name) != name_)
        finish(fmt::format("the reader changed its name from \"{}\" to \"{}\"", printable(name_),
                           printable(as_text(frame.name))));
    return true;
}

// Moves the framer's tally into the counters, and gives up on a stream that makes no sense.
void SilionDriver::check_stream() {
    auto& tally = framer_.tally();
    count(Count::frames, tally.frames - counted_.frames);
    count(Count::skipped_bytes, tally.skipped - counted_.skipped);
    count(Count::resyncs, tally.resyncs - counted_.resyncs);
    count(Count::bad_checksum, tally.bad_checksum - counted_.bad_checksum);
    count(Count::bad_length, tally.bad_length - counted_.bad_length);
    counted_ = tally;
    auto skipped = framer_.astray();
    if (!identified_ && skipped > max_skipped_unknown)
        finish(fmt::format("no Silion reader: the connection began with \"{}\"",
                           printable(as_text(first_bytes_))));
    else if (skipped > max_skipped)
        finish(fmt::format("{} bytes without a frame", skipped));
    else if (framer_.trouble() >= max_trouble)
        finish(
            fmt::format("lost step with the reader {} times: {} of its bytes made no sense, {} checksums "
                        "were wrong",
                        framer_.trouble(), tally.skipped, tally.bad_checksum));
}

void SilionDriver::on_frame(const Frame& frame, Now now) {
    last_heard_ = now.steady;
    reader_uses_crc_ = frame.has_crc();
    if (frame.row == nullptr || frame.is(Code::time_request)) {
        count(Count::unknown_code);
        // Answers have the codes from 0x10 on; what is below is an upload, which a waiting reader does not
        // send.
        if (frame.code < 0x10) repeats_.other_upload(false);
        return;
    }
    switch (frame.row->code) {
        case Code::tags:
        case Code::first_seen:
            on_tags(frame, now);
            break;
        case Code::inputs:
            repeats_.other_upload(false);
            on_inputs(frame, now);
            break;
        case Code::heartbeat:
            repeats_.other_upload(false);
            on_heartbeat(frame, now);
            break;
        case Code::fault: {
            repeats_.other_upload(false);
            bool zeros = std::ranges::all_of(frame.data, [](auto byte) { return byte == 0; });
            on_status(frame, zeros ? std::string_view{} : as_text(frame.data), now);
            break;
        }
        case Code::get_inputs:
        case Code::set_outputs:
        case Code::restart:
            commands_.answered(frame.row->code, frame.status, frame.data, now);
            break;
        case Code::time_request:
            break;
    }
}

void SilionDriver::on_tags(const Frame& frame, Now now) {
    std::optional<Digest> digest;  // only a frame that asks for an acknowledgement is ever repeated
    bool undecided = false;
    if (frame.wants_answer()) {
        digest = Digest::of(frame.bytes);
        auto judgement = repeats_.judge(*digest, now.steady);
        if (judgement.verdict == Repeats::Verdict::repeat) {
            count(Count::repeats);
            if (judgement.acknowledge) acknowledge(1);
            return;
        }
        undecided = judgement.verdict == Repeats::Verdict::undecided;
    } else {
        repeats_.other_upload(true);
    }
    // Observations stand before notices in a report, and one that may repeat stands alone.
    if (undecided || (open_ && !open_->notices.empty())) flush();
    auto& to = report(now);
    auto walked = walk_tags(frame.data, frame.data_offset(), to.observations, to.data);
    count(Count::reads, walked.reads);
    if (walked.fault || walked.unusable > 0) {
        // Section 5: what can be told is delivered, the bytes are kept, and then the frame is acknowledged
        // like any other; the reader would repeat it for ever.
        count(Count::malformed);
        auto text = walked.fault ? fmt::format("malformed tag frame: {}", walked.fault->text())
                                 : fmt::format("{} tags with an empty or too long EPC", walked.unusable);
        notice(FaultNotice{fault_malformed, std::move(text), Bytes(frame.bytes.begin(), frame.bytes.end())},
               now);
    }
    if (digest) {
        repeats_.took(*digest, to.ticket, now.steady);
        to.mark = digest->mark();
    }
    to.possible_repeat = undecided;
    if (undecided) flush();
}

void SilionDriver::on_inputs(const Frame& frame, Now now) {
    if (frame.data.empty() || frame.data.size() < 1 + 2 * std::size_t{frame.data[0]}) {
        count(Count::malformed);
        return;
    }
    for (std::size_t i = 0; i < frame.data[0]; ++i) {
        auto number = frame.data[1 + 2 * i];
        bool state = frame.data[2 + 2 * i] != 0;
        if (inputs_[number] == state) continue;
        inputs_[number] = state;
        notice(InputNotice{number, state}, now);
    }
}

void SilionDriver::on_heartbeat(const Frame& frame, Now now) {
    on_status(frame, {}, now);
    wire::Reader in(frame.data);
    auto board = in.u8("MainBoard");
    auto module = in.u8("Module");
    auto version = in.bytes(4, "Software");
    auto antennas = in.bytes(in.u8("Antennas"), "Antennas");
    auto beats = in.u32("Count");
    if (in.fault()) {
        count(Count::malformed);
        return;
    }
    auto* model = modules.find(module);
    auto* main_board = main_boards.find(board);
    Described described;
    described.model = model != nullptr ? std::string(model->name) : fmt::format("module type {}", module);
    described.firmware = fmt::format("{}.{}.{}.{}", version[0], version[1], version[2], version[3]);
    described.detail = fmt::format(
        "main board {}", main_board != nullptr ? std::string(main_board->name) : fmt::format("{}", board));
    if (!antennas.empty()) described.detail += fmt::format(", antennas {}", fmt::join(antennas, " "));
    if (described.model != described_.model || described.firmware != described_.firmware ||
        described.detail != described_.detail) {
        described_ = described;
        signals_.emplace_back(std::move(described));
    }
    if (heartbeat_count_ && beats < *heartbeat_count_) {
        inputs_ = {};  // the next upload tells all of them anew
        notice(
            FaultNotice{fault_restarted,
                        fmt::format("the reader restarted: its heartbeat count fell from {} to {}; tags that "
                                    "it had not sent are lost",
                                    *heartbeat_count_, beats),
                        {}},
            now);
    }
    heartbeat_count_ = beats;
    // The acknowledgement has arrived: a later equal frame is new. Reports with tags of their own carry this
    // too; here a report for it alone is made.
    if (repeats_.clear_due()) report(now);
}

// A fault is told once per change of state; heartbeats only repeat it (section 6).
void SilionDriver::on_status(const Frame& frame, std::string_view words, Now now) {
    auto status = describe_status(frame.status);
    if (words == status.text) words = {};  // they add nothing to the number
    bool same_words = words.empty() || words == status_words_;
    if (frame.status == status_ && same_words) return;
    if (frame.status != status_) status_words_.clear();
    status_ = frame.status;
    if (!words.empty()) status_words_ = words;
    notice(FaultNotice{status.code,
                       words.empty() ? status.text : fmt::format("{}: {}", status.text, printable(words)),
                       {}},
           now);
}

// --- reports -----------------------------------------------------------------------------------------------

Report& SilionDriver::report(Now now) {
    if (!open_) {
        open_.emplace();
        open_->ticket = ++issued_;
        open_->received = now;
    }
    return *open_;
}

void SilionDriver::flush() {
    if (!open_) return;
    auto ready = std::exchange(open_, {});
    if (repeats_.take_clear()) ready->mark = Bytes{};
    if (ready->observations.empty() && ready->notices.empty() && !ready->mark) {
        --issued_;  // a frame without tags, and nobody waits for it
        return;
    }
    reports_.push_back(std::move(*ready));
}

void SilionDriver::acknowledge(std::size_t times) {
    for (; times > 0; --times) {
        append_to_reader(out(), static_cast<std::uint8_t>(Code::tags),
                         reader_uses_crc_ ? flag_crc : std::uint8_t{0}, {}, framer_.crc().kind());
        count(Count::acknowledged);
    }
}

void SilionDriver::committed(Ticket ticket, Now now) {
    bool was_stalled = stalled();
    committed_ = std::max(committed_, std::min(ticket, issued_));
    auto due = repeats_.committed(committed_, now.steady);
    if (!finished_) acknowledge(due);
    if (!was_stalled || stalled()) return;
    last_heard_ = now.steady;  // it could not be heard until now
    watch_gap(now);
}

void SilionDriver::admitted(const Known& known, Now now) {
    repeats_.know(known.mark, known.mark_unreadable);
    if (identified_) repeats_.resumed(held_.steady, now.steady);
    admitted_ = true;
    last_heard_ = now.steady;
    commands_.allow(now);
    if (identified_) take_frames(held_);
    last_heard_ = now.steady;
}

// --- jobs and time -----------------------------------------------------------------------------------------

void SilionDriver::run(const JobOrder& order, const Job& job, Now now) {
    if (finished_) {
        signals_.emplace_back(JobEnded{order.id,
                                       {.status = JobResult::Status::cancelled,
                                        .text = "never sent: the link is ending",
                                        .values = {}}});
        return;
    }
    commands_.run(order, job, now);
}

void SilionDriver::cancel(JobId id, Now now) {
    commands_.cancel(id, now);
}

void SilionDriver::link_lost(Now) {
    finish(first_bytes_.empty() ? std::string{}
                                : fmt::format("no Silion frame: the connection began with \"{}\"",
                                              printable(as_text(first_bytes_))));
    drop_output();
    commands_.link_lost();
}

Steady SilionDriver::silent_at() const {
    return std::max(last_heard_, commands_.silent_until()) + 3 * heartbeat_;
}

std::optional<Steady> SilionDriver::deadline() const {
    if (finished_) return {};
    auto due = commands_.deadline();
    auto sooner = [&](Steady at) { due = due ? std::min(*due, at) : at; };
    if (!identified_) sooner(started_ + identify_within_);
    if (silence_counts()) sooner(silent_at());
    if (gap_at_ && !stalled()) sooner(*gap_at_);
    return due;
}

void SilionDriver::time_passed(Now now) {
    if (finished_) return;
    auto before = commands_.timeouts();
    commands_.time_passed(now);
    count(Count::timeouts, commands_.timeouts() - before);
    if (gap_at_ && !stalled() && now.steady >= *gap_at_) {
        framer_.give_up();
        take_frames(now);
        watch_gap(now);
    }
    if (!identified_ && now.steady >= started_ + identify_within_) {
        finish(first_bytes_.empty()
                   ? fmt::format("the peer said nothing for {}", approximate(identify_within_))
                   : fmt::format("no Silion frame within {}: the connection began with \"{}\"",
                                 approximate(identify_within_), printable(as_text(first_bytes_))));
    } else if (silence_counts() && now.steady >= silent_at()) {
        finish(fmt::format("no frame for {}, three heartbeat periods", approximate(3 * heartbeat_)));
    }
}

}  // namespace gantry::silion
