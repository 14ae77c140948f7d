// Events that a destination will not take.
#include "journal/journal_impl.hpp"

namespace gantry::journal {

StoreResult<void> Journal::Impl::write_dead_letters(const Batch& batch) {
    for (auto& letter : batch.dead_letters) {
        auto time_us = storable_us(letter.time);
        auto& statement = statements.dead_letter;
        statement.bind(1, std::string_view(letter.sink)).bind(2, storable(letter.seq)).bind(3, time_us);
        statement.bind(4, storable(letter.tries)).bind(5, std::string_view(letter.reason));
        statement.bind(6, std::string_view(letter.event)).bind(7, std::int64_t{checksum(letter)});
        if (!statement.run()) return failed("write to");
    }
    for (auto& [sink, seq] : batch.dead_letters_deleted)
        if (!statements.dead_letter_delete.bind(1, std::string_view(sink)).bind(2, storable(seq)).run())
            return failed("write to");
    return {};
}

// How many went because there were too many.
StoreResult<std::uint64_t> Journal::Impl::erase_dead_letters(std::int64_t cutoff_us) {
    if (!statements.old_dead_letters.bind(1, cutoff_us).run()) return failed("write to");
    if (!statements.excess_dead_letters.bind(1, storable(max_dead_letters)).run()) return failed("write to");
    return static_cast<std::uint64_t>(db.changed_rows());
}

}  // namespace gantry::journal
