#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "event/event.hpp"
#include "reader/bank.hpp"
#include "wire/message.hpp"

namespace gantry {

// Work for a reader, the same for every make. What a make cannot do answers `unsupported`.
struct GetInputs {};  // values: list "inputs" of {input, state}
struct OutputChange {
    std::uint16_t output = 0;  // from 1
    bool state = false;
    std::uint32_t for_ms = 0;  // then back to the opposite state; 0: stays
};
struct SetOutputs {
    std::vector<OutputChange> changes;
};
struct RestartReader {};
struct StartReading {};  // inventory goes on after StopReading, also over reconnects
struct StopReading {};

// The tag that a job is for, and how to get at it. Addresses and lengths of tag jobs count in the units of
// the tag's memory: 16-bit words for Gen2, bytes for ISO 18000-6B, blocks for HF.
struct TagAccess {
    event::TagId tag;  // never empty
    event::Technology technology = event::Technology::epc_gen2;
    std::optional<std::uint16_t> antenna;  // as the make counts; nothing: whichever sees the tag
    std::uint32_t password = 0;            // access password
    std::uint8_t retries = 2;              // after the first try, when the tag did not answer
};
struct ReadTag {  // values: "data" bytes
    TagAccess access;
    Bank bank = Bank::user;
    std::uint32_t offset = 0, length = 1;
};
struct WriteTag {
    TagAccess access;
    Bank bank = Bank::user;
    std::uint32_t offset = 0;
    Bytes data;          // whole units
    bool verify = true;  // read back and compare
};
struct ProgramTag {  // gives the tag a new id
    TagAccess access;
    event::TagId new_id;
    std::uint16_t numbering_system = 0;  // Gen2 NSI: PC bits 17h to 1Fh
    bool verify = true;                  // seen under its new id
};
struct LockTag {
    // Gen2: 10 mask bits and 10 action bits as in the standard (kill password, access password, EPC, TID,
    // user; two bits each, most significant first). Other kinds: the address of the byte or block that is
    // locked for ever.
    TagAccess access;
    std::uint16_t mask = 0, action = 0;
    std::optional<std::uint32_t> address;
};
struct KillTag {
    TagAccess access;
    std::uint32_t kill_password = 0;
};

struct GetParameter {  // values: a field a parameter, by name
    std::string name;  // of Plugin::parameters; empty: all of them that can be read
    // The value that it has after the next power-up, where the reader keeps that one beside the one at work.
    bool permanent = false;
};
struct SetParameter {
    std::string name, value;  // as a person types it
    // Also over a power-down. A make whose readers cannot choose answers `unsupported`.
    bool permanent = false;
};
// Any command of the make's own tables, by name with its fields. values: the answer's fields.
struct Execute {
    wire::Message command;
};

using Job = std::variant<GetInputs, SetOutputs, RestartReader, StartReading, StopReading, ReadTag, WriteTag,
                         ProgramTag, LockTag, KillTag, GetParameter, SetParameter, Execute>;
// Would doing it twice be a change the user did not ask for? Such a job is never repeated blindly.
bool changes_something(const Job& job);

using JobId = std::uint64_t;

struct JobResult {
    enum class Status : std::uint8_t {
        done,
        failed,       // the reader refused or broke: `text` says what it said
        unsupported,  // this make or model has no such thing
        timed_out,    // no answer before the deadline: what the reader did is not known
        cancelled,    // never sent
        unknown,      // sent, but the link or the process died before the answer
    };
    Status status = Status::done;
    std::string text;     // for people; empty when done
    wire::Fields values;  // the typed result
};
std::string_view to_text(JobResult::Status status);

}  // namespace gantry
