#pragma once
#include <deque>
#include <map>
#include <set>
#include <vector>

#include "protocols/harting/driver_dialog.hpp"

namespace gantry::harting {

// "1,3" as a bit field, bit 0 antenna 1; an error names the piece that is no antenna.
Result<std::uint8_t> parse_antennas(std::string_view text);

// The beginning of every connection: who is it, and the settings, by reading a block, changing the parameters
// in it and writing it back where that changes anything. What was changed is said in Described, nothing is
// put back later. What the reader refuses becomes a notice, and the rest goes on.
class DriverSetup final : public Task {
public:
    DriverSetup(const DriverOptions& options, Way way, KnownReader& reader, Described& described,
                Reports& reports, std::set<std::string>& said);
    std::optional<Request> next(Now now) override;
    void answered(const Reply& reply, Now now) override;

    bool locked_out() const { return locked_out_; }  // it wants a log-in that we do not have, for anything
    bool broken() const { return broken_; }          // EE-Init: it takes no settings before a restart

private:
    enum class What : std::uint8_t { firmware, login, lines, device, read, write, clock };
    struct Step {
        What what;
        Request request;
        std::uint8_t block = 0;
        bool eeprom = false;  // read and write: of the block
    };
    struct Change {
        const ConfigRow* row;
        wire::Value value;
    };

    void want(std::string_view row, wire::Value value);
    void plan();
    void plan_records();
    void plan_valid_time();
    void plan_scan();
    void plan_notifications();
    void read(std::uint8_t block);
    void written(const Step& step, const Reply& reply, Now now);
    void firmware_told(const Reply& reply, Now now);
    void block_told(const Step& step, const Reply& reply, Now now);
    void say(std::int64_t code, std::string text, Now now);
    void conclude(Now now);

    const DriverOptions& options_;
    const Way way_;
    KnownReader& reader_;
    Described& described_;
    Reports& reports_;
    std::deque<Step> steps_;
    std::map<std::uint8_t, std::vector<Change>> wanted_;  // by block
    std::optional<Block> stored_;                  // as EEPROM has the block that is read next from RAM
    Block writing_{};                              // under way
    std::vector<std::string> changed_, changing_;  // in words
    std::set<std::string>& said_;
    bool planned_ = false, concluded_ = false, locked_out_ = false, broken_ = false;
    bool login_tried_ = false;
    bool unheard_ = false;  // it notifies, and nobody told it to notify us
    bool needs_restart_ = false;
};

}  // namespace gantry::harting
