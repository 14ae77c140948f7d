#include "journal/ids.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "journal/journal_impl.hpp"

namespace gantry::journal {

const std::string& IdPrefixes::of(Seq seq) const {
    for (auto& [last_seq, prefix] : earlier_)
        if (seq <= last_seq) return prefix;
    return newest_;
}

StoreResult<std::vector<EarlierIds>> read_earlier_ids(Database& db) {
    auto rows = db.prepare(fmt::format("{} ORDER BY last_seq", select_earlier_ids));
    if (!rows) return tl::unexpected(rows.error());
    std::vector<EarlierIds> all;
    Step step;
    while ((step = rows->step()) == Step::row) {
        auto sum = take(*rows, all.emplace_back());
        if (!sum.sound())
            return tl::unexpected(
                damaged(db.path(), fmt::format("which ids the events up to {} have is not as it was stored",
                                               all.back().last_seq)));
    }
    if (step == Step::failed) return tl::unexpected(db.error("read"));
    return all;
}

StoreResult<IdPrefixes> read_id_prefixes(Database& db) {
    Transaction transaction(db);
    if (auto begun = transaction.begin_read(); !begun) return tl::unexpected(begun.error());
    auto earlier = read_earlier_ids(db);
    if (!earlier) return tl::unexpected(earlier.error());
    auto row = db.prepare(select_state);
    if (!row) return tl::unexpected(row.error());
    State state;
    switch (row->step()) {
        case Step::failed:
            return tl::unexpected(db.error("read"));
        case Step::done:
            return tl::unexpected(damaged(db.path(), "its state is missing"));
        case Step::row:
            if (!take(*row, state).sound())
                return tl::unexpected(damaged(db.path(), "its state fails its checksum"));
            break;
    }
    std::vector<std::pair<Seq, std::string>> prefixes;
    for (auto& ids : *earlier) {
        State then;
        then.gateway_id = ids.gateway_id;
        then.epoch = ids.epoch;
        prefixes.emplace_back(ids.last_seq, then.id_prefix());
    }
    return IdPrefixes(state.id_prefix(), std::move(prefixes));
}

StoreResult<void> Journal::Impl::change_ids(State next) {
    Transaction transaction(db);
    if (auto begun = transaction.begin_write(); !begun) return begun;
    if (state.next_seq > 1) {
        EarlierIds row{state.next_seq - 1, next.next_seq, state.gateway_id, state.epoch};
        // No event since the last change: those before it keep what they have.
        auto earlier = read_earlier_ids(db);
        if (!earlier) return tl::unexpected(earlier.error());
        if (auto last = std::ranges::find(*earlier, state.next_seq, &EarlierIds::next_seq);
            last != earlier->end()) {
            row = *last;
            row.next_seq = next.next_seq;
        }
        auto statement = db.prepare("INSERT OR REPLACE INTO earlier_ids VALUES(?1, ?2, ?3, ?4, ?5)");
        if (!statement) return tl::unexpected(statement.error());
        statement->bind(1, storable(row.last_seq)).bind(2, storable(row.next_seq));
        statement->bind(3, std::string_view(row.gateway_id)).bind(4, storable(row.epoch));
        if (!statement->bind(5, std::int64_t{checksum(row)}).run()) return failed("write to");
    }
    if (auto written = write_state(next, state.next_seq); !written) return written;
    if (auto done = transaction.commit(); !done) return done;
    state = std::move(next);
    forget_tags();
    return {};
}

}  // namespace gantry::journal
