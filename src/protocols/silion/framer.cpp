#include "protocols/silion/framer.hpp"

#include <algorithm>

namespace gantry::silion {

void Framer::drop(std::size_t size) {
    if (start_ == kept_.size()) {
        in_ = in_.subspan(size);
        return;
    }
    start_ += size;  // never beyond kept_: all that was looked at lies in it
    if (start_ < kept_.size()) return;
    kept_.clear();
    start_ = 0;
    if (kept_.capacity() > 4096) kept_.shrink_to_fit();  // ten thousand idle readers are to be cheap
}

void Framer::skip(const Look& look) {
    if (in_step_) {
        in_step_ = false;
        ++tally_.resyncs;
        ++trouble_;
        good_ = 0;
        if (look.why == wire::Errc::bad_length) ++tally_.bad_length;
        if (look.why == wire::Errc::bad_checksum) ++tally_.bad_checksum;
    } else if (look.why == wire::Errc::bad_checksum) {
        ++tally_.bad_checksum;
        ++trouble_;  // each costs a CRC over a whole frame, so a peer gets few of them
    }
    tally_.skipped += look.size;
    astray_ += look.size;
    drop(look.size);
}

std::optional<Frame> Framer::next() {
    if (taken_ > 0) {
        // Counted when it is left behind, so that a frame put back is not counted twice.
        ++tally_.frames;
        tally_.frame_bytes += taken_;
        in_step_ = true;
        astray_ = 0;
        if (++good_ >= forgiven_after) trouble_ = 0;
        drop(std::exchange(taken_, 0));
    }
    for (;;) {
        bool from_kept = start_ < kept_.size();
        auto front = from_kept ? kept() : in_;
        if (front.empty()) return {};
        auto look = look_at(front, direction_, crc_, {name_, in_step_});
        switch (look.what) {
            case Look::What::frame:
                if (look.frame.has_crc()) crc_.learn(look.frame.covered(), look.frame.crc());
                taken_ = look.size;
                return look.frame;
            case Look::What::wrong:
                skip(look);
                break;
            case Look::What::more: {
                // Only what completes this frame is copied; what follows is looked at where it lies.
                auto wanted = from_kept ? look.size - front.size() : in_.size();
                auto size = std::min(wanted, in_.size());
                if (size == 0) return {};
                if (start_ > 0) {
                    kept_.erase(kept_.begin(), kept_.begin() + static_cast<std::ptrdiff_t>(start_));
                    start_ = 0;
                }
                kept_.insert(kept_.end(), in_.begin(), in_.begin() + static_cast<std::ptrdiff_t>(size));
                in_ = in_.subspan(size);
                if (!from_kept) return {};
                break;
            }
        }
    }
}

void Framer::give_up() {
    auto left = kept();
    if (left.empty()) return;
    Look look;
    look.what = Look::What::wrong;
    look.size = find_start(left, 1, direction_, name_);
    look.why = wire::Errc::bad_length;
    skip(look);
}

bool Framer::settle() {
    if (!in_.empty()) {
        kept_.insert(kept_.end(), in_.begin(), in_.end());
        in_ = {};
    }
    return kept().size() <= max_kept;
}

}  // namespace gantry::silion
