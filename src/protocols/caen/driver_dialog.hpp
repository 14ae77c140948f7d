#pragma once
#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "protocols/caen/message.hpp"
#include "reader/reports.hpp"

// What the parts of the driver share: a command to send, what came back, what is known of the reader, and the
// reports that grow while input is taken.
namespace gantry::caen {

// FaultNotice::code of what the driver itself has to say; a reader's own result codes are above 0.
inline constexpr std::int64_t fault_malformed = -1;
inline constexpr std::int64_t fault_setting = -2;
inline constexpr std::int64_t fault_reading = -3;
inline constexpr std::int64_t fault_notifications = -4;

struct Request {
    // Vendor code gives a reader 5 s for an answer; a first inventory can take 10 s (section 1). Of later
    // ones CaenDriver::inventory_patience().
    static constexpr std::chrono::seconds usual_patience{5};
    static constexpr std::chrono::seconds first_inventory_patience{12};

    std::uint16_t command = 0;
    Bytes pairs = {};  // after the command
    std::chrono::microseconds patience = usual_patience;

    explicit Request(Command code) : command(static_cast<std::uint16_t>(code)) {}
    Request(std::uint16_t code, Bytes ready) : command(code), pairs(std::move(ready)) {}
    Request& number(Attribute attribute, std::uint64_t value);
    Request& text(Attribute attribute, std::string_view value);
    Request& bytes(Attribute attribute, ByteView value);
    bool is(Command code) const { return command == static_cast<std::uint16_t>(code); }
    std::string_view name() const;
};

// What became of a request. The views live as long as the call that hands it over.
struct Reply {
    bool silent = false;  // no answer in time
    Parsed parsed = {};
    ByteView message = {};

    bool ok() const { return !silent && parsed.result == 0; }
    bool is(ResultCode code) const { return !silent && parsed.result == static_cast<std::uint16_t>(code); }
    // It has no such command: 206 from a model without it, 127 from one that never heard of it.
    bool lacks() const { return is(ResultCode::invalid_function) || is(ResultCode::invalid_command); }
    std::string words() const;  // "tag not present (202)", "no answer"
};

// A logical source that is read.
struct Source {
    std::string name;
    std::vector<std::string> read_points = {};  // that the settings give it; empty: as the reader has it
    bool composed = false;                      // the settings name its read points
};

struct ReaderState {
    const ModelRow* model = nullptr;  // nullptr: not known, and its answers tell what it has
    std::vector<Source> sources = {};
    std::optional<std::int64_t> protocol = {};

    bool has(Command command) const { return model == nullptr || caen::has(*model, row_of(command)); }
    std::string model_name() const { return model != nullptr ? std::string(model->name) : "this model"; }
    // Keeps track of what an answered command has changed.
    void learn(const Request& request, const Reply& reply);
};

// Something that takes several commands, one after another.
class Task {
public:
    virtual ~Task() = default;
    Task() = default;
    Task(const Task&) = delete;
    Task& operator=(const Task&) = delete;
    // The next command, asked for when the one before was answered; nothing: over.
    virtual std::optional<Request> next(Now now) = 0;
    virtual void answered(const Reply& reply, Now now) = 0;
};

}  // namespace gantry::caen
