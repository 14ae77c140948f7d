#pragma once
#include <chrono>
#include <map>
#include <optional>
#include <string>

#include "protocols/harting/config.hpp"
#include "protocols/harting/tables.hpp"
#include "reader/reports.hpp"

// What the parts of the driver share: a command to send, what came back, and what is known of the reader.
namespace gantry::harting {

// FaultNotice::code of what the driver itself has to say; a reader's own status bytes are above 0.
inline constexpr std::int64_t fault_malformed = -1;
inline constexpr std::int64_t fault_setting = -2;
inline constexpr std::int64_t fault_reading = -3;
inline constexpr std::int64_t fault_notifications = -4;
inline constexpr std::int64_t fault_hardware = -5;

struct Request {
    static constexpr std::chrono::seconds usual_patience{3};
    static constexpr std::chrono::seconds radio_patience{10};  // commands that wait for tags

    std::uint8_t control = 0;
    Bytes data = {};  // with the sub command
    std::chrono::microseconds patience = usual_patience;

    // `parameters` follow the sub command, where there is one.
    explicit Request(Command command, Bytes parameters = {});
    Request(std::uint8_t code, Bytes all_data) : control(code), data(std::move(all_data)) {}
    const CommandRow* row() const { return find_request(control, data); }
    bool is(Command command) const;
    std::string_view name() const;
};
Request read_block(std::uint8_t number, bool eeprom = false);
Request write_block(std::uint8_t number, const Block& block, bool eeprom = false);

// What became of a request. The views live as long as the call that hands it over.
struct Reply {
    bool silent = false;  // no answer in time
    std::uint8_t status = 0;
    ByteView data = {};

    bool is(Status wanted) const { return !silent && status == static_cast<std::uint8_t>(wanted); }
    bool ok() const { return is(Status::ok); }
    bool carries_data() const { return !silent && has_data(status) && !data.empty(); }
    // It has no such command, or not in the way it works now.
    bool lacks() const { return is(Status::unknown_command) || is(Status::command_not_available); }
    std::optional<Block> block() const;  // of a read block
    std::string words() const;           // "no transponder in the field (0x01)", "no answer"
};

// How the user wants tags to be read.
enum class Way : std::uint8_t { host, buffered, notification, scan, keep };

struct KnownReader {
    std::string model = {}, firmware = {};
    std::uint16_t receive_limit = 0, send_limit = 0;  // RX-BUF, TX-BUF; 0: not said
    unsigned inputs = 2, outputs = 2, relays = 1;     // until the reader says
    bool has_clock_date = true;
    Block interface = {};  // CFG1 as we left it in RAM
    bool interface_known = false;
    std::map<std::uint8_t, Block> set = {};  // other blocks that the settings are in, as they are in RAM
    Block read_data = {};                    // CFG11 in RAM
    Block scan_format = {};                  // CFG13 in RAM
    std::optional<bool> tids = {};           // inventories carry EPC and TID; nothing: none was seen yet
    std::uint8_t antennas = 0;               // bit field of those that are read; 0: all

    Mode mode() const;
    Bank block_bank() const;
    void keep(std::uint8_t number, const Block& block);  // this block is at work in RAM
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

}  // namespace gantry::harting
