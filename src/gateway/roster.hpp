#pragma once
#include <atomic>
#include <deque>
#include <mutex>
#include <span>
#include <string>
#include <string_view>

#include "gateway/config.hpp"

namespace gantry::gateway {

// One reader by its name, from the first time it is heard of until the process ends. The names never change;
// the atomics are written by the loop that has its link and read by whoever wants to know.
struct RosterEntry {
    std::uint32_t index = 0;
    std::string name;  // printable
    const ReaderConfig* config = nullptr;
    std::atomic<bool> connected{false};
    std::atomic<bool> reading{true};  // false: somebody stopped it (StopReading)
    std::atomic<std::uint64_t> reads{0};
    std::atomic<std::int64_t> last_read_us{0};   // wall; 0: never
    std::atomic<std::int64_t> last_input_us{0};  // wall; 0: never
    std::atomic<std::int64_t> since_us{0};       // wall: connected or disconnected since
};

// All readers known. Any thread.
class Roster {
public:
    static constexpr std::size_t max_readers = 100'000;  // strangers must not fill the memory

    // The entry of that name, made if it is new. nullptr: the roster is full, or the name belongs to a reader
    // of another section of the configuration.
    RosterEntry* admit(std::string_view name, const ReaderConfig& config);
    RosterEntry* find(std::string_view name);
    RosterEntry& at(std::uint32_t index);
    const RosterEntry& at(std::uint32_t index) const;
    std::size_t size() const;

private:
    mutable std::mutex mutex_;
    std::deque<RosterEntry> entries_;  // addresses are stable
};

// The section whose name (or pattern) and networks let a reader of this name dial in from this address;
// nullptr when none does, and then `why` says what was wrong. Exact names go before patterns.
const ReaderConfig* section_for(std::span<const ReaderConfig* const> sections, std::string_view name,
                                std::string_view host, std::string& why);

// The same for a reader whose protocol has no name for it: the first section whose networks it dials in from,
// one with `from` before one without. `name`: the section's, with the host in the place of *.
const ReaderConfig* section_at(std::span<const ReaderConfig* const> sections, std::string_view host,
                               std::string& name, std::string& why);

}  // namespace gantry::gateway
