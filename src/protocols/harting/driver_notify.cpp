#include "protocols/harting/driver_notify.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::harting {

static constexpr std::size_t kept_of_a_frame = 256, kept_first_bytes = 32;
static constexpr std::chrono::seconds partial_patience{5};  // a frame does not take longer on TCP

// --- what records become -----------------------------------------------------------------------------------

void BufferReports::malformed(std::string text, ByteView frame, Now now) {
    count_(Count::malformed, 1);
    auto passed = malformed_.pass(std::move(text), now);
    if (!passed) return;
    auto some = frame.first(std::min(frame.size(), kept_of_a_frame));
    reports_.notice(FaultNotice{fault_malformed, std::move(*passed), Bytes(some.begin(), some.end())}, now);
}

void BufferReports::overflow(std::uint8_t status, Now now) {
    bool full = status == static_cast<std::uint8_t>(Status::buffer_overflow);
    if (full && !overflowed_) reports_.notice(OverflowNotice{.scope = "reader buffer"}, now);
    overflowed_ = full;
}

BufferReports::Taken BufferReports::take(std::uint8_t status, ByteView data, ByteView frame, Bank block_bank,
                                         Now now) {
    Taken taken;
    std::size_t head = !data.empty() && (data[0] & tr1_extension) != 0 ? 2 : 1;
    if (data.size() < head + 2) {
        malformed("a reply to Read Buffer ends before its number of data sets", frame, now);
        taken.readable = false;
        return taken;
    }
    taken.sets = static_cast<std::size_t>(data[head] << 8 | data[head + 1]);
    auto sets = data.subspan(head + 2);
    bool timed = (data[0] & tr1_timer) != 0;
    auto known = repeats_.judge(sets, taken.sets, timed);
    if (known.known_sets > 0) count_(Count::repeats, 1);
    auto fresh = taken.sets - known.known_sets;
    overflow(status, now);
    if (fresh == 0) return taken;
    reports_.flush();
    auto& report = reports_.open(now);
    report.possible_repeat = known.possible;
    auto walk = data;
    if (known.known_bytes > 0) {  // only what is new behind what we have
        scratch_.assign(data.begin(), data.begin() + static_cast<std::ptrdiff_t>(head));
        wire::Writer(scratch_).u16(fresh);
        wire::Writer(scratch_).bytes(sets.subspan(known.known_bytes));
        walk = scratch_;
    }
    inputs_.clear();
    WalkOptions options{.block_bank = block_bank, .now = now.wall, .utc_offset = {}};
    auto walked = walk_buffer(walk, static_cast<std::size_t>(data.data() - frame.data()), options,
                              report.observations, report.data, inputs_);
    reports_.take_times(report, 0);
    std::uint64_t reads = 0;
    for (auto& each : report.observations)
        reads += each.reads;
    count_(Count::reads, reads);
    take_inputs(inputs_, now);
    if (walked.fault || walked.unusable > 0)
        malformed(walked.fault ? fmt::format("a data set cannot be read: {}", walked.fault->text())
                               : fmt::format("{} data sets have no id that can be used", walked.unusable),
                  frame, now);
    reports_.open(now).mark = repeats_.took(sets, taken.sets);
    taken.new_ones = true;
    reports_.flush();
    taken.ticket = reports_.last_issued();
    return taken;
}

void BufferReports::take_inputs(std::span<const InputEvent> events, Now now) {
    for (auto& event : events)
        for (std::size_t i = 0; i < input_states_.size(); ++i) {
            bool state = (event.inputs >> i & 1) != 0;
            auto& before = input_states_[i];
            // Of an input that was never set before nobody knows whether it exists.
            if (before == state || (!before && !state)) continue;
            before = state;
            reports_.notice(InputNotice{.input = static_cast<std::uint16_t>(i + 1), .state = state}, now);
        }
}

void BufferReports::flags(ByteView flags_a_b, Now now) {
    auto flags = static_cast<std::uint16_t>(flags_a_b[0] << 8 | flags_a_b[1]);
    auto fresh = static_cast<std::uint16_t>(flags & ~flags_);
    flags_ = flags;
    struct Words {
        std::uint16_t bit;
        std::string_view text;
    };
    // Section 5, FLAGS-A in the upper half.
    static constexpr std::array<Words, 10> words = {{{0x0100, "the radio hardware is at fault"},
                                                     {0x0200, "noise on the channel"},
                                                     {0x1000, "the power is wrong"},
                                                     {0x2000, "it is getting too hot"},
                                                     {0x4000, "synchronisation timed out"},
                                                     {0x8000, "it is too hot"},
                                                     {0x0001, "antenna 1 is missing or broken"},
                                                     {0x0002, "antenna 2 is missing or broken"},
                                                     {0x0004, "antenna 3 is missing or broken"},
                                                     {0x0008, "antenna 4 is missing or broken"}}};
    for (auto& each : words)
        if ((fresh & each.bit) != 0)
            reports_.notice(FaultNotice{fault_hardware, std::string(each.text), {}}, now);
    std::uint16_t named = 0;
    for (auto& each : words)
        named = static_cast<std::uint16_t>(named | each.bit);
    if (auto other = static_cast<std::uint16_t>(fresh & ~named); other != 0)
        reports_.notice(FaultNotice{fault_hardware, fmt::format("diagnostic flags 0x{:04X}", other), {}},
                        now);
}

// --- the link ----------------------------------------------------------------------------------------------

