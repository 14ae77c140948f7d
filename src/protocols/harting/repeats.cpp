#include "protocols/harting/repeats.hpp"

#include "wire/cursor.hpp"

namespace gantry::harting {

void Repeats::know(ByteView mark, bool unreadable) {
    last_.reset();
    uncertain_ = true;
    answered_ = false;
    unreadable_ = unreadable;
    if (mark.size() < 2) return;
    auto digest = Digest::from_mark(mark.subspan(2));
    if (!digest) {
        unreadable_ = true;
        return;
    }
    wire::Reader in(mark);
    last_ = Last{.digest = *digest, .count = in.u16("count")};
}

Bytes Repeats::took(ByteView sets, std::size_t count) {
    answered_ = uncertain_ = unreadable_ = false;
    last_ = Last{.digest = Digest::of(sets), .count = static_cast<std::uint16_t>(count)};
    Bytes mark;
    wire::Writer writer(mark);
    writer.u16(last_->count);
    writer.bytes(last_->digest.mark());
    return mark;
}

Repeats::Judgement Repeats::judge(ByteView sets, std::size_t count, bool timed) const {
    if (unreadable_) return {.possible = true};
    if (!last_) return {};
    std::size_t size = last_->digest.size;
    if (size == 0 || size > sets.size() || last_->count > count) return {};
    if (!(Digest::of(sets.first(size)) == last_->digest)) return {};
    // Equal sets without a time are the old ones only while nobody has asked the reader to forget them.
    if (!timed && uncertain_) return {.possible = true};
    if (!timed && answered_) return {};
    return {.known_bytes = size, .known_sets = last_->count};
}

}  // namespace gantry::harting
