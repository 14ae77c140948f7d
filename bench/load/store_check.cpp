#include "bench/load/store_check.hpp"

#include <charconv>
#include <memory>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/tag_frame.hpp"
#include "journal/journal.hpp"

namespace gantry::bench {

namespace {
std::unique_ptr<journal::Reader> open(const std::filesystem::path& store) {
    auto reader = journal::Reader::open(store);
    if (!reader) throw Failure(reader.error().error.text());
    return std::move(*reader);
}

void query(const std::filesystem::path& store, const journal::Filter& filter,
           const std::function<bool(const event::Event&)>& each) {
    if (auto done = open(store)->query(filter, each); !done) throw Failure(done.error().error.text());
}

// Of "r-17": 16.
std::uint32_t index_of(const std::string& reader, const Fleet& fleet) {
    std::uint32_t number = 0;
    if (reader.starts_with("r-")) std::from_chars(reader.data() + 2, reader.data() + reader.size(), number);
    if (number == 0 || number > fleet.shape().readers)
        throw Failure(fmt::format("the store has an event of a reader \"{}\" that never was", reader));
    return number - 1;
}
}  // namespace

void check_reads(const std::filesystem::path& store, const Fleet& fleet) {
    auto records = fleet.shape().records;
    std::vector<std::uint64_t> stored(fleet.shape().readers);
    std::string wrong;
    journal::Filter filter;
    filter.types = {event::Type::tag_read};
    query(store, filter, [&](const event::Event& event) {
        auto reader = index_of(event.reader, fleet);
        auto number = stored[reader]++;
        auto frame = number / records;
        auto tag = tag_of(fleet.first_tag(reader, frame) + static_cast<std::uint32_t>(number % records));
        if (event.tag == tag && event.rssi == fleet.rssi(frame) * 10 && event.reads == 1 &&
            !event.possible_repeat)
            return true;
        wrong =
            fmt::format("event {}: read {} of {} is not what was sent", event.seq, number + 1, event.reader);
        return false;
    });
    if (!wrong.empty()) throw Failure(wrong);
    for (std::uint32_t i = 0; i < stored.size(); ++i) {
        auto least = fleet.frames_acknowledged(i) * records, most = fleet.frames_sent(i) * records;
        if (stored[i] < least || stored[i] > most)
            throw Failure(fmt::format("{}: {} reads acknowledged, {} sent, {} stored", Fleet::name(i), least,
                                      most, stored[i]));
    }
}

void check_presence(const std::filesystem::path& store, const Fleet& fleet) {
    auto& shape = fleet.shape();
    std::uint64_t expected = 0;
    for (std::uint32_t i = 0; i < shape.readers; ++i)
        expected += std::min<std::uint64_t>(fleet.frames_acknowledged(i), shape.turns) * shape.records;
    std::uint64_t came = 0, left = 0, present = 0;
    journal::Filter filter;
    filter.types = {event::Type::tag_new, event::Type::tag_lost, event::Type::tag_purged};
    query(store, filter, [&](const event::Event& event) {
        ++(event.type == event::Type::tag_new ? came : left);
        return true;
    });
    auto counted = open(store)->present_tags([&](const journal::PresentTag&) { return ++present > 0; });
    if (!counted) throw Failure(counted.error().error.text());
    if (came != expected || present != expected || left != 0)
        throw Failure(fmt::format("{} tags stood before the readers: {} came, {} are present, {} left",
                                  expected, came, present, left));
}

}  // namespace gantry::bench
