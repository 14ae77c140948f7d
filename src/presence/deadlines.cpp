#include "presence/deadlines.hpp"

#include <algorithm>

namespace gantry::presence {

static bool earlier(const Deadlines::Entry& a, const Deadlines::Entry& b) {
    return a.due != b.due ? a.due < b.due : a.index < b.index;
}

void Deadlines::set(std::uint32_t index, Steady due) {
    if (index >= place_.size()) place_.resize(std::max<std::size_t>(index + 1u, place_.size() * 2), none);
    Entry entry{due, index};
    auto at = static_cast<std::size_t>(place_[index]);
    if (place_[index] == none) {
        heap_.push_back(entry);
        up(heap_.size() - 1, entry);
    } else if (earlier(entry, heap_[at])) {
        up(at, entry);
    } else {
        down(at, entry);
    }
}

void Deadlines::erase(std::uint32_t index) {
    if (index >= place_.size() || place_[index] == none) return;
    std::size_t at = place_[index];
    place_[index] = none;
    auto last = heap_.back();
    heap_.pop_back();
    if (at == heap_.size()) return;  // it was the last one itself
    if (at > 0 && earlier(last, heap_[(at - 1) / 4]))
        up(at, last);
    else
        down(at, last);
}

void Deadlines::put(std::size_t at, Entry entry) {
    heap_[at] = entry;
    place_[entry.index] = static_cast<std::uint32_t>(at);
}

void Deadlines::up(std::size_t at, Entry entry) {
    while (at > 0) {
        auto parent = (at - 1) / 4;
        if (!earlier(entry, heap_[parent])) break;
        put(at, heap_[parent]);
        at = parent;
    }
    put(at, entry);
}

void Deadlines::down(std::size_t at, Entry entry) {
    for (;;) {
        auto child = at * 4 + 1;
        if (child >= heap_.size()) break;
        auto least = child;
        for (auto other = child + 1; other < std::min(child + 4, heap_.size()); ++other)
            if (earlier(heap_[other], heap_[least])) least = other;
        if (!earlier(heap_[least], entry)) break;
        put(at, heap_[least]);
        at = least;
    }
    put(at, entry);
}

}  // namespace gantry::presence
