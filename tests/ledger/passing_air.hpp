#pragma once
#include <deque>
#include <mutex>
#include <optional>
#include <vector>

#include "reader/air.hpp"

namespace gantry::ledger {

// An air in which numbered tags pass antenna 1 one after the other at a steady rate, each heard once. A tag
// passes only while the reader listens: a reader that is stopped misses nothing, and what is missing at the
// end was lost on the way.
class PassingAir : public Air {
public:
    // HF units ask about the past again, to find out who disturbs whom: for them the last tags stay known,
    // their ids have eight bytes, and their memory reads as zeros.
    enum class Kind : std::uint8_t { uhf, hf };

    // `most` tags pass, zero: no end of them.
    PassingAir(Kind kind, std::uint32_t reader, double reads_per_second, std::uint64_t most);

    void inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) override;
    std::vector<std::uint16_t> antennas() const override { return {1}; }
    AirResult<Bytes> read(const AirAccess& access, Bank bank, std::uint32_t word,
                          std::uint32_t words) override;

    std::uint64_t passed() const;
    void set_rate(double reads_per_second);  // from the next tag on
    void begin();                            // until then nothing passes
    void stop();                             // nothing passes any more

private:
    AirSighting next(Steady at);

    const Kind kind_;
    const std::uint32_t reader_;
    const std::uint64_t most_;
    mutable std::mutex mutex_;
    Steady::duration interval_;
    std::optional<Steady> next_at_, heard_to_;
    std::uint64_t passed_ = 0;
    std::deque<AirSighting> remembered_;
    bool passing_ = false;
};

}  // namespace gantry::ledger
