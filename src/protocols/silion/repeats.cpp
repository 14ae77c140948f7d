#include "protocols/silion/repeats.hpp"

#include <algorithm>

namespace gantry::silion {

// A reader repeats after its wait, 5 s to 60 s by its configuration (section 8). It may be a little early by
// our clock, because the frame before it may have been late.
Repeats::Repeats(std::chrono::microseconds ack_wait, bool line)
    : earliest_(ack_wait * 9 / 10),
      latest_(std::max<std::chrono::microseconds>(60s, ack_wait) + 1s),
      at_start_(line ? std::max<std::chrono::microseconds>(10s, ack_wait + 1s) : 10s) {}

void Repeats::know(ByteView mark, bool unreadable) {
    known_ = Digest::from_mark(mark);
    unreadable_ = unreadable || (!mark.empty() && !known_);
    mark_stored_ = unreadable_ || known_;
}

void Repeats::resumed(Steady held, Steady now) {
    earliest_answer_ = now;
    if (now - held >= earliest_) piled_up_ = now;
}

Repeats::Judgement Repeats::judge(const Digest& frame, Steady now) {
    bool first = std::exchange(first_tags_, false);
    // Its predecessor is not safe yet: the one acknowledgement that will follow answers both.
    for (auto& waiting : waiting_)
        if (waiting.frame == frame) {
            waiting.arrived = now;
            return {Verdict::repeat, false};
        }
    if (last_ && last_->alone && last_->frame == frame && waiting_.empty()) {
        if (piled_up_ && now - *piled_up_ < 1s) {
            last_->arrived = now;
            return {Verdict::repeat, false};
        }
        auto since = now - last_->arrived;
        if (since >= earliest_ && since <= latest_) {
            last_->arrived = now;
            // An acknowledgement that went out just now is still on its way. A second one would acknowledge
            // the reader's next frame before that is safe. If the first was lost, the reader asks again.
            bool lost = now - last_->acknowledged >= 1s;
            if (lost) last_->acknowledged = now;
            return {Verdict::repeat, lost};
        }
    }
    if (first && unreadable_) return {Verdict::undecided, false};
    if (!first || !known_ || *known_ != frame) return {};
    // A reader sends what was not acknowledged first on its new connection, or when its wait on the line is
    // over. Later the frame may as well be a new batch of the same tags.
    if (now - started_ > at_start_) return {Verdict::undecided, false};
    last_ = Last{frame, now, std::max(now, earliest_answer_)};
    return {Verdict::repeat, true};
}

void Repeats::not_alone() {
    if (last_) last_->alone = false;
    for (auto& waiting : waiting_)
        waiting.alone = false;
}

void Repeats::took(const Digest& frame, Ticket ticket, Steady now) {
    not_alone();
    waiting_.push_back({frame, ticket, now});
    mark_stored_ = true;  // the report carries this frame's mark, which replaces what is stored
    clear_due_ = false;
}

void Repeats::other_upload(bool tags) {
    not_alone();
    bool first = tags && std::exchange(first_tags_, false);
    // A first tag frame that asks for nothing shows, too, that the reader waits for no acknowledgement.
    bool arrived = waiting_.empty() && (last_ || first);
    if (arrived && mark_stored_) clear_due_ = true;
}

std::size_t Repeats::committed(Ticket ticket, Steady now) {
    std::size_t acknowledgements = 0;
    while (!waiting_.empty() && waiting_.front().ticket <= ticket) {
        auto& waiting = waiting_.front();
        last_ = Last{waiting.frame, waiting.arrived, now, waiting.alone};
        waiting_.pop_front();
        ++acknowledgements;
    }
    return acknowledgements;
}

bool Repeats::take_clear() {
    if (!std::exchange(clear_due_, false)) return false;
    mark_stored_ = false;
    return true;
}

}  // namespace gantry::silion