void Notifications::start(Now now) {
    framer_.reset();
    drop_output();
    waiting_.reset();
    acknowledged_at_.reset();
    connected_ = true;
    finished_ = heard_ = false;
    trouble_ = 0;
    first_bytes_.clear();
    started_ = last_heard_ = now.steady;
}

void Notifications::link_lost(Now) {
    connected_ = false;
    waiting_.reset();
    drop_output();
    buffer_.link_lost();
}

std::string Notifications::stranger() const {
    if (heard_ || first_bytes_.empty()) return {};
    return fmt::format("no HARTING reader: the connection began with \"{}\"",
                       printable(as_text(first_bytes_)));
}

void Notifications::finish(std::string reason) {
    if (finished_) return;
    finished_ = true;
    finish_reason_ = std::move(reason);
}

void Notifications::received(ByteView bytes, Now now) {
    if (finished_) return;
    count_(Count::bytes, bytes.size());
    if (!heard_ && first_bytes_.size() < kept_first_bytes) {
        auto some = bytes.first(std::min(bytes.size(), kept_first_bytes - first_bytes_.size()));
        first_bytes_.insert(first_bytes_.end(), some.begin(), some.end());
    }
    last_heard_ = now.steady;
    framer_.add(bytes);
    take_frames(now);
}

void Notifications::take_frames(Now now) {
    while (!finished_ && !(held_ && heard_) && !reports_.full()) {
        auto frame = framer_.next();
        if (frame && held_) framer_.put_back(*frame);
        count_tally();
        if (framer_.astray() > max_astray || trouble_ >= max_trouble)
            return finish(heard_ ? "its bytes make no sense" : stranger());
        if (!frame) break;
        heard_ = true;
        if (!held_) on_frame(*frame, now);
    }
    reports_.flush();
}

void Notifications::count_tally() {
    auto& tally = framer_.tally();
    if (tally.frames > counted_.frames && trouble_ > 0) --trouble_;
    trouble_ += static_cast<unsigned>(tally.resyncs - counted_.resyncs);
    count_(Count::frames, tally.frames - counted_.frames);
    count_(Count::skipped_bytes, tally.skipped_bytes - counted_.skipped_bytes);
    count_(Count::resyncs, tally.resyncs - counted_.resyncs);
    count_(Count::bad_checksum, tally.bad_checksum - counted_.bad_checksum);
    count_(Count::bad_length, tally.bad_length - counted_.bad_length);
    counted_ = tally;
}

void Notifications::on_frame(const Frame& frame, Now now) {
    if (frame.control == control_of(Command::reader_diagnostic)) return on_keepalive(frame, now);
    // Others are events of newer firmware, or answers to the acknowledgement.
    if (frame.control != control_of(Command::read_buffer)) {
        if (frame.control != control_of(Command::clear_data_buffer)) count_(Count::unknown_code, 1);
        return;
    }
    // What cannot be read is kept as a fault, and goes with it: else it would come for ever.
    bool repeated = false;
    if (!has_data(frame.status) || frame.data.empty()) {
        buffer_.overflow(frame.status, now);
    } else {
        auto taken = buffer_.take(frame.status, frame.data, frame.bytes, block_bank_, now);
        repeated = taken.readable && !taken.new_ones && taken.sets > 0;
    }
    reports_.flush();
    if (!acknowledge_) return buffer_.cleared();
    // A repeat that crossed the acknowledgement on the way: another one would be taken for the next message.
    if (repeated && !waiting_ && acknowledged_at_ && now.steady < *acknowledged_at_ + crossing) return;
    // What came over an earlier link may still be on its way to the disk when it is repeated over this one.
    waiting_ = reports_.last_issued();
    if (reports_.all_committed()) acknowledge(now);
}

void Notifications::on_keepalive(const Frame& frame, Now now) {
    constexpr std::size_t new_head = 5, record = 1 + padded_record;
    if (frame.data.size() == 2) return buffer_.flags(frame.data, now);
    if (frame.data.size() < new_head) return;
    reader_ = to_hex(frame.data.first(4));
    auto records = frame.data.subspan(new_head);
    for (; records.size() >= record; records = records.subspan(record))
        if (records[0] == 0x01) buffer_.flags(records.subspan(1, 2), now);
}

void Notifications::acknowledge(Now now) {
    waiting_.reset();
    acknowledged_at_ = now.steady;
    append_request(out(), com_address_, control_of(Command::clear_data_buffer), {});
    buffer_.answered();
    count_(Count::acknowledged, 1);
}

void Notifications::committed(Ticket ticket, Now now) {
    if (waiting_ && *waiting_ <= ticket && connected_ && !finished_) acknowledge(now);
    if (connected_) take_frames(now);
}

std::optional<Steady> Notifications::deadline() const {
    if (!connected_ || finished_ || reports_.full()) return {};
    std::optional<Steady> due;
    if (framer_.partial() && !held_) due = last_heard_ + partial_patience;
    if (silence_.count() > 0) due = due ? std::min(*due, last_heard_ + silence_) : last_heard_ + silence_;
    return due;
}

void Notifications::time_passed(Now now) {
    if (!connected_ || finished_ || reports_.full()) return;
    if (!held_ && framer_.partial() && now.steady >= last_heard_ + partial_patience) {
        framer_.drop();
        count_tally();
    }
    if (silence_.count() > 0 && now.steady >= last_heard_ + silence_) {
        count_(Count::timeouts, 1);
        finish(fmt::format("no message for {}", approximate(silence_)));
    }
}

}  // namespace gantry::harting
