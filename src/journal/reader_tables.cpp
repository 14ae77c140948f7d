// What a reader finds beside events: tags present, cursors, dead letters.
#include <limits>

#include <fmt/format.h>

#include "base/text.hpp"
#include "journal/reader_impl.hpp"

namespace gantry::journal {

StoreResult<void> Reader::present_tags(const std::function<bool(const PresentTag&)>& each) const {
    // Slices here as well: the consumer may be slow.
    constexpr std::int64_t slice = 1000;
    auto rows = impl_->db.prepare(
        "SELECT r.id, r.tag, r.technology, r.epc, p.zone, p.reader, p.antenna, r.first_seen_us, "
        "r.last_seen_us, "
        "r.reads, r.rssi, r.pc, r.xpc FROM presence r LEFT JOIN read_points p ON p.id = r.read_point "
        "WHERE r.id > ?1 AND r.state IN (1, 2) ORDER BY r.id LIMIT ?2");
    if (!rows) return tl::unexpected(rows.error());
    std::int64_t after = std::numeric_limits<std::int64_t>::min();
    std::vector<PresentTag> found;
    do {
        found.clear();
        rows->bind(1, after).bind(2, slice);
        Step step;
        while ((step = rows->step()) == Step::row) {
            after = rows->number(0);
            auto& tag = found.emplace_back();
            auto id = rows->blob(1);
            if (id.size() > event::TagId::max_size)
                return impl_->damage(fmt::format("presence row {} is not as it was stored", after));
            tag.tag = event::TagId(id);
            tag.technology = static_cast<event::Technology>(rows->number(2));
            tag.epc = rows->text(3);
            tag.zone = rows->text(4);
            tag.reader = rows->text(5);
            tag.antenna = rows->text(6);
            tag.first_seen = from_us(rows->number(7));
            tag.last_seen = from_us(rows->number(8));
            tag.reads = static_cast<std::uint64_t>(rows->number(9));
            if (!rows->is_null(10)) tag.rssi = static_cast<std::int16_t>(rows->number(10));
            tag.pc = static_cast<std::uint16_t>(rows->number(11));
            tag.xpc = static_cast<std::uint32_t>(rows->number(12));
        }
        if (step == Step::failed) return impl_->failed();
        rows->reset();
        for (auto& tag : found)
            if (!each(tag)) return {};
    } while (found.size() == static_cast<std::size_t>(slice));
    return {};
}

StoreResult<std::optional<Seq>> Reader::cursor(std::string_view sink) const {
    auto row = impl_->db.prepare("SELECT seq FROM cursors WHERE sink = ?1");
    if (!row) return tl::unexpected(row.error());
    switch (row->bind(1, sink).step()) {
        case Step::row:
            return static_cast<Seq>(row->number(0));
        case Step::done:
            return std::optional<Seq>{};
        case Step::failed:
            break;
    }
    return impl_->failed();
}

StoreResult<std::uint64_t> Reader::count_dead_letters(std::string_view sink) const {
    auto row = impl_->db.prepare("SELECT count(*) FROM dead_letters WHERE sink = ?1");
    if (!row) return tl::unexpected(row.error());
    if (row->bind(1, sink).step() != Step::row) return impl_->failed();
    return static_cast<std::uint64_t>(row->number(0));
}

StoreResult<void> Reader::dead_letters(std::string_view sink, Seq after,
                                       const std::function<bool(const DeadLetter&)>& each) const {
    // Whoever looks for one should not read hundreds.
    constexpr std::int64_t first_slice = 4, longest_slice = 512;
    auto rows = impl_->db.prepare(
        fmt::format("{} WHERE sink = ?1 AND seq > ?2 ORDER BY seq LIMIT ?3", select_dead_letters));
    if (!rows) return tl::unexpected(rows.error());
    std::vector<DeadLetter> found;
    std::uint64_t broken = 0;
    bool more = true;
    for (auto slice = first_slice; more; slice = longest_slice) {
        found.clear();
        std::int64_t read = 0;
        rows->bind(1, sink).bind(2, storable(after)).bind(3, slice);
        Step step;
        while ((step = rows->step()) == Step::row) {
            ++read;
            DeadLetter letter;
            bool sound = take(*rows, letter).sound();
            after = letter.seq;
            if (sound)
                found.push_back(std::move(letter));
            else
                ++broken;
        }
        if (step == Step::failed) return impl_->failed();
        rows->reset();
        for (auto& letter : found)
            if (!each(letter)) return {};
        more = read == slice;
    }
    if (broken != 0)
        return impl_->damage(
            fmt::format("{} dead letters of {} are not as they were stored", broken, printable(sink)));
    return {};
}

}  // namespace gantry::journal
