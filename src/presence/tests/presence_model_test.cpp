#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "presence/tests/presence_world.hpp"

namespace gantry::presence::testing {
namespace {

using std::chrono::milliseconds;

// The rules once more, as plainly as they can be said: time goes by in ticks of a millisecond, and each tick
// looks at every record. No deadlines, no sets, no clocks that stand still.
class Model {
public:
    Model(std::vector<Rules> rules, std::size_t readers)
        : rules_(std::move(rules)), online_(readers, false) {}

    void tick_to(int time) {
        while (now_ < time) {
            end_what_is_due();
            ++now_;
            for (auto& [key, record] : records_) {
                if (frozen(record))
                    ++record.offline;
                else
                    ++record.running;
            }
            end_what_is_due();
        }
        end_what_is_due();
    }
    void switch_reader(ReaderIndex reader, bool online) {
        online_[reader] = online;
        for (auto& [key, record] : records_)
            if (!frozen(record)) record.offline = 0;
    }
    void see(const std::string& tag, ZoneIndex zone, ReaderIndex reader, std::uint32_t reads) {
        const auto& rules = rules_[zone];
        auto [it, is_new] = records_.try_emplace({tag, zone});
        auto& record = it->second;
        if (is_new || record.state == State::lost) {
            record.state = State::glimpsed;
            record.was_new = is_new;
            record.first = now_;
            record.reads = 0;
            record.readers.clear();
            if (is_new) tell("new", tag, zone);
            if (rules.glimpsed_events) tell("glimpsed", tag, zone);
        }
        record.readers.insert(reader);
        record.reads += reads;
        record.running = record.offline = 0;
        if (record.state == State::glimpsed && enough(rules, record)) {
            record.state = State::observed;
            tell("observed", tag, zone);
            ZoneIndex from = zone;
            int latest = record.observed;
            for (auto& [key, other] : records_)
                if (key.first == tag && other.observed > latest) {
                    from = key.second;
                    latest = other.observed;
                }
            if (from != zone) tell("moved", tag, zone, from == 0 ? "from Z" : "from Y");
            record.observed = ++observed_;
        }
    }
    std::size_t size() const { return records_.size(); }
    std::size_t present() const {
        return static_cast<std::size_t>(
            std::ranges::count_if(records_, [](auto& each) { return each.second.state != State::lost; }));
    }
    std::vector<std::string> told;

private:
    struct Record {
        State state{};
        bool was_new = false;
        int first = 0, running = 0, offline = 0;  // ticks since the timer started, frozen ones apart
        int observed = 0;
        std::uint64_t reads = 0;
        std::set<ReaderIndex> readers;
    };
    using Key = std::pair<std::string, ZoneIndex>;

    bool frozen(const Record& record) const {
        return std::ranges::none_of(record.readers, [this](auto reader) { return online_[reader]; });
    }
    bool enough(const Rules& rules, const Record& record) const {
        if (rules.observe_after == 0us && rules.observe_after_reads == 0) return true;
        return (rules.observe_after > 0us && milliseconds(now_ - record.first) >= rules.observe_after) ||
               (rules.observe_after_reads > 0 && record.reads >= rules.observe_after_reads);
    }
    void tell(const std::string& what, const std::string& tag, ZoneIndex zone, const std::string& more = {}) {
        told.push_back(to_text(std::chrono::microseconds(milliseconds(now_))) + " " + what + " " + tag +
                       (zone == 0 ? " Z" : " Y") + (more.empty() ? "" : " " + more));
    }
    void end_what_is_due() {
        for (auto it = records_.begin(); it != records_.end();)
            it = end(it) ? records_.erase(it) : next(it);
    }
    // True when the record is to be forgotten.
    bool end(std::map<Key, Record>::iterator it) {
        const auto& key = it->first;
        auto& record = it->second;
        const auto& rules = rules_[key.second];
        bool given_up = frozen(record) && rules.offline_lose_after &&
                        milliseconds(record.offline) >= *rules.offline_lose_after;
        auto over = [&](auto limit) { return !frozen(record) && milliseconds(record.running) >= limit; };
        if (record.state == State::glimpsed && (given_up || over(rules.glimpse_timeout))) {
            if (record.was_new) {
                tell("purged", key.first, key.second, given_up ? "reader_offline" : "glimpse_timeout");
                return true;
            }
            lose(record);
        } else if (record.state == State::observed && (given_up || over(rules.lose_after))) {
            tell("lost", key.first, key.second, given_up ? "reader_offline" : "");
            lose(record);
        }
        if (record.state == State::lost && over(rules.purge_after)) {
            tell("purged", key.first, key.second);
            return true;
        }
        return false;
    }
    void lose(Record& record) {
        record.state = State::lost;
        record.running = record.offline = 0;
    }

