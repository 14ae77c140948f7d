#include "presence/presence.hpp"

#include <algorithm>

#include "presence/records.hpp"

namespace gantry::presence {

using std::chrono::microseconds;

static Wall wall_at(Now now, Steady at) {
    return now.wall + std::chrono::floor<microseconds>(at - now.steady);
}

// Longer than any timer is meant to be, and short enough to be added to any time.
static Rules bounded(Rules rules) {
    static constexpr microseconds longest = std::chrono::years{50};
    auto bound = [](microseconds& time) { time = std::clamp(time, microseconds{}, longest); };
    for (auto* time : {&rules.glimpse_timeout, &rules.observe_after, &rules.lose_after, &rules.purge_after})
        bound(*time);
    if (rules.offline_lose_after) bound(*rules.offline_lose_after);
    return rules;
}

static bool seen_enough(const Rules& rules, const Record& record, Steady::duration span) {
    bool by_span = rules.observe_after > 0us, by_reads = rules.observe_after_reads > 0;
    if (!by_span && !by_reads) return true;
    return (by_span && span >= rules.observe_after) ||
           (by_reads && record.reads >= rules.observe_after_reads);
}

// A record has an entry among the deadlines, at or before its true deadline; one that comes up early is put
// where it belongs, so a sighting of a present tag does not touch the heap. A record that was armed while its
// readers were offline, with an entry or without, is parked in its set and armed again when that thaws.
struct Presence::Impl {
    std::size_t max_records;
    std::uint64_t next_id;
    std::vector<Rules> zones;
    ReaderSets sets;
    Records records;
    Deadlines deadlines;      // of records
    Deadlines set_deadlines;  // frozen sets whose records are to be given up (offline_lose_after)
    std::size_t present = 0;
    std::int64_t observed_counter = 0;
    std::vector<Transition> waiting;  // from calls that have no place to put them
    Steady waiting_since{};
    std::vector<std::uint64_t> changed, deleted;

    Impl(std::size_t max, std::uint64_t first_id)
        : max_records(std::clamp<std::size_t>(max, 1, no_record)), next_id(first_id) {}

    const Rules& rules(const Record& record) const { return zones[record.zone]; }

    static void emit(std::vector<Transition>& out, event::Type type, Wall time, const Record& record,
                     std::string_view reason = {}, ZoneIndex from = 0) {
        out.push_back({type, time, record, reason, from});
    }

    void mark_changed(Slot& slot) {
        if (slot.changed) return;
        slot.changed = true;
        changed.push_back(slot.record.id);
    }

    // --- timers ---

    // When what the record is in now ends, as things stand.
    Steady deadline_of(const Slot& slot) const {
        const auto& set = sets[slot.set];
        const auto& rule = rules(slot.record);
        if (!set.is_frozen()) {
            auto after = slot.record.state == State::glimpsed   ? rule.glimpse_timeout
                         : slot.record.state == State::observed ? rule.lose_after
                                                                : rule.purge_after;
            return slot.since + after + (set.frozen - slot.frozen);
        }
        if (slot.record.state == State::lost || !rule.offline_lose_after) return never;
        return std::max(set.since, slot.since) + *rule.offline_lose_after;
    }

    // After a change that may have brought the deadline forward.
    void arm(RecordIndex at) {
        auto& slot = records[at];
        if (sets[slot.set].is_frozen()) sets.park(slot.set, at);
        auto due = deadline_of(slot);
        if (due < slot.queued) deadlines.set(at, slot.queued = due);
    }

    // The same when it may also have gone back.
    void arm_exactly(RecordIndex at) {
        records[at].queued = never;
        if (deadline_of(records[at]) == never) deadlines.erase(at);
        arm(at);
    }

    void start_timer(Slot& slot, Steady now) {
        slot.since = now;
        slot.frozen = sets[slot.set].frozen_until(now);
    }

    // A freeze brings deadlines forward where offline_lose_after is shorter than what runs. One deadline a
    // set keeps that off the records until it is needed; a record that comes later is armed by itself.
    void arm_set(SetIndex at) {
        const auto& set = sets[at];
        const auto& give_up = zones[set.zone].offline_lose_after;
        if (set.is_frozen() && give_up)
            set_deadlines.set(at, set.since + *give_up);
        else
            set_deadlines.erase(at);
    }

