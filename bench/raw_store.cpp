#include "bench/raw_store.hpp"

#include <sqlite3.h>

#include <stdexcept>
#include <string>

#include "bench/tag_frame.hpp"

namespace gantry::bench {

namespace {
constexpr std::size_t record_size = 32;
constexpr std::int64_t some_time_us = 1'795'302'240'000'000;
}  // namespace

RawStore::RawStore(const std::filesystem::path& file, Layout layout) : layout_(layout) {
    if (sqlite3_open(file.c_str(), &db_) != SQLITE_OK) give_up("open");
    run("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA wal_autocheckpoint=4096;");
    bool rows = layout == Layout::row_a_record;
    run(rows ? "CREATE TABLE reads(seq INTEGER PRIMARY KEY, time INTEGER, tag BLOB, place INTEGER, rssi "
               "INTEGER, "
               "reads INTEGER)"
             : "CREATE TABLE reads(seq INTEGER PRIMARY KEY, records BLOB)");
    const char* insert =
        rows ? "INSERT INTO reads VALUES(?1,?2,?3,?4,?5,?6)" : "INSERT INTO reads VALUES(?1,?2)";
    if (sqlite3_prepare_v2(db_, insert, -1, &insert_, nullptr) != SQLITE_OK) give_up("prepare");
}

RawStore::~RawStore() {
    sqlite3_finalize(insert_);
    sqlite3_close(db_);
}

void RawStore::commit(std::uint32_t records) {
    run("BEGIN IMMEDIATE");
    auto seq = static_cast<std::int64_t>(next_);
    if (layout_ == Layout::blob_a_batch) {
        blob_.resize(records * record_size, 0x5A);
        sqlite3_bind_int64(insert_, 1, seq);
        sqlite3_bind_blob(insert_, 2, blob_.data(), static_cast<int>(blob_.size()), SQLITE_STATIC);
        step();
    } else {
        for (std::uint32_t i = 0; i < records; ++i) {
            auto tag = tag_of(static_cast<std::uint32_t>(next_) + i);
            sqlite3_bind_int64(insert_, 1, seq + i);
            sqlite3_bind_int64(insert_, 2, some_time_us + i);
            sqlite3_bind_blob(insert_, 3, tag.data.data(), tag.size, SQLITE_STATIC);
            sqlite3_bind_int64(insert_, 4, i % 100);
            sqlite3_bind_int64(insert_, 5, -500);
            sqlite3_bind_int64(insert_, 6, 1);
            step();
        }
    }
    run("COMMIT");
    next_ += records;
}

void RawStore::run(const char* sql) {
    if (sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) != SQLITE_OK) give_up(sql);
}

void RawStore::step() {
    if (sqlite3_step(insert_) != SQLITE_DONE) give_up("insert into");
    sqlite3_reset(insert_);
}

void RawStore::give_up(std::string_view doing) {
    throw std::runtime_error("the bare store failed: " + std::string(doing) + ": " + sqlite3_errmsg(db_));
}

}  // namespace gantry::bench
