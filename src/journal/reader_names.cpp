// What the events of a query name by number: read points and tags, looked up once and kept.
#include <fmt/format.h>

#include "base/text.hpp"
#include "journal/reader_impl.hpp"

namespace gantry::journal {

namespace {
constexpr std::size_t most_cached_tags = 50'000;  // twice: of late and before
}

StoreResult<bool> Reader::Impl::wanted_point(Plan& plan, ReadPointId id) {
    auto& filter = plan.filter;
    if (filter.reader.empty() && filter.zone.empty()) return true;
    if (id < plan.points.size() && plan.points[id] >= 0) return plan.points[id] == 1;
    auto names = point(id);
    if (!names) return tl::unexpected(names.error());
    bool wanted = (filter.reader.empty() || matches(filter.reader, (*names)->reader)) &&
                  (filter.zone.empty() || matches(filter.zone, (*names)->zone));
    if (id >= plan.points.size()) plan.points.resize(id + 1, -1);
    plan.points[id] = wanted ? 1 : 0;
    return wanted;
}

StoreResult<const ReadPoint*> Reader::Impl::point(ReadPointId id) {
    static const ReadPoint nowhere;
    if (id == 0) return &nowhere;
    if (id < points.size() && points[id]) return &*points[id];
    ReadPoint names;
    ReadPointId stored_id = 0;
    auto step = find_point.bind(1, std::int64_t{id}).step();
    bool intact = step == Step::row && take(find_point, stored_id, names).sound();
    if (step == Step::failed) {
        auto error = failed();
        find_point.reset();
        return error;
    }
    find_point.reset();
    if (!intact) return damage(fmt::format("read point {} is not as it was stored", id));
    if (id >= points.size()) points.resize(id + 1);
    points[id] = std::move(names);
    return &*points[id];
}

StoreResult<std::shared_ptr<const TagRow>> Reader::Impl::tag(std::uint64_t id) {
    if (auto it = tags.find(id); it != tags.end()) return it->second;
    if (auto it = tags_before.find(id); it != tags_before.end()) {
        auto row = it->second;
        keep_tag(id, row);
        return row;
    }
    auto row = std::make_shared<TagRow>();
    auto step = find_tag.bind(1, storable(id)).step();
    bool intact = step == Step::row && take(find_tag, *row).sound();
    if (step == Step::failed) {
        auto error = failed();
        find_tag.reset();
        return error;
    }
    find_tag.reset();
    if (!intact) return damage(fmt::format("tag row {} is not as it was stored", id));
    std::shared_ptr<const TagRow> shared = std::move(row);
    keep_tag(id, shared);
    return shared;
}

void Reader::Impl::keep_tag(std::uint64_t id, std::shared_ptr<const TagRow> row) {
    if (tags.size() >= most_cached_tags) {
        tags_before.clear();
        tags.swap(tags_before);
    }
    tags.emplace(id, std::move(row));
}

void Reader::Impl::fill(const Record& record, const TagRow& tag, event::Event& event) const {
    static const ReadPoint nowhere;
    auto& names = record.read_point == 0 ? nowhere : *points[record.read_point];
    event.seq = record.seq;
    event.time = from_us(record.time_us);
    event.reader = names.reader;
    event.antenna = names.antenna;
    event.zone = names.zone;
    event.technology = tag.technology;
    event.tag = tag.tag;
    event.epc = tag.epc;
    event.gs1 = tag.gs1;
    event.link = tag.link;
    event.pc = tag.pc;
    event.xpc = tag.xpc;
    event.rssi = record.rssi;
    event.reads = record.reads;
    event.possible_repeat = record.possible_repeat;
    event.reader_time.reset();
    if (record.reader_time_us != 0) event.reader_time = from_us(record.reader_time_us);
}

}  // namespace gantry::journal
