#pragma once
#include <span>

#include "protocols/caen/device_request.hpp"
#include "protocols/caen/device_state.hpp"

// How a virtual reader does what it is asked: one handler a command, each told only what it needs.
namespace gantry::caen {

class Notifier;

struct Call {
    Command command;
    const Arguments& arguments;
    ReaderMemory& memory;
    Notifier& notifier;
    Now now;
    Bytes answer = {};     // the pairs between the echo and the result; a failure sends none of them
    bool restart = false;  // when the answer is out
};
using Handler = ResultCode (*)(Call&);

struct HandlerRow {
    Command command;
    Handler handler;
};
// By subject; each in its own file.
std::span<const HandlerRow> setting_handlers();
std::span<const HandlerRow> tag_handlers();
std::span<const HandlerRow> notify_handlers();
Handler find_handler(Command command);  // nullptr: inventories, which take time

// The source that a request names, or the first where the name is optional and left out.
struct SourceChoice {
    ResultCode result = ResultCode::success;
    std::size_t source = 0;
};
SourceChoice choose_source(const Arguments& arguments, const ReaderMemory& memory);

}  // namespace gantry::caen
