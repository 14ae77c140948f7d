#pragma once
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "journal/journal.hpp"
#include "reader/air.hpp"

namespace gantry::testkit {

// The books of one virtual reader: every read it ever makes carries the reader's number and its own, counted
// from 1, as the tag's id; no two reads are alike.
event::TagId numbered_tag(std::uint32_t reader, std::uint64_t number);
struct Numbered {
    std::uint32_t reader = 0;
    std::uint64_t number = 0;
};
std::optional<Numbered> number_of(const event::TagId& tag);

// An air in which a numbered tag passes antenna 1 at a steady rate, each exactly once.
class NumberingAir : public Air {
public:
    NumberingAir(std::uint32_t reader, double reads_per_second) : reader_(reader), rate_(reads_per_second) {}

    void inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) override;
    std::vector<std::uint16_t> antennas() const override { return {1}; }

    std::uint64_t generated() const;
    void stop();  // nothing passes any more

private:
    const std::uint32_t reader_;
    const double rate_;
    mutable std::mutex mutex_;
    std::optional<Steady> start_;
    std::uint64_t generated_ = 0;
    bool stopped_ = false;
};

// What the store holds, against what the readers know.
struct Ledger {
    std::uint64_t stored = 0;    // numbered reads in the store
    std::uint64_t lost = 0;      // acknowledged and not in the store
    std::uint64_t doubled = 0;   // in the store more than once (not counting those marked possible_repeat)
    std::uint64_t invented = 0;  // in the store and never generated
    std::uint64_t marked = 0;    // possible_repeat
    std::uint64_t seq_gaps = 0;  // seq that is missing or comes twice
    std::string text() const;
};
struct Claim {
    std::uint32_t reader = 0;
    std::uint64_t acknowledged = 0;  // reads 1 to this were acknowledged
    std::uint64_t generated = 0;
};
// Reads the whole store at `path`; tag.read events must be on.
Ledger check_ledger(const std::string& path, const std::vector<Claim>& claims);

}  // namespace gantry::testkit
