// The jobs of readers, and which readers somebody has stopped.
#include <fmt/format.h>

#include "journal/journal_impl.hpp"
#include "journal/stored.hpp"

namespace gantry::journal {

StoreResult<void> Journal::Impl::write_jobs(const Batch& batch) {
    for (auto& row : batch.jobs) {
        auto& statement = statements.job.bind(1, storable(row.id)).bind(2, std::string_view(row.reader));
        statement.bind(3, std::string_view(row.op)).bind(4, std::string_view(row.detail));
        statement.bind(5, std::string_view(row.state)).bind(6, std::string_view(row.text));
        statement.bind(7, storable_us(row.created)).bind(8, storable_us(row.deadline));
        if (row.ended)
            statement.bind(9, storable_us(*row.ended));
        else
            statement.bind_null(9);
        if (!statement.bind(10, std::int64_t{checksum(row)}).run()) return failed("write to");
    }
    for (auto& [reader, reading] : batch.reading)
        if (!statements.reading.bind(1, std::string_view(reader)).bind(2, std::int64_t{reading}).run())
            return failed("write to");
    return {};
}

StoreResult<void> Journal::Impl::erase_jobs(std::int64_t cutoff_us) {
    if (!statements.erase_jobs.bind(1, cutoff_us).bind(2, storable(max_jobs)).run())
        return failed("write to");
    return {};
}

StoreResult<void> Journal::load_jobs(const std::function<void(JobRow)>& each) {
    auto& impl = *impl_;
    auto rows = impl.db.prepare(fmt::format("{} ORDER BY id", select_jobs));
    if (!rows) return tl::unexpected(rows.error());
    Step step;
    while ((step = rows->step()) == Step::row) {
        JobRow row;
        if (!take(*rows, row).sound()) {
            auto id = row.id;
            row = {};
            row.id = id;
            row.state = "unknown";
            row.text = "its row in the store is damaged";
        }
        each(std::move(row));
    }
    if (step == Step::failed) return impl.failed("read");
    return {};
}

StoreResult<std::vector<std::string>> Journal::stopped_readers() {
    auto& impl = *impl_;
    auto rows = impl.db.prepare("SELECT reader FROM reading WHERE reading = 0 ORDER BY reader");
    if (!rows) return tl::unexpected(rows.error());
    std::vector<std::string> out;
    Step step;
    while ((step = rows->step()) == Step::row)
        out.emplace_back(rows->text(0));
    if (step == Step::failed) return impl.failed("read");
    return out;
}

}  // namespace gantry::journal