    std::vector<Rules> rules_;
    std::vector<bool> online_;
    std::map<Key, Record> records_;
    int now_ = 0, observed_ = 0;
};

Rules any_rules() {
    auto time = [](int most) { return milliseconds(*rc::gen::inRange(0, most)); };
    Rules rules;
    rules.glimpse_timeout = time(30);
    rules.observe_after = *rc::gen::element(0, 0, 5, 20) * 1ms;
    rules.observe_after_reads = *rc::gen::element(0u, 0u, 2u, 4u);
    rules.lose_after = time(40);
    rules.purge_after = time(80);
    if (*rc::gen::arbitrary<bool>()) rules.offline_lose_after = time(60);
    rules.glimpsed_events = *rc::gen::arbitrary<bool>();
    return rules;
}

// Of one record the order is fixed; at one instant that of different ones is not.
void sort_by_time_and_record(std::vector<std::string>& lines) {
    std::ranges::stable_sort(lines, {}, [](const std::string& line) {
        std::istringstream words(line);
        std::string time, what, tag, zone;
        words >> time >> what >> tag >> zone;
        return std::tuple(*parse_duration(time), tag, zone);
    });
}

RC_GTEST_PROP(PresenceModel, TellsTheSameStoryAsThePlainRules, ()) {
    std::vector<Rules> rules{any_rules(), any_rules()};
    Presence presence;
    Model model(rules, 3);
    for (auto& each : rules)
        presence.add_zone(each);
    for (int reader = 0; reader < 3; ++reader)
        presence.add_reader();
    std::vector<Transition> out;
    std::vector<bool> online(3, false);
    std::ostringstream script;  // what play() would need
    for (auto& each : rules)
        script << "glimpse " << each.glimpse_timeout.count() << " observe " << each.observe_after.count()
               << "/" << each.observe_after_reads << " lose " << each.lose_after.count() << " purge "
               << each.purge_after.count() << " offline "
               << (each.offline_lose_after ? each.offline_lose_after->count() : -1) << "\n";

    int time = 0, steps = *rc::gen::inRange(0, 80);
    bool often = *rc::gen::arbitrary<bool>();
    for (int step = 0; step <= steps; ++step) {
        time += *rc::gen::element(0, 0, 1, 2, 5, 11, 30, step == steps ? 1000 : 90);
        auto now = start + milliseconds(time);
        model.tick_to(time);
        auto action = *rc::gen::inRange(0, 12);
        auto reader = *rc::gen::inRange<ReaderIndex>(0, 3);
        if (action < 3) {
            online[reader] = !online[reader];
            script << time << "ms " << (online[reader] ? "online r" : "offline r") << reader + 1 << "\n";
            online[reader] ? presence.reader_online(reader, now) : presence.reader_offline(reader, now);
            model.switch_reader(reader, online[reader]);
        } else if (online[reader]) {  // a reader that is offline sees nothing
            auto tag = *rc::gen::element<std::string>("A", "B", "C");
            auto zone = *rc::gen::inRange<ZoneIndex>(0, 2);
            auto reads = *rc::gen::inRange<std::uint32_t>(1, 3);
            script << time << "ms see " << tag << " in " << (zone == 0 ? "Z" : "Y") << " by r" << reader + 1
                   << " x" << reads << "\n";
            presence.sighted({.tag = tag_of(tag), .zone = zone, .reader = reader, .reads = reads}, now, out);
            model.see(tag, zone, reader, reads);
        }
        if (often || step == steps) {
            RC_LOG(script.str());
            presence.time_passed(now, out);
            model.tick_to(time);
            RC_ASSERT(presence.size() == model.size());
            RC_ASSERT(presence.present() == model.present());
        }
    }
    std::vector<std::string> told;
    for (auto& transition : out)
        told.push_back(to_line(transition));
    sort_by_time_and_record(told);
    sort_by_time_and_record(model.told);
    RC_ASSERT(told == model.told);
}

// What a consumer may rely on, for each tag and zone, whatever happens and however time jitters.
struct Life {
    bool open = false, observed = false, known = false;
};

void check_order(Life& life, const Transition& transition) {
    switch (transition.type) {
        case event::Type::tag_new:
            RC_ASSERT(!life.known);
            life = {.open = true, .observed = false, .known = true};
            break;
        case event::Type::tag_observed:
            RC_ASSERT(life.known);
            RC_ASSERT(!life.observed);
            life.open = life.observed = true;
            break;
        case event::Type::tag_lost:
            RC_ASSERT(life.observed);
            life.open = life.observed = false;
            break;
        case event::Type::tag_purged:
            RC_ASSERT(life.known);
            RC_ASSERT(!life.observed);
            // Whatever ends without tag.lost says why.
            if (life.open) RC_ASSERT(!transition.reason.empty());
            life = {};
            break;
        default:
            RC_ASSERT(life.known);
    }
}

RC_GTEST_PROP(PresenceModel, EveryNewTagEndsOnceEvenAtTheBoundAndWithTimeThatJitters, ()) {
    auto capacity = *rc::gen::inRange<std::size_t>(1, 6);
    Presence presence(capacity);
    for (int zone = 0; zone < 2; ++zone)
        presence.add_zone(any_rules());
    for (int reader = 0; reader < 3; ++reader)
        presence.add_reader();
    std::vector<Transition> out;
    std::set<std::uint64_t> stored;
    std::map<std::pair<std::string, ZoneIndex>, Life> lives;

    int time = 100, steps = *rc::gen::inRange(0, 120);
    for (int step = 0; step < steps; ++step) {
        time += *rc::gen::element(-3, -1, 0, 1, 2, 7, 40);
        auto now = start + milliseconds(time);
        auto reader = *rc::gen::inRange<ReaderIndex>(0, 3);
        switch (*rc::gen::inRange(0, 8)) {
            case 0:
                presence.reader_online(reader, now);
                break;
            case 1:
                presence.reader_offline(reader, now);
                break;
            case 2:
                presence.time_passed(now, out);
                break;
            case 3:
                presence.set_rules(*rc::gen::inRange<ZoneIndex>(0, 2), any_rules());
                break;
            default:
                presence.sighted({.tag = tag_of(std::string(1, *rc::gen::inRange('A', 'H'))),
                                  .zone = *rc::gen::inRange<ZoneIndex>(0, 2),
                                  .reader = reader},
                                 now, out);
        }
        RC_ASSERT(presence.size() <= capacity);
        if (*rc::gen::inRange(0, 4) == 0) {
            Presence::Changes changes;
            presence.take_changes(changes);
            for (auto id : changes.stored) {
                RC_ASSERT(presence.find(id) != nullptr);
                stored.insert(id);
            }
            for (auto id : changes.deleted)
                RC_ASSERT(stored.erase(id) == 1u);
        }
    }
    auto end = start + 1h;
    for (ReaderIndex reader = 0; reader < 3; ++reader)
        presence.reader_online(reader, end);
    presence.time_passed(end + 1h, out);
    RC_ASSERT(presence.size() == 0u);
    RC_ASSERT(presence.present() == 0u);
    RC_ASSERT(!presence.deadline());
    Presence::Changes changes;
    presence.take_changes(changes);
    RC_ASSERT(changes.stored.empty());
    for (auto id : changes.deleted)
        stored.erase(id);
    RC_ASSERT(stored.empty());

    for (auto& transition : out)
        check_order(lives[{std::string(as_text(transition.record.tag.view())), transition.record.zone}],
                    transition);
    for (auto& [key, life] : lives)
        RC_ASSERT(!life.known);
}

}  // namespace
}  // namespace gantry::presence::testing