    // The next deadline up to `now` falls; false when there is none.
    bool next_due(Now now, std::vector<Transition>& out) {
        auto record_due = deadlines.first(), set_due = set_deadlines.first();
        if (std::min(record_due, set_due) > now.steady) return false;
        if (set_due <= record_due) {
            auto set = set_deadlines.top().index;
            set_deadlines.erase(set);
            auto members = sets[set].members;  // arming moves them about
            for (auto at : members)
                arm(at);
            return true;
        }
        auto at = deadlines.top().index;
        auto due = deadline_of(records[at]);
        if (due > record_due)
            arm_exactly(at);
        else
            expire(at, due, now, out);
        return true;
    }

    // --- the ends of states ---

    void expire(RecordIndex at, Steady due, Now now, std::vector<Transition>& out) {
        auto& slot = records[at];
        auto& record = slot.record;
        std::string_view reason = sets[slot.set].is_frozen() ? "reader_offline" : "";
        auto time = wall_at(now, due);
        if (record.state == State::lost) {
            emit(out, event::Type::tag_purged, time, record);
            forget(at);
        } else if (record.state == State::observed) {
            lose(at, due);
            emit(out, event::Type::tag_lost, time, record, reason);
        } else if (record.first_is_new) {
            emit(out, event::Type::tag_purged, time, record, reason.empty() ? "glimpse_timeout" : reason);
            forget(at);
        } else {
            lose(at, due);  // its tag.lost was sent before it was glimpsed again
        }
    }

    void lose(RecordIndex at, Steady when) {
        auto& slot = records[at];
        slot.record.state = State::lost;
        slot.record.first_is_new = false;
        --present;
        records.lost(at);
        start_timer(slot, when);
        mark_changed(slot);
        arm_exactly(at);
    }

    void forget(RecordIndex at) {
        auto& slot = records[at];
        if (slot.record.state == State::lost)
            records.found(at);
        else
            --present;
        deadlines.erase(at);
        sets.leave(slot.set, at);
        if (slot.stored) deleted.push_back(slot.record.id);
        records.remove(at);
    }

    void evict(RecordIndex at, Now now, std::vector<Transition>& out) {
        auto record = records[at].record;
        if (record.state == State::observed) {
            record.state = State::lost;
            record.first_is_new = false;
            emit(out, event::Type::tag_lost, now.wall, record, "capacity");
        }
        emit(out, event::Type::tag_purged, now.wall, record, "capacity");
        forget(at);
    }

    void make_room(Now now, std::vector<Transition>& out) {
        while (records.size() >= max_records) {
            auto at = records.longest_lost();
            if (at == no_record && !deadlines.empty()) {
                at = deadlines.top().index;
                if (deadline_of(records[at]) > records[at].queued) {
                    arm_exactly(at);
                    continue;
                }
            }
            if (at == no_record) {  // all are frozen
                auto full = std::ranges::find_if(sets.all(), [](auto& set) { return set.parked > 0; });
                at = full->members.front();
            }
            if (auto due = deadline_of(records[at]); due <= now.steady)
                expire(at, due, now, out);
            else
                evict(at, now, out);
        }
    }

    // --- sightings ---

    // What is due of this tag falls first, in order. Returns the first record that is left of it.
    RecordIndex expire_tag(const event::TagId& tag, Now now, std::vector<Transition>& out) {
        for (;;) {
            auto first = records.first_of(tag), next = no_record;
            auto next_due = never;
            for (auto at = first; at != no_record; at = records[at].next) {
                auto due = deadline_of(records[at]);
                if (due > now.steady || due >= next_due) continue;
                next = at;
                next_due = due;
            }
            if (next == no_record) return first;
            expire(next, next_due, now, out);
        }
    }

    void enter(RecordIndex at, SetIndex set, Steady now) {
        auto& slot = records[at];
        slot.set = set;
        sets.join(set, at);
        start_timer(slot, now);
    }

    void add(const Sighting& sighting, Now now, std::vector<Transition>& out) {
        make_room(now, out);
        Record record;
        record.id = next_id++;
        record.tag = sighting.tag;
        record.technology = sighting.technology;
        record.state = State::glimpsed;
        record.zone = sighting.zone;
        auto at = records.add(record);
        auto& slot = records[at];
        ++present;
        begin_life(slot, sighting, now);
        slot.record.first_is_new = true;
        enter(at, sets.intern(sighting.zone, {&sighting.reader, 1}, now.steady), now.steady);
        emit(out, event::Type::tag_new, now.wall, slot.record);
        glimpse(at, now, out);
    }

