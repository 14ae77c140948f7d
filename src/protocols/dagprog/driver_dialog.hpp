#pragma once
#include <map>
#include <optional>
#include <string>

#include "protocols/dagprog/crc8.hpp"
#include "protocols/dagprog/line.hpp"
#include "protocols/dagprog/walker.hpp"
#include "reader/driver.hpp"

// What the parts of the driver share: a command to send, what came back, what is known of the unit.
namespace gantry::dagprog {

// FaultNotice::code of what the driver itself has to say; the unit's own numbers are above 0.
inline constexpr std::int64_t fault_malformed = -1;
inline constexpr std::int64_t fault_restarted = -2;
inline constexpr std::int64_t fault_setting = -3;
inline constexpr std::int64_t fault_reading = -4;

// Section 6 gives no times; these are its suggestions.
inline constexpr std::chrono::milliseconds answer_time{500}, write_time{2000}, field_off_time{100};

// One thing to do on the line.
struct Request {
    enum class Until : std::uint8_t {
        answer,     // a line of `code`, or "unknown command"
        serial,     // a serial number
        written,    // a serial number and the block, or a result
        detection,  // what the transmission mode sends of one tag
        time,       // only time passes
    };
    Bytes line = {};  // to send; may be empty
    Until until = Until::answer;
    Code code = Code::empty;
    std::chrono::microseconds patience = answer_time;
    unsigned tries = 1;  // in silence; questions are asked twice
};

struct Reply {
    enum class What : std::uint8_t { answered, refused, silent };
    What what = What::silent;
    std::vector<std::string> values = {};  // of the answer, as they stand in it
    std::optional<Serial> serial = {};
    std::optional<Bytes> block = {};
    std::optional<std::int64_t> error = {};  // "ER" while it was waited for

    bool ok() const { return what == What::answered; }
    std::string words() const;  // of one that is not ok
};

// The registers of a unit that readings depend on.
struct Registers {
    std::optional<std::uint32_t> first_block = {}, block_count = {}, transmit = {};
    std::optional<std::uint32_t>& at(Code code) {
        return code == Code::first_block ? first_block : code == Code::block_count ? block_count : transmit;
    }
    std::optional<std::uint32_t> at(Code code) const {
        return code == Code::first_block ? first_block : code == Code::block_count ? block_count : transmit;
    }
    friend bool operator==(const Registers&, const Registers&) = default;
};

struct UnitState {
    std::optional<Family> family = {};
    std::string version = {}, banner = {};
    Forms forms = {};
    bool proven = false;  // the form of values: without that nothing is set or written
    Registers now = {}, wanted = {};
    std::optional<Code> reading = {};  // the mode that it is in
    bool save_pending = false;         // SV was sent: the next parameter is kept for good
    bool rewrites_system_blocks = false;
    ByteOrder order = ByteOrder::automatic;
    const Crc8Row* crc8 = nullptr;  // as configured
    Crc8Finder finder = {};

    Family kind() const { return family.value_or(Family::iso15693); }
    bool sends_serials() const { return (wanted.transmit.value_or(0) & transmit_serial) != 0; }
    bool reads_by_asking = false;  // mode `as`

    bool differs(Code code) const { return wanted.at(code) && wanted.at(code) != now.at(code); }
    bool must_be_set_up() const {  // and may be: what is set after SV would be kept for good
        return proven && !save_pending &&
               (differs(Code::first_block) || differs(Code::block_count) || differs(Code::transmit));
    }

    // Commands in the unit's own form.
    Request ask(Code code) const;
    Request set(Code code, std::uint32_t value) const;
    Request write(Code code, std::uint32_t block, ByteView data) const;
};
inline constexpr std::string_view not_proven =
    "how this unit wants values to be written is not known, so nothing is set or written; "
    "the reader's `separator` setting can say it";

// The number that an answer carries.
std::optional<std::uint32_t> number_in(const Reply& reply);

// Lets a text through once a minute, and says then how often it was held back: what a unit sends must not
// fill the store with faults.
class OncePerMinute {
public:
    static constexpr std::size_t most_texts = 16;  // in one minute

    std::optional<std::string> pass(std::string text, Steady now);

private:
    struct Told {
        Steady at;
        std::uint64_t held = 0;
    };
    std::map<std::string, Told> told_;
};

// Something that takes several requests, one after another.
class Task {
public:
    virtual ~Task() = default;
    Task() = default;
    Task(const Task&) = delete;
    Task& operator=(const Task&) = delete;
    // The next one, asked for when the one before was answered; nothing: over.
    virtual std::optional<Request> next() = 0;
    virtual void answered(const Reply& reply) = 0;
    // What the user must know of how it went; empty: nothing.
    struct Trouble {
        std::int64_t code = 0;
        std::string text;
    };
    std::vector<Trouble> troubles = {};
};

}  // namespace gantry::dagprog
