#include "passing_air.hpp"

#include <algorithm>
#include <chrono>

#include "testkit/ledger.hpp"

namespace gantry::ledger {

namespace {
constexpr std::size_t most_remembered = 8;
constexpr std::int16_t strength = -500;

Steady::duration interval_of(double reads_per_second) {
    return std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(1 / reads_per_second));
}

// E0, two bytes of the reader's number, five of the tag's: an ISO15693 serial number begins with E0.
event::TagId hf_tag(std::uint32_t reader, std::uint64_t number) {
    Bytes id{0xE0, static_cast<std::uint8_t>(reader >> 8), static_cast<std::uint8_t>(reader)};
    for (int shift = 32; shift >= 0; shift -= 8)
        id.push_back(static_cast<std::uint8_t>(number >> shift));
    return event::TagId(id);
}
}  // namespace

PassingAir::PassingAir(Kind kind, std::uint32_t reader, double reads_per_second, std::uint64_t most)
    : kind_(kind), reader_(reader), most_(most), interval_(interval_of(reads_per_second)) {}

AirSighting PassingAir::next(Steady at) {
    ++passed_;
    if (kind_ == Kind::uhf)
        return {.tag = testkit::numbered_tag(reader_, passed_), .rssi = strength, .at = at};
    return {.tag = hf_tag(reader_, passed_),
            .technology = event::Technology::iso15693,
            .rssi = strength,
            .at = at};
}

void PassingAir::inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) {
    if (carrier.antenna != 1) return;
    std::lock_guard lock(mutex_);
    for (auto& each : remembered_)
        if (each.at >= from && each.at < to) out.push_back(each);
    auto fresh = heard_to_ ? std::max(from, *heard_to_) : from;
    if (fresh >= to) return;
    // After a pause the next tag is not late: none passed meanwhile.
    next_at_ = next_at_ ? std::max(*next_at_, fresh) : fresh;
    for (; *next_at_ < to && passing_ && (most_ == 0 || passed_ < most_); *next_at_ += interval_) {
        out.push_back(next(*next_at_));
        if (kind_ == Kind::hf) remembered_.push_back(out.back());
    }
    while (remembered_.size() > most_remembered)
        remembered_.pop_front();
    heard_to_ = to;
    if (!passing_) next_at_.reset();
}

AirResult<Bytes> PassingAir::read(const AirAccess& access, Bank /*bank*/, std::uint32_t /*word*/,
                                  std::uint32_t words) {
    std::lock_guard lock(mutex_);
    if (kind_ == Kind::uhf ||
        std::ranges::find(remembered_, access.tag, &AirSighting::tag) == remembered_.end())
        return tl::unexpected(AirError::no_tag);
    return Bytes(2 * std::size_t{words});
}

std::uint64_t PassingAir::passed() const {
    std::lock_guard lock(mutex_);
    return passed_;
}

void PassingAir::set_rate(double reads_per_second) {
    std::lock_guard lock(mutex_);
    interval_ = interval_of(reads_per_second);
}

void PassingAir::begin() {
    std::lock_guard lock(mutex_);
    passing_ = true;
}

void PassingAir::stop() {
    std::lock_guard lock(mutex_);
    passing_ = false;
}

}  // namespace gantry::ledger
