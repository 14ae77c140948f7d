#include "reader/faults.hpp"

#include <algorithm>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry {

static constexpr std::size_t most_late = 256 * 1024;  // bytes; what is over that comes earlier
static constexpr std::uint32_t most_garbage = 65'536;
static constexpr std::chrono::microseconds usual_slowness = 300ms, usual_jump = 1h;

// Words have been written with either.
static bool same_word(std::string_view known, std::string_view given) {
    return std::ranges::equal(known, given, {}, {}, [](char c) { return c == '_' ? '-' : c; });
}

bool means(const FaultWord& fault, std::string_view word) {
    return same_word(fault.word, word) || (!fault.alias.empty() && same_word(fault.alias, word));
}

std::string describe(const FaultWord& fault) {
    return fault.value.empty() ? std::string(fault.word) : fmt::format("{} {}", fault.word, fault.value);
}

tl::unexpected<Error> misunderstood(const FaultWord& fault, std::string_view value) {
    return fail(fmt::format("\"{} {}\" is not understood", fault.word, printable(value)),
                fault.value.empty() ? fmt::format("\"{}\" stands alone", fault.word)
                                    : fmt::format("write it like \"{}\"", describe(fault)));
}

tl::unexpected<Error> no_such_fault(std::string_view command, std::span<const FaultWord> known,
                                    std::span<const NoFault> impossible) {
    auto word = command.substr(0, command.find(' '));
    auto what = fmt::format("there is no fault \"{}\"", printable(command));
    for (auto& each : impossible)
        if (means(each.fault, word))
            what = fmt::format("a reader of this make cannot have the fault \"{}\": {}", each.fault.word,
                               each.why);
    std::string list;
    for (auto& fault : known)
        list += fmt::format("{}{}", list.empty() ? "known: " : ", ", describe(fault));
    return fail(std::move(what), std::move(list));
}

Result<void> fault_switch(bool& on, const FaultWord& fault, std::string_view value) {
    if (value != "" && value != "on" && value != "off") return misunderstood(fault, value);
    on = value != "off";
    return {};
}

Result<std::chrono::microseconds> fault_jump(std::string_view value) {
    if (value.empty()) return usual_jump;
    bool back = value.front() == '-';
    auto by = parse_duration(value.substr(back || value.front() == '+' ? 1 : 0));
    if (!by) return misunderstood(faults::clock_jump, value);
    return back ? -*by : *by;
}

static std::optional<std::uint32_t> number(std::string_view text) {
    std::uint32_t value = 0;
    auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size()) return {};
    return value;
}

Result<std::optional<std::uint16_t>> fault_antenna(std::string_view value, std::size_t antennas) {
    if (value == "off") return std::optional<std::uint16_t>{};
    auto which = value.empty() ? std::optional<std::uint32_t>{1} : number(value);
    if (!which || *which < 1 || *which > antennas)
        return fail(fmt::format("\"antenna-broken {}\" names no antenna", printable(value)),
                    antennas == 1
                        ? std::string("it has one: \"antenna-broken\", and \"antenna-broken off\"")
                        : fmt::format("1 to {}: \"antenna-broken 1\", and \"antenna-broken off\"", antennas));
    return std::optional<std::uint16_t>{static_cast<std::uint16_t>(*which)};
}

void LinkFaults::link_lost() {
    if (linked_) dropped_ = false;
    linked_ = half_open_ = false;
    forget();
}

void LinkFaults::forget() {
    late_.clear();
    late_bytes_ = 0;
}

Bytes LinkFaults::garbage(std::size_t size) {
    Bytes noise(size);
    for (auto& byte : noise) {
        random_ = random_ * 6364136223846793005u + 1442695040888963407u;
        byte = static_cast<std::uint8_t>(random_ >> 56);
    }
    return noise;
}

void LinkFaults::say(ByteView message, Now now, Bytes& out) {
    if (!linked_ || dropped_ || message.empty()) return;
    last_.assign(message.begin(), message.end());
    if (half_open_) return;
    if (garbage_next_ > 0) send(garbage(std::exchange(garbage_next_, 0)), now, out);
    if (!spoil_next_ && !truncate_next_ && !repeat_next_ && late_.empty() && slow_ == 0us) {
        out.insert(out.end(), message.begin(), message.end());
        return;
    }
    auto bytes = last_;
    if (std::exchange(spoil_next_, false)) spoil_(bytes);
    if (std::exchange(truncate_next_, false)) bytes.resize(bytes.size() / 2);
    send(std::move(bytes), now, out);
    if (std::exchange(repeat_next_, false)) send(Bytes(last_), now, out);
}

// In order, also when it has become faster meanwhile.
void LinkFaults::send(Bytes message, Now now, Bytes& out) {
    if (slow_ == 0us && late_.empty()) {
        out.insert(out.end(), message.begin(), message.end());
        return;
    }
    auto due = now.steady + slow_;
    if (!late_.empty()) due = std::max(due, late_.back().due);
    late_bytes_ += message.size();
    late_.push_back({std::move(message), due});
    while (late_bytes_ > most_late && late_.size() > 1)
        time_passed({late_.front().due, now.wall}, out);
}

std::optional<Steady> LinkFaults::deadline() const {
    if (late_.empty()) return {};
    return late_.front().due;
}

void LinkFaults::time_passed(Now now, Bytes& out) {
    while (!late_.empty() && now.steady >= late_.front().due) {
        auto& message = late_.front().message;
        if (!half_open_) out.insert(out.end(), message.begin(), message.end());
        late_bytes_ -= message.size();
        late_.pop_front();
    }
}

Result<void> LinkFaults::inject(const FaultCall& call, Bytes& out) {
    // What somebody does to a link that is dead is lost; where there is none it waits.
    bool dead = linked_ && deaf();
    if (call.word == faults::drop.word) {
        dropped_ = true;
    } else if (call.word == faults::half_open.word) {
        return fault_switch(half_open_, faults::half_open, call.value);
    } else if (call.word == faults::slow.word) {
        auto by = call.value == "off"                        ? std::optional<std::chrono::microseconds>{0us}
                  : call.value.empty() || call.value == "on" ? usual_slowness
                                                             : parse_duration(call.value);
        if (!by) return misunderstood(faults::slow, call.value);
        slow_ = *by;
    } else if (call.word == faults::garbage.word) {
        auto size = call.value.empty() ? std::optional<std::uint32_t>{64} : number(call.value);
        if (!size || *size > most_garbage)
            return fail(fmt::format("\"garbage {}\" is not understood", printable(call.value)),
                        fmt::format("up to {} bytes: \"garbage 64\"", most_garbage));
        if (!linked_)
            garbage_next_ = *size;
        else if (!dead)
            send(garbage(*size), call.now, out);
    } else if (call.word == faults::bad_crc.word) {
        spoil_next_ = true;
    } else if (call.word == faults::truncated.word) {
        truncate_next_ = true;
    } else if (call.word == faults::duplicate.word) {
        if (!linked_ || last_.empty())
            repeat_next_ = true;
        else if (!dead)
            send(Bytes(last_), call.now, out);
    }
    return {};
}

}  // namespace gantry
