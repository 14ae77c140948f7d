#include "protocols/harting/device_buffer.hpp"

#include <algorithm>

#include "protocols/harting/device_config.hpp"
#include "wire/cursor.hpp"

namespace gantry::harting {

bool DataBuffer::add(Set set) {
    if (sets_.size() >= capacity_) {
        overflow();
        return false;
    }
    sets_.push_back(std::move(set));
    ++tally_.stored;
    return true;
}

void DataBuffer::overflow() {
    overflowed_ = true;
    ++tally_.overflowed;
}

void DataBuffer::overflow_and_tell() {
    overflow();
    to_tell_ = true;
}

void DataBuffer::told() {
    to_tell_ = false;
}

void DataBuffer::was_sent(std::size_t sets) {
    if (sets <= sent_) return;
    tally_.sent += sets - sent_;
    sent_ = sets;
}

void DataBuffer::clear(std::size_t sets) {
    sets = std::min(sets, sets_.size());
    sets_.erase(sets_.begin(), sets_.begin() + static_cast<std::ptrdiff_t>(sets));
    sent_ -= std::min(sent_, sets);
    first_ = (first_ + sets) % capacity_;
    tally_.cleared += sets;
    overflowed_ = to_tell_;
}

void DataBuffer::forget(std::size_t sets) {
    auto before = tally_.cleared;
    clear(sets);
    tally_.unasked += tally_.cleared - before;
}

void DataBuffer::initialize() {
    tally_.initialized += sets_.size();
    sets_.clear();
    sent_ = first_ = 0;
    overflowed_ = to_tell_ = false;
}

void DataBuffer::power_down() {
    tally_.lost_at_reset += sets_.size();
    sets_.clear();
    sent_ = first_ = 0;
    overflowed_ = to_tell_ = false;
}

std::size_t append_sets(const DataBuffer& buffer, std::size_t most, bool apart, std::size_t room,
                        const Setup& setup, ByteView mac, Bytes& out) {
    auto start = out.size();
    append_buffer_head(setup.tr1, setup.tr2, 0, out);
    auto head = out.size();
    most = std::min({most, buffer.size(), std::size_t{0xFFFF}});
    std::size_t count = 0;
    for (; count < most; ++count) {
        if (apart && buffer[count].is_event != buffer[0].is_event) break;
        auto before = out.size();
        append_record(buffer[count].record, setup.tr1, setup.tr2, mac, out);
        if (out.size() - start <= room || count == 0) continue;
        out.resize(before);
        break;
    }
    wire::Writer(out).patch_big_endian(head - 2, count, 2);  // DATA-SETS ends the head
    return count;
}

}  // namespace gantry::harting
