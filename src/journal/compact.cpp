#include <fmt/format.h>

#include "journal/files.hpp"
#include "journal/journal_impl.hpp"
#include "journal/schema.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal {

namespace {
constexpr int slice_pages = 512;
constexpr std::int64_t incremental = 2;  // of PRAGMA auto_vacuum

// One slice. Pages from the end of the file take the places of free ones before them.
StoreResult<bool> give_back(Database& db) {
    auto way = db.number("PRAGMA auto_vacuum");
    if (!way) return tl::unexpected(way.error());
    if (*way != incremental)
        return tl::unexpected(
            StoreError{StoreError::Kind::other,
                       {fmt::format("the store {} was made by an older gantry and cannot shrink in slices",
                                    db.path().string()),
                        "stop the gateway, run `gantry store compact` and start it again, once"}});
    if (auto done = db.run(fmt::format("PRAGMA incremental_vacuum({})", slice_pages)); !done)
        return tl::unexpected(done.error());
    auto free = db.number("PRAGMA freelist_count");
    if (!free) return tl::unexpected(free.error());
    return *free > 0;
}
}  // namespace

StoreResult<bool> Journal::compact() {
    auto& impl = *impl_;
    if (impl.broken)
        return tl::unexpected(StoreError{
            StoreError::Kind::io,
            {fmt::format("the store {} has failed and was not opened again", impl.options.path.string()),
             {}}});
    auto more = give_back(impl.db);
    if (!more) {
        if (more.error().kind == StoreError::Kind::io) impl.broken = true;
        return more;
    }
    if (*more) {
        impl.after_write();
        return more;
    }
    // Only when the log has been copied does the file end where its pages end.
    if (auto emptied = impl.db.checkpoint(true); !emptied) {
        if (emptied.error().kind == StoreError::Kind::io) impl.broken = true;
        return tl::unexpected(emptied.error());
    }
    return false;
}

StoreResult<Compacted> compact_store(const std::filesystem::path& path, const Progress& progress) {
    auto db = Database::open(path, Database::Access::write);
    if (!db) return tl::unexpected(db.error());
    if (auto current = expect_current_schema(*db); !current) return tl::unexpected(current.error());
    Compacted out;
    out.bytes_before = size_of(path) + size_of(beside(path, log_suffix));
    if (auto set = db->run("PRAGMA synchronous=FULL"); !set) return tl::unexpected(set.error());
    if (auto safe = db->checkpoint(true); !safe) return tl::unexpected(safe.error());
    auto way = db->number("PRAGMA auto_vacuum");
    if (!way) return tl::unexpected(way.error());
    if (*way != incremental) {
        if (auto done = db->run("PRAGMA auto_vacuum=INCREMENTAL; VACUUM"); !done)
            return tl::unexpected(done.error());
    } else {
        auto all = db->number("PRAGMA freelist_count");
        if (!all) return tl::unexpected(all.error());
        for (bool more = *all > 0; more;) {
            auto left = give_back(*db);
            if (!left) return tl::unexpected(left.error());
            more = *left;
            auto free = db->number("PRAGMA freelist_count");
            if (!free) return tl::unexpected(free.error());
            // What is done stays done.
            if (progress &&
                !progress(static_cast<std::uint64_t>(*all - *free), static_cast<std::uint64_t>(*all)))
                break;
            if (auto copied = db->checkpoint(false); !copied) return tl::unexpected(copied.error());
        }
    }
    if (auto safe = db->checkpoint(true); !safe) return tl::unexpected(safe.error());
    out.bytes_after = size_of(path) + size_of(beside(path, log_suffix));
    return out;
}

}  // namespace gantry::journal
