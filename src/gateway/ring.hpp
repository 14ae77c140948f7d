#pragma once
#include <atomic>
#include <bit>
#include <cstddef>
#include <memory>
#include <utility>

namespace gantry::gateway {

// A bounded queue from one thread to another, without locks. Bounded twice: by places and by weight (bytes,
// say), so that a few huge items cannot take the memory of many small ones. An item heavier than the whole
// bound still passes when the queue is empty.
template <class T>
class Ring {
public:
    Ring(std::size_t places, std::size_t max_weight)
        : size_(std::bit_ceil(places)), max_weight_(max_weight), slots_(std::make_unique<Slot[]>(size_)) {}

    // The producing thread. On false the item is untouched.
    bool push(T& item, std::size_t weight) {
        auto tail = tail_.load(std::memory_order_relaxed);
        if (tail - head_.load(std::memory_order_acquire) == size_) return false;
        auto held = weight_.load(std::memory_order_relaxed);
        if (held != 0 && held + weight > max_weight_) return false;
        auto& slot = slots_[tail & (size_ - 1)];
        slot.item = std::move(item);
        slot.weight = weight;
        weight_.fetch_add(weight, std::memory_order_relaxed);
        tail_.store(tail + 1, std::memory_order_seq_cst);  // seq_cst: see Writer's sleep
        return true;
    }

    // The consuming thread.
    bool pop(T& item) {
        auto head = head_.load(std::memory_order_relaxed);
        if (head == tail_.load(std::memory_order_acquire)) return false;
        auto& slot = slots_[head & (size_ - 1)];
        item = std::move(slot.item);
        weight_.fetch_sub(slot.weight, std::memory_order_relaxed);
        head_.store(head + 1, std::memory_order_release);
        return true;
    }

    bool empty() const {
        return head_.load(std::memory_order_seq_cst) == tail_.load(std::memory_order_seq_cst);
    }

private:
    struct Slot {
        T item{};
        std::size_t weight = 0;
    };
    const std::size_t size_;
    const std::size_t max_weight_;
    std::unique_ptr<Slot[]> slots_;
    alignas(64) std::atomic<std::size_t> head_{0};
    alignas(64) std::atomic<std::size_t> tail_{0};
    alignas(64) std::atomic<std::size_t> weight_{0};
};

}  // namespace gantry::gateway
