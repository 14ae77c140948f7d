#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "journal/journal.hpp"

struct sqlite3;
struct sqlite3_stmt;

// SQLite's C API behind types that close themselves. Nothing else of the program includes sqlite3.h.
namespace gantry::journal {

// What one step of a statement came to. The reason of a failure is with the Database until its next call.
enum class Step { row, done, failed };

// A prepared statement, made to be kept. Texts and blobs are bound without a copy: they must live until the
// statement is reset or bound again. Columns count from 0, parameters from 1.
class Statement {
public:
    Statement() = default;

    Statement& bind(int at, std::int64_t value);
    Statement& bind(int at, std::string_view text);
    Statement& bind(int at, ByteView blob);
    Statement& bind_null(int at);

    Step step();
    bool run() {  // for statements without rows; ready for the next use either way
        bool done = step() == Step::done;
        return reset() && done;
    }
    bool reset();

    bool is_null(int column) const;
    std::int64_t number(int column) const;
    std::string_view text(int column) const;  // until the next step
    ByteView blob(int column) const;          // until the next step

private:
    friend class Database;
    struct Finalize {
        void operator()(sqlite3_stmt* statement) const;
    };
    std::unique_ptr<sqlite3_stmt, Finalize> statement_;
};

// A connection. Used by one thread at a time; movable, but statements must not outlive it.
class Database {
public:
    enum class Access { write, read };

    Database() = default;
    static StoreResult<Database> open(const std::filesystem::path& path, Access access);

    StoreResult<void> run(const std::string& sql);  // any number of statements, rows are thrown away
    StoreResult<Statement> prepare(std::string_view sql);
    // First column of the first row; for PRAGMAs and counts.
    StoreResult<std::int64_t> number(std::string_view sql);

    // The failure of the last call on this connection, in words for the user: "cannot <doing> <file>: why".
    StoreError error(std::string_view doing) const;
    std::int64_t changed_rows() const;
    bool in_transaction() const;
    bool read_only() const;  // the file, or what its header says

    // Pages in the write-ahead log after the last commit of this connection that are not yet in the file.
    std::uint64_t wal_pages() const { return *wal_pages_; }
    // Copies the log into the file and syncs it. With `empty_log` the log is also cut to nothing, if no
    // reader is in the way. Readers that hold an old state may keep a part of the log; that is no error.
    StoreResult<void> checkpoint(bool empty_log);

    // Makes `target`, an empty database, page for page what this one is at one moment. `go_on` is called with
    // pages done and all pages; false ends it. Meanwhile the log of this one is not emptied.
    StoreResult<void> copy_to(Database& target,
                              const std::function<bool(std::uint64_t done, std::uint64_t all)>& go_on);

    const std::filesystem::path& path() const { return path_; }

private:
    struct Close {
        void operator()(sqlite3* db) const;
    };
    std::filesystem::path path_;
    std::unique_ptr<std::uint64_t> wal_pages_ = std::make_unique<std::uint64_t>(0);  // the hook points here
    std::unique_ptr<sqlite3, Close> db_;
};

// One transaction: rolled back unless committed.
class Transaction {
public:
    explicit Transaction(Database& db) : db_(db) {}
    ~Transaction();
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;

    StoreResult<void> begin_write();
    StoreResult<void> begin_read();
    StoreResult<void> commit();

private:
    Database& db_;
};

StoreError damaged(const std::filesystem::path& path, std::string_view what);

}  // namespace gantry::journal
