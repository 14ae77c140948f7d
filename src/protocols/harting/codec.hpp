#pragma once
#include "wire/message.hpp"

namespace gantry::harting {

// The wire::Codec of this protocol. Header members:
//   "address"  COM-ADR
//   "status"   of replies, by name where it has one
//   "frame"    "short" for the frame of older readers, which an RF-R400 neither takes nor sends
//   "code"     CONTROL of an Unknown message, whose data are raw
// Replies to [0xB0] and [0xB3] do not say which sub command they answer: they are Inventory or
// ReadMultipleBlocks where their data are nothing else, else HostCommand or EpcCommand with raw data. Data
// that do not fit their command are raw, too: the field "Data".
const wire::Codec& codec();

inline constexpr std::string_view unknown_name = "Unknown", host_command_name = "HostCommand",
                                  epc_command_name = "EpcCommand", sub_command_field = "SUB-COMMAND";

struct CommandRow;
// Would a reader take this request? Its fields are known to encode.
wire::Result<void> check_request(const CommandRow& row, const wire::Fields& fields);

}  // namespace gantry::harting
