#pragma once
#include <array>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "base/time.hpp"

// What can go wrong with a virtual reader, by the same words for every make. A make says which of them it can
// have, and adds words of its own.
namespace gantry {

struct FaultWord {
    std::string_view word;   // "half-open"; "half_open" is understood as well
    std::string_view value;  // what may follow it: "on|off"; empty: nothing
    std::string_view help;   // one line
    std::string_view alias = {};
};

namespace faults {
inline constexpr FaultWord drop{"drop", "", "the link ends, once"};
inline constexpr FaultWord half_open{
    "half-open", "on|off",
    "nothing comes out and nothing goes in while the link seems to be there; ends with that link"};
inline constexpr FaultWord garbage{"garbage", "N", "sends N bytes that mean nothing (64)"};
inline constexpr FaultWord bad_crc{"bad-crc", "", "the next message has a wrong checksum"};
inline constexpr FaultWord truncated{"truncated", "", "of the next message the second half is missing",
                                     "truncate"};
inline constexpr FaultWord duplicate{"duplicate", "", "sends its last message again"};
inline constexpr FaultWord slow{"slow", "TIME|off", "all that it sends comes so much later (300ms)"};
inline constexpr FaultWord stuck_ack{"stuck-ack", "on|off", "acknowledgements get lost"};
inline constexpr FaultWord reboot{"reboot", "", "it restarts: what is only in its RAM is gone", "restart"};
inline constexpr FaultWord clock_jump{"clock-jump", "+TIME|-TIME", "its clock is set wrong by so much (+1h)",
                                      "clock"};
inline constexpr FaultWord antenna_broken{"antenna-broken", "N|off",
                                          "an antenna hears nothing any more (1); off: all do again"};
inline constexpr FaultWord buffer_full{"buffer-full", "", "its memory for tags is full, and tags are lost",
                                       "overflow"};

inline constexpr std::array common = {drop, half_open, garbage, bad_crc,        truncated,  duplicate,
                                      slow, stuck_ack, reboot,  antenna_broken, clock_jump, buffer_full};
}  // namespace faults

// What happens once waits for the first link. A restart would end that before anybody had noticed it.
inline constexpr auto reboot_after = 1s;

// A common word that a make cannot have, and why.
struct NoFault {
    FaultWord fault;
    std::string_view why;  // "its messages have no checksum"
};

// A word as somebody typed it, cut at its first blank.
struct FaultCall {
    std::string_view word, value;
    Now now;
};
bool means(const FaultWord& fault, std::string_view word);
std::string describe(const FaultWord& fault);  // "half-open on|off"
tl::unexpected<Error> misunderstood(const FaultWord& fault, std::string_view value);
tl::unexpected<Error> no_such_fault(std::string_view command, std::span<const FaultWord> known,
                                    std::span<const NoFault> impossible);

// Values of faults. Nothing given means what the word's help says.
Result<void> fault_switch(bool& on, const FaultWord& fault, std::string_view value);  // "on", "off", ""
Result<std::chrono::microseconds> fault_jump(std::string_view value);                 // "+1h", "-5min", ""
// "2" is 2, "off" nothing: which antenna of so many is broken from now on.
Result<std::optional<std::uint16_t>> fault_antenna(std::string_view value, std::size_t antennas);

// One word of a virtual reader and what it does.
template <class Reader>
struct FaultRow {
    FaultWord fault;
    Result<void> (Reader::*inject)(const FaultCall& call);
};

template <class Reader>
Result<void> inject_by(Reader& reader, std::span<const FaultRow<Reader>> rows,
                       std::span<const FaultWord> words, std::span<const NoFault> impossible,
                       std::string_view command, Now now) {
    auto blank = command.find(' ');
    auto word = command.substr(0, blank);
    auto value = blank == std::string_view::npos ? std::string_view{} : command.substr(blank + 1);
    for (auto& row : rows) {
        if (!means(row.fault, word)) continue;
        if (row.fault.value.empty() && !value.empty()) return misunderstood(row.fault, value);
        return (reader.*row.inject)({row.fault.word, value, now});
    }
    return no_such_fault(command, words, impossible);
}

template <class Reader, std::size_t count>
constexpr std::array<FaultWord, count> words_of(const std::array<FaultRow<Reader>, count>& rows) {
    std::array<FaultWord, count> words{};
    for (std::size_t i = 0; i < count; ++i)
        words[i] = rows[i].fault;
    return words;
}

// What goes wrong with one link of a virtual reader, between what it says and its output: drop, half-open,
// garbage, bad-crc, truncated, duplicate, slow. What happens once waits for a link where there is none.
class LinkFaults {
public:
    using Spoil = void (*)(Bytes& message);  // makes the checksum of a whole message wrong
    explicit LinkFaults(std::uint64_t seed, Spoil spoil = &spoil_last)
        : random_(seed * 2 + 1), spoil_(spoil) {}

    void link_up() { linked_ = true; }
    void link_lost();
    void forget();                                         // what is late: the reader has restarted
    bool dropped() const { return linked_ && dropped_; }   // the link is to end now
    bool deaf() const { return half_open_ || dropped(); }  // take no input then

    // One whole message: goes to `out` now or later, whole or not, or nowhere.
    void say(ByteView message, Now now, Bytes& out);
    std::optional<Steady> deadline() const;
    void time_passed(Now now, Bytes& out);
    std::size_t late() const { return late_bytes_; }  // bytes that are not in the output yet

    Result<void> inject(const FaultCall& call, Bytes& out);

private:
    static void spoil_last(Bytes& message) { message.back() ^= 0x5A; }
    void send(Bytes message, Now now, Bytes& out);
    Bytes garbage(std::size_t size);

    struct Late {
        Bytes message;
        Steady due;
    };
    std::uint64_t random_;
    Spoil spoil_;
    bool linked_ = false, dropped_ = false, half_open_ = false;
    bool spoil_next_ = false, truncate_next_ = false, repeat_next_ = false;
    std::size_t garbage_next_ = 0;
    std::chrono::microseconds slow_{};
    std::deque<Late> late_;
    std::size_t late_bytes_ = 0;
    Bytes last_;
};

}  // namespace gantry
