#pragma once
#include "protocols/harting/device_notify.hpp"
#include "protocols/harting/device_reading.hpp"
#include "protocols/harting/device_state.hpp"

// How a virtual reader does what it is asked: a handler for each command, told only what it needs.
namespace gantry::harting {

class HostInventory;

struct Call {
    ByteView data;  // what follows CONTROL
    ReaderState& reader;
    Reading& reading;
    Notifier& notifier;
    HostInventory& inventory;
    std::size_t& buffer_read;  // sets that the last [0x22] has given
    Now now;
    Bytes answer = {};        // the data of the reply
    bool restart = false;     // when the reply is out
    bool takes_time = false;  // the reply comes when the inventory is over
};
using Handler = Status (*)(Call& call);

struct HandlerRow {
    Command command;
    Handler handler;
};
// By subject; each in its own file.
std::span<const HandlerRow> control_handlers();
std::span<const HandlerRow> config_handlers();
std::span<const HandlerRow> info_handlers();
std::span<const HandlerRow> inventory_handlers();
std::span<const HandlerRow> tag_handlers();
std::span<const HandlerRow> buffer_handlers();
Handler find_handler(Command command);  // nullptr: there is none

// CFG0: is the block closed until somebody logs in?
bool is_locked(const ReaderState& reader, std::size_t block);

}  // namespace gantry::harting
