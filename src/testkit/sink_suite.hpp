#pragma once
#include <memory>
#include <string>
#include <vector>

#include "sink/sink.hpp"

// What every kind of destination must pass, against its real server.
namespace gantry::testkit {

// A server that the test runs on loopback, and what it holds.
class Destination {
public:
    virtual ~Destination() = default;
    virtual void start() = 0;  // on the same address each time, with what it held before
    virtual void kill() = 0;   // at once, as kill -9 does; where it is no process: it becomes unreachable
    // A sink with its kind's usual settings, not connected yet.
    virtual std::unique_ptr<sink::Sink> make_sink() = 0;
    // The ids of all events that it has taken so far, in the order of their arrival, doubles included.
    virtual std::vector<std::string> ids() = 0;
    // From now on it refuses the event with this id for good. False: this kind of destination takes anything.
    virtual bool refuse(const std::string& /*id*/) { return false; }
    // It drops an id that it already has.
    virtual bool idempotent() const { return false; }
};

// A host of no readers that notes what is asked of it.
class QuietHost : public sink::Host {
public:
    std::vector<sink::ReaderState> readers() override { return {}; }
    void request(std::string_view operation, std::string body,
                 std::function<void(std::string)> answer) override;
};

// Events "suite:1", "suite:2" … and the items that lend them.
struct LentEvents {
    explicit LentEvents(std::size_t count, std::uint64_t first_seq = 1);
    std::span<const sink::Item> items() const { return items_; }
    std::vector<std::string> ids() const;

private:
    std::vector<event::Event> events_;
    std::vector<std::string> ids_, payloads_;
    std::vector<sink::Item> items_;
};

sink::Patience patience(std::chrono::milliseconds time);

// All of the suite below; each is also there by itself so that a failure has a name.
void check_empty_batch(Destination& destination);
void check_order_and_ids(Destination& destination);
void check_partial_refusal(Destination& destination);  // skipped where nothing can be refused
void check_destination_gone_and_back(Destination& destination);
void check_killed_in_between(Destination& destination);      // under load: nothing accepted is missing
void check_doubles_after_a_crash(Destination& destination);  // the same batch from a new sink
void check_hostile_text(Destination& destination);           // names and tag data arrive as they are
void check_patience(Destination& destination);  // unreachable, and stopped: returns in time, all kept

}  // namespace gantry::testkit

// In a test file: GANTRY_SINK_SUITE(Mqtt, MosquittoDestination)
#define GANTRY_SINK_SUITE(Name, Type)                        \
    TEST(Name##Sink, EmptyBatch) {                           \
        Type d;                                              \
        gantry::testkit::check_empty_batch(d);               \
    }                                                        \
    TEST(Name##Sink, OrderAndIds) {                          \
        Type d;                                              \
        gantry::testkit::check_order_and_ids(d);             \
    }                                                        \
    TEST(Name##Sink, PartialRefusal) {                       \
        Type d;                                              \
        gantry::testkit::check_partial_refusal(d);           \
    }                                                        \
    TEST(Name##Sink, GoneAndBack) {                          \
        Type d;                                              \
        gantry::testkit::check_destination_gone_and_back(d); \
    }                                                        \
    TEST(Name##Sink, KilledInBetween) {                      \
        Type d;                                              \
        gantry::testkit::check_killed_in_between(d);         \
    }                                                        \
    TEST(Name##Sink, DoublesAfterACrash) {                   \
        Type d;                                              \
        gantry::testkit::check_doubles_after_a_crash(d);     \
    }                                                        \
    TEST(Name##Sink, HostileText) {                          \
        Type d;                                              \
        gantry::testkit::check_hostile_text(d);              \
    }                                                        \
    TEST(Name##Sink, Patience) {                             \
        Type d;                                              \
        gantry::testkit::check_patience(d);                  \
    }
