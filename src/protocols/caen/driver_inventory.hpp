#pragma once
#include <vector>

#include "protocols/caen/driver_dialog.hpp"
#include "reader/plugin.hpp"

namespace gantry::caen {

enum class Mode : std::uint8_t {
    notify,     // the reader reads by itself and sends what it saw over a channel of its own
    framed,     // InventoryTag, framed and continuous: tags as they are seen
    inventory,  // InventoryTag, one round after another
    raw,        // RawReadIDs, one round after another
};
std::string_view to_text(Mode mode);

// Which way the reader is read, and with which commands. What it refuses falls back to the next way.
class ReadingPlan {
public:
    explicit ReadingPlan(const Settings& settings) : settings_(settings) {}

    // The ways that this reader offers, the best first.
    void offer(const ReaderState& reader, bool notify_at);
    bool offered() const { return !modes_.empty(); }
    std::optional<Mode> mode() const;  // nothing: all are refused
    // The reader refused the mode in use, or it does not work: to the next. False where it has worked before,
    // which makes the refusal something else.
    bool refused(std::string why);
    void worked() { proven_ = true; }
    std::string detail() const;  // for Described

    Request request(const Source& source) const;  // in the mode in use
    // ReadCycle of the source, 0: endless (section 4.2).
    static Request read_cycle(const Source& source, std::uint32_t cycles);
    static Request get_read_cycle(const Source& source);

private:
    std::uint16_t flags() const;

    const Settings& settings_;
    std::vector<Mode> modes_;  // from the one in use on
    std::vector<std::string> said_;
    bool proven_ = false;
};

// Whoever asked for it.
bool sets_read_cycle(const Request& request);

}  // namespace gantry::caen
