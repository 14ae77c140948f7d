#pragma once
#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

#include "journal/journal.hpp"
#include "testkit/temp_dir.hpp"

// Shared by the tests of this module.
namespace gantry::journal::tests {

// In memory where the system has such a place: what is synced there is at once.
class Folder {
public:
    std::filesystem::path path() const { return dir_.path(); }
    std::filesystem::path store() const { return path() / "gantry.db"; }

private:
    static std::filesystem::path parent() {
        std::filesystem::path memory = "/dev/shm";
        return access(memory.c_str(), W_OK) == 0 ? memory : std::filesystem::temp_directory_path();
    }
    testkit::TempDir dir_{parent()};
};

inline const Wall start_time = *parse_rfc3339("2026-11-21T23:04:00.123456Z");

inline std::unique_ptr<Journal> open_store(const Options& options) {
    auto journal = Journal::open(options);
    if (!journal) throw std::runtime_error(journal.error().error.text());
    return std::move(*journal);
}
inline std::unique_ptr<Journal> open_store(const std::filesystem::path& path) {
    Options options;
    options.path = path;
    return open_store(options);
}

inline Batch next_batch(const Journal& journal, Wall time = start_time) {
    Batch batch;
    batch.time = time;
    batch.next_seq = journal.last_seq() + 1;
    return batch;
}

inline event::TagId tag_number(std::uint64_t number) {
    // SGTIN-96 of one product: only the serial number differs.
    auto bytes = *from_hex("3074257BF7194E4000000000");
    for (std::size_t i = 0; i < 4; ++i)
        bytes[11 - i] = static_cast<std::uint8_t>(number >> (8 * i));
    return event::TagId(bytes);
}

inline event::Event& add_event(Batch& batch, event::Type type, Wall time = start_time) {
    auto& event = batch.events.emplace_back();
    event.seq = batch.take_seq();
    event.type = type;
    event.time = time;
    return event;
}
inline event::Event& add_tag_event(Batch& batch, std::uint64_t tag, Wall time = start_time) {
    auto& event = add_event(batch, event::Type::tag_observed, time);
    event.technology = event::Technology::epc_gen2;
    event.tag = tag_number(tag);
    event.reader = "dock-1";
    event.antenna = "Ant0";
    event.zone = "dock";
    return event;
}
inline Read& add_read(Batch& batch, std::uint64_t tag, ReadPointId point, Wall time = start_time) {
    auto& read = batch.reads.emplace_back();
    read.seq = batch.take_seq();
    read.time = time;
    read.read_point = point;
    read.observation.tag = tag_number(tag);
    read.observation.technology = event::Technology::epc_gen2;
    read.observation.rssi = -528;
    return read;
}

inline std::vector<event::Event> read_all(const std::filesystem::path& path, const Filter& filter = {}) {
    auto reader = Reader::open(path);
    if (!reader) throw std::runtime_error(reader.error().error.text());
    std::vector<event::Event> events;
    auto done = (*reader)->query(filter, [&](const event::Event& event) {
        events.push_back(event);
        return true;
    });
    if (!done) throw std::runtime_error(done.error().error.text());
    return events;
}

inline std::vector<Seq> seqs_of(const std::vector<event::Event>& events) {
    std::vector<Seq> seqs;
    for (auto& event : events)
        seqs.push_back(event.seq);
    return seqs;
}

// Every member, for comparison and for messages.
inline std::string describe(const event::Event& e) {
    auto time = [](const std::optional<Wall>& t) { return t ? to_rfc3339(*t) : std::string("-"); };
    auto number = [](const auto& n) { return n ? std::to_string(*n) : std::string("-"); };
    std::string out;
    for (auto& part : {std::to_string(e.seq),
                       std::string(to_text(e.type)),
                       std::string(to_text(e.technology)),
                       std::to_string(e.possible_repeat),
                       to_rfc3339(e.time),
                       e.reader,
                       e.antenna,
                       e.zone,
                       to_hex(e.tag.view()),
                       e.epc,
                       e.gs1,
                       e.link,
                       to_hex(event::pc_words(e.pc).view()),
                       to_hex(event::xpc_words(e.xpc).view()),
                       number(e.rssi),
                       std::to_string(e.reads),
                       time(e.first_seen),
                       time(e.last_seen),
                       time(e.reader_time),
                       e.from,
                       e.to,
                       e.reason,
                       e.text,
                       number(e.code),
                       to_hex(e.bytes),
                       number(e.input),
                       number(e.state),
                       e.scope,
                       number(e.count),
                       time(e.since),
                       e.by,
                       to_hex(e.user),
                       to_hex(e.tid)})
        out += part + "|";
    return out;
}

}  // namespace gantry::journal::tests
