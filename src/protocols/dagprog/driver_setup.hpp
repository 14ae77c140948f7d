#pragma once
#include <memory>

#include "protocols/dagprog/driver_dialog.hpp"
#include "reader/plugin.hpp"

namespace gantry::dagprog {

// What is kept of a unit from one start to the next, so that its forms need not be found out again: its
// version, and how it wants its commands (section 9.2).
struct Remembered {
    std::string version;
    Forms forms;
    Bytes mark() const;
    static std::optional<Remembered> parse(ByteView mark);
};

// Who is there, and how it wants to be spoken to (section 9.2). Nothing is kept for good by it.
class IdentifyTask : public Task {
public:
    virtual bool failed() const = 0;  // nobody answers
    virtual std::string why() const = 0;
};
std::unique_ptr<IdentifyTask> make_identify_task(UnitState& unit, const Settings& settings,
                                                 const std::optional<Remembered>& remembered);

// What the settings want of a unit that is identified.
void decide_registers(UnitState& unit, const Settings& settings);
// Sets what differs from what is wanted; what is refused is wanted no more.
std::unique_ptr<Task> make_setup_task(UnitState& unit);
// The reading mode that the settings want; nothing: this kind of unit has no such mode.
std::optional<Code> reading_mode(std::string_view setting, Family family);
std::unique_ptr<Task> make_start_task(UnitState& unit, Code mode);
std::unique_ptr<Task> make_stop_task(UnitState& unit);
// The field off, a pause, and on again: tags that sleep wake up.
std::unique_ptr<Task> make_reread_task(UnitState& unit);

}  // namespace gantry::dagprog
