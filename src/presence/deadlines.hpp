#pragma once
#include <cstdint>
#include <vector>

#include "base/time.hpp"

namespace gantry::presence {

inline constexpr Steady never = Steady::max();

// A heap of deadlines, at most one for each small number; the earliest is on top, of equal ones the smaller
// number. Four children a node: half as deep as two, and the children share a cache line.
class Deadlines {
public:
    struct Entry {
        Steady due{};
        std::uint32_t index = 0;
    };

    bool empty() const { return heap_.empty(); }
    const Entry& top() const { return heap_.front(); }            // not when empty
    Steady first() const { return empty() ? never : top().due; }  // never: empty
    void set(std::uint32_t index, Steady due);                    // adds it or moves it
    void erase(std::uint32_t index);                              // nothing when it has none

private:
    static constexpr std::uint32_t none = 0xFFFF'FFFF;
    void up(std::size_t at, Entry entry);
    void down(std::size_t at, Entry entry);
    void put(std::size_t at, Entry entry);

    std::vector<Entry> heap_;
    std::vector<std::uint32_t> place_;  // by index: where in the heap
};

}  // namespace gantry::presence
