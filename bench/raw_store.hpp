#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"

struct sqlite3;
struct sqlite3_stmt;

namespace gantry::bench {

// SQLite as bare as it gets, with the safety that the journal has (WAL, synchronous FULL): what the journal
// is compared with.
class RawStore {
public:
    enum class Layout {
        row_a_record,  // six columns, no index
        blob_a_batch,  // records of 32 bytes, made before the clock starts
    };
    RawStore(const std::filesystem::path& file, Layout layout);
    ~RawStore();
    RawStore(const RawStore&) = delete;
    RawStore& operator=(const RawStore&) = delete;

    // One transaction with so many records, synced.
    void commit(std::uint32_t records);

private:
    void run(const char* sql);
    void step();
    [[noreturn]] void give_up(std::string_view doing);

    Layout layout_;
    sqlite3* db_ = nullptr;
    sqlite3_stmt* insert_ = nullptr;
    std::uint64_t next_ = 1;
    Bytes blob_;
};

}  // namespace gantry::bench
