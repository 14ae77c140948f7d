#include "presence/records.hpp"

namespace gantry::presence {

Records::Records() : by_tag_(0, Hash{this}, Equal{this}) {}

RecordIndex Records::first_of(const event::TagId& tag) const {
    auto found = by_tag_.find(tag);
    return found == by_tag_.end() ? no_record : *found;
}

RecordIndex Records::with_id(std::uint64_t id) const {
    auto found = by_id_.find(id);
    return found == by_id_.end() ? no_record : found->second;
}

RecordIndex Records::add(const Record& record) {
    if (unused_.empty()) {
        auto start = static_cast<RecordIndex>(chunks_.size() * chunk_size);
        chunks_.push_back(std::make_unique<Slot[]>(chunk_size));
        marks_.resize(chunks_.size() * chunk_size / 64);
        for (auto at = start + static_cast<RecordIndex>(chunk_size); at-- > start;)
            unused_.push_back(at);
    }
    auto at = unused_.back();
    unused_.pop_back();
    auto& slot = (*this)[at];
    slot = Slot{};
    slot.record = record;
    by_id_.emplace(record.id, at);
    auto first = first_of(record.tag);
    if (first == no_record) {
        by_tag_.insert(at);
    } else {
        slot.next = (*this)[first].next;
        (*this)[first].next = at;
    }
    return at;
}

void Records::remove(RecordIndex at) {
    auto& slot = (*this)[at];
    auto found = by_tag_.find(slot.record.tag);
    if (*found != at) {
        auto before = *found;
        while ((*this)[before].next != at)
            before = (*this)[before].next;
        (*this)[before].next = slot.next;
    } else {
        by_tag_.erase(found);
        if (slot.next != no_record) by_tag_.insert(slot.next);
    }
    by_id_.erase(slot.record.id);
    unmark(at);
    unused_.push_back(at);
}

void Records::lost(RecordIndex at) {
    auto& slot = (*this)[at];
    slot.lost_before = lost_last_;
    slot.lost_after = no_record;
    (lost_last_ == no_record ? lost_first_ : (*this)[lost_last_].lost_after) = at;
    lost_last_ = at;
}

void Records::found(RecordIndex at) {
    auto& slot = (*this)[at];
    (slot.lost_before == no_record ? lost_first_ : (*this)[slot.lost_before].lost_after) = slot.lost_after;
    (slot.lost_after == no_record ? lost_last_ : (*this)[slot.lost_after].lost_before) = slot.lost_before;
}

}  // namespace gantry::presence
