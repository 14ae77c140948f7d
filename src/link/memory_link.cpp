#include "link/memory_link.hpp"

#include <algorithm>

namespace gantry::link {

MemoryLink::MemoryLink(Party& a, Party& b, Now start) : a_(a), b_(b), now_(start) {}

void MemoryLink::connect() {
    connected_ = true;
    a_.start(now_);
    b_.start(now_);
    if (after_turn) after_turn();
    exchange();
}

std::optional<Steady> MemoryLink::next_deadline() const {
    auto a = a_.deadline(), b = b_.deadline();
    return a && b ? std::min(*a, *b) : a ? a : b;
}

void MemoryLink::deliver(Party& from, Party& to) {
    Bytes bytes(from.output().begin(), from.output().end());
    from.output_sent(bytes.size());
    if (!connected_ || (drop && drop(bytes, &from == &a_))) return;
    std::size_t step = piece == 0 ? bytes.size() : piece;
    for (ByteView left(bytes); !left.empty(); left = left.subspan(std::min(step, left.size()))) {
        to.received(left.first(std::min(step, left.size())), now_);
        if (after_turn) after_turn();
    }
}

void MemoryLink::exchange() {
    while ((!a_.output().empty() && b_.wants_input()) || (!b_.output().empty() && a_.wants_input())) {
        if (!a_.output().empty() && b_.wants_input()) deliver(a_, b_);
        if (!b_.output().empty() && a_.wants_input()) deliver(b_, a_);
    }
}

void MemoryLink::run_for(std::chrono::microseconds duration) {
    auto end = now_.steady + duration;
    exchange();
    while (!(connected_ && (a_.finished() || b_.finished()))) {
        auto next = next_deadline();
        if (!next || *next > end) break;
        now_ =
            now_ + std::chrono::ceil<std::chrono::microseconds>(std::max(*next, now_.steady) - now_.steady);
        a_.time_passed(now_);
        b_.time_passed(now_);
        if (after_turn) after_turn();
        exchange();
    }
    if (now_.steady < end) now_ = now_ + std::chrono::ceil<std::chrono::microseconds>(end - now_.steady);
}

}  // namespace gantry::link
