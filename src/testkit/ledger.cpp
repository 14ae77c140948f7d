#include "testkit/ledger.hpp"

#include <map>

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace gantry::testkit {

namespace {
constexpr std::uint8_t magic[2] = {0x1E, 0xD6};  // no EPC header: these ids decode to nothing
}  // namespace

event::TagId numbered_tag(std::uint32_t reader, std::uint64_t number) {
    Bytes id(magic, magic + 2);
    for (int shift = 24; shift >= 0; shift -= 8)
        id.push_back(static_cast<std::uint8_t>(reader >> shift));
    for (int shift = 40; shift >= 0; shift -= 8)
        id.push_back(static_cast<std::uint8_t>(number >> shift));
    return event::TagId(id);
}

std::optional<Numbered> number_of(const event::TagId& tag) {
    if (tag.size != 12 || tag.data[0] != magic[0] || tag.data[1] != magic[1]) return {};
    Numbered out;
    for (std::size_t i = 2; i < 6; ++i)
        out.reader = out.reader << 8 | tag.data[i];
    for (std::size_t i = 6; i < 12; ++i)
        out.number = out.number << 8 | tag.data[i];
    return out;
}

void NumberingAir::inventory(const Carrier& carrier, Steady from, Steady to, std::vector<AirSighting>& out) {
    if (carrier.antenna != 1) return;
    std::lock_guard lock(mutex_);
    if (!start_) start_ = from;
    while (!stopped_) {
        auto offset = std::chrono::duration<double>(static_cast<double>(generated_) / rate_);
        auto at = *start_ + std::chrono::duration_cast<Steady::duration>(offset);
        if (at >= to) break;
        out.push_back({.tag = numbered_tag(reader_, ++generated_), .rssi = -500, .at = std::max(at, from)});
    }
}

std::uint64_t NumberingAir::generated() const {
    std::lock_guard lock(mutex_);
    return generated_;
}

void NumberingAir::stop() {
    std::lock_guard lock(mutex_);
    stopped_ = true;
}

std::string Ledger::text() const {
    return fmt::format("stored {}, lost {}, doubled {}, invented {}, marked {}, gaps in seq {}", stored, lost,
                       doubled, invented, marked, seq_gaps);
}

Ledger check_ledger(const std::string& path, const std::vector<Claim>& claims) {
    Ledger ledger;
    std::map<std::uint32_t, std::vector<std::uint8_t>> times;  // per reader, how often each number is there
    for (auto& claim : claims)
        times[claim.reader].resize(claim.generated + 1);
    auto store = journal::Reader::open(path);
    if (!store) {
        ADD_FAILURE() << store.error().error.text();
        return ledger;
    }
    journal::Seq expected = 0;
    auto read = (*store)->query({}, [&](const event::Event& event) {
        if (expected != 0 && event.seq != expected) ++ledger.seq_gaps;
        expected = event.seq + 1;
        auto numbered = event.type == event::Type::tag_read ? number_of(event.tag) : std::nullopt;
        if (!numbered) return true;
        ++ledger.stored;
        auto reader = times.find(numbered->reader);
        if (reader == times.end() || numbered->number == 0 || numbered->number >= reader->second.size()) {
            ++ledger.invented;
            return true;
        }
        if (event.possible_repeat)
            ++ledger.marked;
        else if (++reader->second[numbered->number] == 2)
            ++ledger.doubled;
        return true;
    });
    if (!read) ADD_FAILURE() << read.error().error.text();
    for (auto& claim : claims)
        for (std::uint64_t number = 1; number <= claim.acknowledged; ++number)
            if (times[claim.reader][number] == 0) ++ledger.lost;
    return ledger;
}

}  // namespace gantry::testkit