    void begin_life(Slot& slot, const Sighting& sighting, Now now) {
        slot.first = now.steady;
        slot.record.first_seen = now.wall;
        slot.record.reads = 0;
        take_over(slot.record, sighting, now.wall);
        mark_changed(slot);
    }

    static void take_over(Record& record, const Sighting& sighting, Wall now) {
        record.reader = sighting.reader;
        record.antenna = sighting.antenna;
        record.rssi = sighting.rssi;
        if (sighting.pc) record.pc = *sighting.pc;
        if (sighting.xpc) record.xpc = *sighting.xpc;
        record.reads += sighting.reads;
        record.last_seen = now;
    }

    void glimpse(RecordIndex at, Now now, std::vector<Transition>& out) {
        auto& slot = records[at];
        if (rules(slot.record).glimpsed_events) emit(out, event::Type::tag_glimpsed, now.wall, slot.record);
        observe(at, now, out);
        arm(at);
    }

    // A lost tag is back: the readers of its earlier life say nothing about this one.
    void see_again(RecordIndex at, const Sighting& sighting, Now now, std::vector<Transition>& out) {
        auto& slot = records[at];
        records.found(at);
        ++present;
        slot.record.state = State::glimpsed;
        begin_life(slot, sighting, now);
        auto set = sets.intern(sighting.zone, {&sighting.reader, 1}, now.steady);
        sets.leave(slot.set, at);
        enter(at, set, now.steady);
        glimpse(at, now, out);
    }

    void see_on(RecordIndex at, const Sighting& sighting, Now now, std::vector<Transition>& out) {
        auto& slot = records[at];
        bool known = slot.record.reader == sighting.reader || sets[slot.set].has(sighting.reader);
        take_over(slot.record, sighting, now.wall);
        if (known) {
            start_timer(slot, now.steady);
        } else {
            auto readers = sets[slot.set].readers;
            readers.push_back(sighting.reader);
            auto set = sets.intern(sighting.zone, readers, now.steady);
            sets.leave(slot.set, at);
            enter(at, set, now.steady);
            mark_changed(slot);
        }
        if (slot.record.state == State::glimpsed) observe(at, now, out);
        arm(at);
        if (!slot.changed) records.mark(at);
    }

    void observe(RecordIndex at, Now now, std::vector<Transition>& out) {
        auto& slot = records[at];
        if (!seen_enough(rules(slot.record), slot.record, slot.since - slot.first)) return;
        slot.record.state = State::observed;
        mark_changed(slot);
        emit(out, event::Type::tag_observed, now.wall, slot.record);
        auto before = at;
        for (auto other = records.first_of(slot.record.tag); other != no_record; other = records[other].next)
            if (records[other].observed_order > records[before].observed_order) before = other;
        if (before != at)
            emit(out, event::Type::tag_moved, now.wall, slot.record, {}, records[before].record.zone);
        slot.observed_order = ++observed_counter;
    }

