#pragma once
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <boost/unordered/unordered_flat_map.hpp>

#include "journal/journal.hpp"
#include "journal/records.hpp"
#include "journal/rows.hpp"
#include "journal/sqlite.hpp"
#include "journal/stored.hpp"

namespace gantry::journal {

// A connection, and what a query has looked up over it.
struct Reader::Impl {
    struct Slice {
        std::vector<event::Event> rows;
        std::vector<std::pair<Record, std::shared_ptr<const TagRow>>> records;
        Seq end = 0;        // everything wanted up to (newest first: down to) here is in it
        bool last = false;  // nothing comes after
    };
    struct Plan {
        const Filter& filter;
        Statement rows, batches;
        std::vector<signed char> points;  // by id: 1 wanted, 0 not, -1 not yet decided
        bool wants_reads = true;
        std::set<std::string> damage_told = {};
    };

    StoreResult<Plan> plan(const Filter& filter);
    StoreResult<void> read_slice(Plan& plan, Seq from, Slice& slice);
    StoreResult<void> read_rows(Plan& plan, Slice& slice);
    StoreResult<void> read_batches(Plan& plan, Seq low, Seq high, Slice& slice);
    StoreResult<bool> read_event(event::Event& event, Plan& plan);
    StoreResult<bool> read_record(const Record& record, Plan& plan, Slice& slice);
    static bool passes_over(Plan& plan, const StoreError& error);
    StoreResult<bool> wanted_point(Plan& plan, ReadPointId id);
    StoreResult<const ReadPoint*> point(ReadPointId id);
    StoreResult<std::shared_ptr<const TagRow>> tag(std::uint64_t id);
    void keep_tag(std::uint64_t id, std::shared_ptr<const TagRow> row);
    void fill(const Record& record, const TagRow& tag, event::Event& event) const;
    tl::unexpected<StoreError> failed() const { return tl::unexpected(db.error("read")); }
    tl::unexpected<StoreError> damage(std::string what) const {
        return tl::unexpected(damaged(db.path(), what));
    }

    Database db;
    Statement find_tag, find_point, find_version;
    // The caches belong to one query at a time.
    std::vector<std::optional<ReadPoint>> points;
    using Tags = boost::unordered_flat_map<std::uint64_t, std::shared_ptr<const TagRow>>;
    Tags tags, tags_before;
};

}  // namespace gantry::journal
