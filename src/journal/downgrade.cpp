// The way back to an older schema.
#include <algorithm>

#include <fmt/format.h>

#include "base/failpoint.hpp"
#include "journal/schema.hpp"
#include "journal/stored.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal {

namespace {
tl::unexpected<StoreError> refuse_way_back(std::string what, std::string hint) {
    return tl::unexpected(StoreError{StoreError::Kind::other, {std::move(what), std::move(hint)}});
}

// The steps to take back, newest first. All of them must have a way.
StoreResult<std::vector<const Migration*>> way_back(Database& db, std::span<const Migration> all, int to) {
    auto version = stored_version(db, all.back().version);
    if (!version) return tl::unexpected(version.error());
    if (*version != all.back().version)
        return refuse_way_back(
            fmt::format("the store {} has version {}, this program knows the way back only from {}",
                        db.path().string(), *version, all.back().version),
            "start the gateway once: it brings the store to the new version");
    if (to < 1 || to > *version)
        return refuse_way_back(fmt::format("the store {} has version {}, so it cannot go back to version {}",
                                           db.path().string(), *version, to),
                               fmt::format("give one from 1 to {}", *version));
    std::vector<const Migration*> steps;
    for (auto& step : all)
        if (step.version > to) steps.push_back(&step);
    std::ranges::reverse(steps);
    for (const auto* step : steps)
        if (step->back.drop == nullptr)
            return refuse_way_back(fmt::format("there is no way back beyond version {}", step->version),
                                   "restore a backup from before, with the older program");
    return steps;
}

// Makes the checksums of a table anew. Only after every row was found to be as it was stored.
StoreResult<void> sum_anew(Database& db, const SummedTable& table) {
    constexpr std::int64_t slice_rows = 4096;
    auto slice = db.prepare(
        fmt::format("{0} WHERE {1} > ?1 ORDER BY {1} LIMIT {2}", table.select, table.key_in_sql, slice_rows));
    if (!slice) return tl::unexpected(slice.error());
    auto update = db.prepare(fmt::format("UPDATE {} SET sum = ?1 WHERE {} = ?2", table.name, table.key));
    if (!update) return tl::unexpected(update.error());
    std::vector<std::pair<std::int64_t, std::uint32_t>> changed;
    std::int64_t after = std::numeric_limits<std::int64_t>::min(), seen = slice_rows;
    while (seen == slice_rows) {
        seen = 0;
        slice->bind(1, after);
        Step step;
        while ((step = slice->step()) == Step::row) {
            ++seen;
            after = slice->number(0);
            auto sum = table.sum(*slice);
            if (!sum.right)
                return tl::unexpected(
                    damaged(db.path(), fmt::format("{} {} cannot be read", table.row_name, after)));
            if (!sum.sound()) changed.emplace_back(after, *sum.right);
        }
        if (step == Step::failed) return tl::unexpected(db.error("read"));
        slice->reset();
        for (auto& [key, sum] : changed)
            if (!update->bind(1, std::int64_t{sum}).bind(2, key).run())
                return tl::unexpected(db.error("write to"));
        changed.clear();
    }
    return {};
}
}  // namespace

StoreResult<std::vector<Loss>> losses(Database& db, std::span<const Migration> all, int to) {
    auto steps = way_back(db, all, to);
    if (!steps) return tl::unexpected(steps.error());
    std::vector<Loss> found;
    for (const auto* step : *steps) {
        if (step->back.loses == nullptr) continue;
        auto rows = db.prepare(step->back.loses);
        if (!rows) return tl::unexpected(rows.error());
        Step each;
        while ((each = rows->step()) == Step::row)
            if (rows->number(0) > 0)
                found.push_back({static_cast<std::uint64_t>(rows->number(0)), std::string(rows->text(1))});
        if (each == Step::failed) return tl::unexpected(db.error("read"));
    }
    return found;
}

StoreResult<void> downgrade(Database& db, std::span<const Migration> all, int to) {
    Transaction transaction(db);
    if (auto begun = transaction.begin_write(); !begun) return begun;
    auto steps = way_back(db, all, to);
    if (!steps) return tl::unexpected(steps.error());
    // All that is forgotten first: checksums are made with today's tables.
    bool forgets = false;
    for (const auto* step : *steps) {
        if (step->back.forget == nullptr) continue;
        forgets = true;
        if (auto done = db.run(step->back.forget); !done) return done;
    }
    if (forgets)
        for (auto& table : summed_tables())
            if (auto done = sum_anew(db, table); !done) return done;
    if (auto done = db.run("DROP VIEW IF EXISTS events; DROP VIEW IF EXISTS present_tags"); !done)
        return done;
    for (const auto* step : *steps) {
        auto sql = fmt::format("{}; PRAGMA user_version={}", step->back.drop, step->version - 1);
        if (auto done = db.run(sql); !done) {
            auto error = done.error();
            error.error.what =
                fmt::format("the store could not be brought back from version {}, it is as it was: {}",
                            step->version, error.error.what);
            return tl::unexpected(error);
        }
        die_at("downgrade_step");
    }
    return transaction.commit();
}

StoreResult<Downgraded> downgrade_store(const std::filesystem::path& path, int to, bool lose) {
    auto db = Database::open(path, Database::Access::write);
    if (!db) return tl::unexpected(db.error());
    Downgraded out{.from = schema_version(), .to = to, .lost = {}, .done = false};
    auto lost = losses(*db, migrations(), to);
    if (!lost) return tl::unexpected(lost.error());
    for (auto& [count, what] : *lost)
        out.lost.push_back(fmt::format("{} {}", count, what));
    if (to == out.from || (!out.lost.empty() && !lose)) return out;
    // New checksums over what is damaged would make it look sound.
    auto checked = check_store(path);
    if (!checked) return tl::unexpected(checked.error());
    if (!checked->sound()) return tl::unexpected(damaged(path, checked->problems.front()));
    if (auto set = db->run("PRAGMA synchronous=FULL"); !set) return tl::unexpected(set.error());
    if (auto done = downgrade(*db, migrations(), to); !done) return tl::unexpected(done.error());
    if (auto safe = db->checkpoint(true); !safe) return tl::unexpected(safe.error());
    out.done = true;
    return out;
}

}  // namespace gantry::journal