    void deliver(std::vector<Transition>& out) {
        if (waiting.empty()) return;
        out.insert(out.end(), waiting.begin(), waiting.end());
        waiting.clear();
    }
};

Presence::Presence(std::size_t max_records, std::uint64_t first_id)
    : impl_(std::make_unique<Impl>(max_records, first_id)) {}
Presence::~Presence() = default;

ZoneIndex Presence::add_zone(const Rules& rules) {
    impl_->zones.push_back(bounded(rules));
    return static_cast<ZoneIndex>(impl_->zones.size() - 1);
}

void Presence::set_rules(ZoneIndex zone, const Rules& rules) {
    auto& my = *impl_;
    my.zones[zone] = bounded(rules);
    my.records.for_each([&](RecordIndex at) {
        if (my.records[at].record.zone == zone) my.arm_exactly(at);
    });
}

ReaderIndex Presence::add_reader() {
    return impl_->sets.add_reader();
}

// Whatever fell due before must not be frozen, or judged by the clock after the thaw. It waits for the next
// call that has a place for transitions.
void Presence::reader_online(ReaderIndex reader, Now now) {
    auto& my = *impl_;
    while (my.next_due(now, my.waiting))
        my.waiting_since = now.steady;
    for (auto set : my.sets.online(reader, now.steady)) {
        my.arm_set(set);
        while (my.sets[set].parked > 0) {
            auto at = my.sets[set].members.front();
            my.sets.unpark(set, at);
            my.arm(at);
        }
    }
}

void Presence::reader_offline(ReaderIndex reader, Now now) {
    auto& my = *impl_;
    while (my.next_due(now, my.waiting))
        my.waiting_since = now.steady;
    for (auto set : my.sets.offline(reader, now.steady))
        my.arm_set(set);
}

void Presence::restore(const Record& record, std::span<const ReaderIndex> readers, Now now) {
    auto& my = *impl_;
    bool known = my.records.with_id(record.id) != no_record;
    bool placed = false;
    for (auto at = my.records.first_of(record.tag); at != no_record; at = my.records[at].next)
        placed = placed || my.records[at].record.zone == record.zone;
    if (placed && !known) my.deleted.push_back(record.id);  // one record a tag and zone
    if (placed || known) return;
    if (my.records.size() >= my.max_records) my.waiting_since = now.steady;
    my.make_room(now, my.waiting);
    my.next_id = std::max(my.next_id, record.id + 1);

    auto at = my.records.add(record);
    auto& slot = my.records[at];
    slot.stored = true;
    slot.first = now.steady - std::clamp<microseconds>(record.last_seen - record.first_seen, microseconds{},
                                                       std::chrono::years{50});
    // The order in which its zones observed a tag is not stored; that of first_seen comes close. All of it
    // lies below what this process counts.
    if (record.state != State::glimpsed || !record.first_is_new)
        slot.observed_order = to_us(record.first_seen) - std::numeric_limits<std::int64_t>::max() / 2;
    std::vector<ReaderIndex> all(readers.begin(), readers.end());
    all.push_back(record.reader);
    if (record.state == State::lost)
        my.records.lost(at);
    else
        ++my.present;
    my.enter(at, my.sets.intern(record.zone, all, now.steady), now.steady);
    my.arm(at);
}

void Presence::sighted(const Sighting& sighting, Now now, std::vector<Transition>& out) {
    auto& my = *impl_;
    my.deliver(out);
    auto at = my.expire_tag(sighting.tag, now, out);
    while (at != no_record && my.records[at].record.zone != sighting.zone)
        at = my.records[at].next;
    if (at == no_record) return my.add(sighting, now, out);

    // Link threads run beside one another: a sighting may be a little older than what we know already.
    if (auto since = my.records[at].since; now.steady < since) now = {since, wall_at(now, since)};
    if (my.records[at].record.state == State::lost)
        my.see_again(at, sighting, now, out);
    else
        my.see_on(at, sighting, now, out);
}

void Presence::time_passed(Now now, std::vector<Transition>& out) {
    impl_->deliver(out);
    while (impl_->next_due(now, out)) {
    }
}

std::optional<Steady> Presence::deadline() const {
    if (!impl_->waiting.empty()) return impl_->waiting_since;
    auto first = std::min(impl_->deadlines.first(), impl_->set_deadlines.first());
    if (first == never) return {};
    return first;
}

void Presence::take_changes(Changes& out) {
    auto& my = *impl_;
    out.stored.clear();
    out.deleted.clear();
    if (!my.waiting.empty()) return;  // what changed must not be stored before its transitions are known
    for (auto id : my.changed) {
        auto at = my.records.with_id(id);
        if (at == no_record) continue;
        my.records[at].changed = false;
        my.records[at].stored = true;
        my.records.unmark(at);
        out.stored.push_back(id);
    }
    my.changed.clear();
    std::swap(out.deleted, my.deleted);
}

void Presence::take_stale(std::size_t max, std::vector<std::uint64_t>& out) {
    auto& my = *impl_;
    my.records.take_marked(max, [&](RecordIndex at) {
        if (my.records[at].changed) return false;
        out.push_back(my.records[at].record.id);
        return true;
    });
}

const Record* Presence::find(std::uint64_t id) const {
    auto at = impl_->records.with_id(id);
    return at == no_record ? nullptr : &impl_->records[at].record;
}

void Presence::readers_of(std::uint64_t id, std::vector<ReaderIndex>& out) const {
    auto at = impl_->records.with_id(id);
    if (at == no_record) return;
    const auto& readers = impl_->sets[impl_->records[at].set].readers;
    out.insert(out.end(), readers.begin(), readers.end());
}

std::size_t Presence::size() const {
    return impl_->records.size();
}
std::size_t Presence::present() const {
    return impl_->present;
}

}  // namespace gantry::presence
