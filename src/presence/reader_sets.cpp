#include "presence/reader_sets.hpp"

#include <algorithm>
#include <utility>

namespace gantry::presence {

bool ReaderSet::has(ReaderIndex reader) const {
    return std::ranges::binary_search(readers, reader);
}

std::size_t ReaderSets::KeyHash::operator()(const std::vector<std::uint32_t>& key) const noexcept {
    std::uint64_t hash = key.size();
    for (auto word : key) {
        hash = (hash ^ word) * 0x9E37'79B9'7F4A'7C15u;
        hash ^= hash >> 32;
    }
    return hash;
}

ReaderIndex ReaderSets::add_reader() {
    readers_.emplace_back();
    return static_cast<ReaderIndex>(readers_.size() - 1);
}

SetIndex ReaderSets::intern(ZoneIndex zone, std::span<const ReaderIndex> readers, Steady now) {
    key_.assign(readers.begin(), readers.end());
    std::ranges::sort(key_);
    key_.erase(std::unique(key_.begin(), key_.end()), key_.end());
    key_.insert(key_.begin(), zone);
    auto found = by_key_.find(key_);
    if (found != by_key_.end()) return found->second;

    if (sets_.size() - unused_.size() >= sweep_at_) sweep();
    if (unused_.empty()) {
        unused_.push_back(static_cast<SetIndex>(sets_.size()));
        sets_.emplace_back();
    }
    auto index = unused_.back();
    unused_.pop_back();
    auto& set = sets_[index];
    set.zone = zone;
    set.readers.assign(key_.begin() + 1, key_.end());
    set.since = now;
    for (auto reader : set.readers) {
        readers_[reader].sets.push_back(index);
        if (readers_[reader].online) ++set.online;
    }
    by_key_.emplace(key_, index);
    return index;
}

// Forgets the sets that no record needs any more. Not done at once: most are wanted again soon.
void ReaderSets::sweep() {
    for (auto& reader : readers_)
        std::erase_if(reader.sets, [this](SetIndex set) { return sets_[set].members.empty(); });
    for (SetIndex index = 0; index < sets_.size(); ++index) {
        auto& set = sets_[index];
        if (set.readers.empty() || !set.members.empty()) continue;
        key_.assign(set.readers.begin(), set.readers.end());
        key_.insert(key_.begin(), set.zone);
        by_key_.erase(key_);
        set = {};
        unused_.push_back(index);
    }
    sweep_at_ = std::max<std::size_t>(64, 2 * (sets_.size() - unused_.size()));
}

std::span<const SetIndex> ReaderSets::online(ReaderIndex reader, Steady now) {
    changed_.clear();
    if (std::exchange(readers_[reader].online, true)) return changed_;
    for (auto index : readers_[reader].sets) {
        auto& set = sets_[index];
        if (set.online++ > 0) continue;
        set.frozen += std::max(now - set.since, Steady::duration{});
        set.since = std::max(now, set.since);
        changed_.push_back(index);
    }
    return changed_;
}

std::span<const SetIndex> ReaderSets::offline(ReaderIndex reader, Steady now) {
    changed_.clear();
    if (!std::exchange(readers_[reader].online, false)) return changed_;
    for (auto index : readers_[reader].sets) {
        auto& set = sets_[index];
        if (--set.online > 0) continue;
        set.since = std::max(now, set.since);
        changed_.push_back(index);
    }
    return changed_;
}

void ReaderSets::join(SetIndex set, RecordIndex record) {
    if (record >= place_.size()) place_.resize(std::max<std::size_t>(record + 1u, place_.size() * 2));
    place_[record] = static_cast<std::uint32_t>(sets_[set].members.size());
    sets_[set].members.push_back(record);
}

void ReaderSets::leave(SetIndex set, RecordIndex record) {
    unpark(set, record);
    auto& in = sets_[set];
    swap(in, place_[record], in.members.size() - 1);
    in.members.pop_back();
}

void ReaderSets::park(SetIndex set, RecordIndex record) {
    if (is_parked(set, record)) return;
    auto& in = sets_[set];
    swap(in, place_[record], in.parked++);
}

void ReaderSets::unpark(SetIndex set, RecordIndex record) {
    if (!is_parked(set, record)) return;
    auto& in = sets_[set];
    swap(in, place_[record], --in.parked);
}

void ReaderSets::swap(ReaderSet& set, std::size_t a, std::size_t b) {
    std::swap(set.members[a], set.members[b]);
    place_[set.members[a]] = static_cast<std::uint32_t>(a);
    place_[set.members[b]] = static_cast<std::uint32_t>(b);
}

}  // namespace gantry::presence
