#include "journal/sqlite.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>

#include <fmt/format.h>
#include <sqlite3.h>

#include "base/text.hpp"

namespace gantry::journal {

namespace {
// Another program may hold the write lock for a moment (a shell, a backup).
constexpr int busy_timeout_ms = 2000;

bool out_of_space(int system_error) {
    return system_error == ENOSPC || system_error == EDQUOT;
}

StoreError::Kind kind_of(int code, int system_error) {
    switch (code & 0xFF) {
        case SQLITE_FULL:
            return StoreError::Kind::full;
        case SQLITE_IOERR:
            // A sync that failed says nothing about what is on the disk, whatever its reason.
            if (code != SQLITE_IOERR_FSYNC && code != SQLITE_IOERR_DIR_FSYNC && out_of_space(system_error))
                return StoreError::Kind::full;
            return StoreError::Kind::io;
        case SQLITE_CANTOPEN:
            return StoreError::Kind::io;
        case SQLITE_CORRUPT:
        case SQLITE_NOTADB:
            return StoreError::Kind::corrupt;
        default:
            return StoreError::Kind::other;
    }
}

// What was committed last is in the log: a database moved without it loses that.
std::string damage_hint(const std::filesystem::path& path) {
    return fmt::format(
        "move {0}, {0}-wal and {0}-shm together to another place to keep what is in them, and start again",
        path.filename().string());
}

std::string hint_for(int code, const std::filesystem::path& path) {
    switch (code & 0xFF) {
        case SQLITE_FULL:
            return "free space on the disk, or raise store.max_size";
        case SQLITE_IOERR:
            return "check the disk and the system log";
        case SQLITE_CANTOPEN:
        case SQLITE_PERM:
        case SQLITE_READONLY:
            return "check that the directory exists and that this user may write to it";
        case SQLITE_BUSY:
        case SQLITE_LOCKED:
            return "another program holds the store: close it";
        case SQLITE_CORRUPT:
        case SQLITE_NOTADB:
            return damage_hint(path);
        default:
            return {};
    }
}
}  // namespace

void Statement::Finalize::operator()(sqlite3_stmt* statement) const {
    sqlite3_finalize(statement);
}
void Database::Close::operator()(sqlite3* db) const {
    sqlite3_close_v2(db);
}

Statement& Statement::bind(int at, std::int64_t value) {
    sqlite3_bind_int64(statement_.get(), at, value);
    return *this;
}
Statement& Statement::bind(int at, std::string_view text) {
    sqlite3_bind_text64(statement_.get(), at, text.empty() ? "" : text.data(), text.size(), SQLITE_STATIC,
                        SQLITE_UTF8);
    return *this;
}
Statement& Statement::bind(int at, ByteView blob) {
    // A null pointer would store NULL, not an empty blob.
    sqlite3_bind_blob64(statement_.get(), at, blob.empty() ? static_cast<const void*>("") : blob.data(),
                        blob.size(), SQLITE_STATIC);
    return *this;
}
Statement& Statement::bind_null(int at) {
    sqlite3_bind_null(statement_.get(), at);
    return *this;
}

Step Statement::step() {
    switch (sqlite3_step(statement_.get())) {
        case SQLITE_ROW:
            return Step::row;
        case SQLITE_DONE:
            return Step::done;
        default:
            return Step::failed;
    }
}
bool Statement::reset() {
    return sqlite3_reset(statement_.get()) == SQLITE_OK;
}

bool Statement::is_null(int column) const {
    return sqlite3_column_type(statement_.get(), column) == SQLITE_NULL;
}
std::int64_t Statement::number(int column) const {
    return sqlite3_column_int64(statement_.get(), column);
}
std::string_view Statement::text(int column) const {
    auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_.get(), column));
    if (text == nullptr) return {};
    return {text, static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}
ByteView Statement::blob(int column) const {
    auto* data = static_cast<const std::uint8_t*>(sqlite3_column_blob(statement_.get(), column));
    if (data == nullptr) return {};
    return {data, static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

StoreResult<Database> Database::open(const std::filesystem::path& path, Access access) {
    Database database;
    database.path_ = path;
    sqlite3* db = nullptr;
    int flags = access == Access::write ? SQLITE_OPEN_READWRITE : SQLITE_OPEN_READONLY;
    int code = sqlite3_open_v2(path.c_str(), &db, flags | SQLITE_OPEN_NOMUTEX, nullptr);
    database.db_.reset(db);
    if (code != SQLITE_OK) return tl::unexpected(database.error("open"));
    sqlite3_extended_result_codes(db, 1);
    sqlite3_busy_timeout(db, busy_timeout_ms);
    // A damaged or hostile file must not be able to do more than be unreadable.
    sqlite3_db_config(db, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    sqlite3_db_config(db, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
    sqlite3_wal_hook(
        db,
        [](void* pages, sqlite3*, const char*, int count) {
            *static_cast<std::uint64_t*>(pages) = static_cast<std::uint64_t>(count);
            return SQLITE_OK;
        },
        database.wal_pages_.get());
    if (auto set = database.run("PRAGMA cell_size_check=ON; PRAGMA temp_store=MEMORY"); !set)
        return tl::unexpected(set.error());
    return database;
}

StoreResult<void> Database::run(const std::string& sql) {
    if (sqlite3_exec(db_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
        return tl::unexpected(error("use"));
    return {};
}

StoreResult<Statement> Database::prepare(std::string_view sql) {
    sqlite3_stmt* raw = nullptr;
    if (sqlite3_prepare_v3(db_.get(), sql.data(), static_cast<int>(sql.size()), SQLITE_PREPARE_PERSISTENT,
                           &raw, nullptr) != SQLITE_OK) {
        auto failure = error("use");
        // Our own SQL is right, so the tables it names are not what they were.
        if (sqlite3_errcode(db_.get()) == SQLITE_ERROR) {
            failure.kind = StoreError::Kind::corrupt;
            failure.error.hint = damage_hint(path_);
        }
        return tl::unexpected(std::move(failure));
    }
    Statement statement;
    statement.statement_.reset(raw);
    return statement;
}

StoreResult<std::int64_t> Database::number(std::string_view sql) {
    auto statement = prepare(sql);
    if (!statement) return tl::unexpected(statement.error());
    switch (statement->step()) {
        case Step::row:
            return statement->number(0);
        case Step::done:
            return 0;
        default:
            return tl::unexpected(error("read"));
    }
}

StoreError Database::error(std::string_view doing) const {
    int code = db_ ? sqlite3_extended_errcode(db_.get()) : SQLITE_NOMEM;
    int system_error = db_ ? sqlite3_system_errno(db_.get()) : 0;
    int primary = code & 0xFF;
    std::string why = db_ ? sqlite3_errmsg(db_.get()) : "it is not open";
    if ((primary == SQLITE_IOERR || primary == SQLITE_CANTOPEN) && system_error != 0)
        why += fmt::format(" ({})", std::strerror(system_error));
    return {kind_of(code, system_error),
            {fmt::format("cannot {} the store {}: {}", doing, path_.string(), printable(why)),
             hint_for(code, path_)}};
}

std::int64_t Database::changed_rows() const {
    return sqlite3_changes64(db_.get());
}
bool Database::in_transaction() const {
    return db_ && sqlite3_get_autocommit(db_.get()) == 0;
}
bool Database::read_only() const {
    return db_ && sqlite3_db_readonly(db_.get(), "main") == 1;
}

StoreResult<void> Database::checkpoint(bool empty_log) {
    int in_log = 0, copied = 0;
    int code = sqlite3_wal_checkpoint_v2(db_.get(), nullptr, SQLITE_CHECKPOINT_PASSIVE, &in_log, &copied);
    if (code != SQLITE_OK && (code & 0xFF) != SQLITE_BUSY) return tl::unexpected(error("write"));
    // What is copied is synced, also when a reader keeps the log from being used again from its start.
    if (in_log >= 0) *wal_pages_ = in_log == copied ? 0 : static_cast<std::uint64_t>(in_log);
    if (!empty_log) return {};
    code = sqlite3_wal_checkpoint_v2(db_.get(), nullptr, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr);
    if (code != SQLITE_OK && (code & 0xFF) != SQLITE_BUSY) return tl::unexpected(error("write"));
    return {};
}

StoreResult<void> Database::copy_to(Database& target,
                                    const std::function<bool(std::uint64_t, std::uint64_t)>& go_on) {
    constexpr int pages_a_step = 1024;
    // Without it every commit of somebody else would make the copying begin again.
    Transaction one_moment(*this);
    if (auto begun = one_moment.begin_read(); !begun) return begun;
    if (auto seen = number("SELECT count(*) FROM sqlite_master"); !seen) return tl::unexpected(seen.error());
    auto* copy = sqlite3_backup_init(target.db_.get(), "main", db_.get(), "main");
    if (copy == nullptr) return tl::unexpected(target.error("write"));
    int code = SQLITE_OK;
    bool stopped = false;
    while (code == SQLITE_OK && !stopped) {
        code = sqlite3_backup_step(copy, pages_a_step);
        auto all = static_cast<std::uint64_t>(sqlite3_backup_pagecount(copy));
        auto left = static_cast<std::uint64_t>(sqlite3_backup_remaining(copy));
        stopped = code == SQLITE_OK && !go_on(all - std::min(all, left), all);
    }
    int finished = sqlite3_backup_finish(copy);
    if (stopped)
        return tl::unexpected(
            StoreError{StoreError::Kind::other, {"stopped before the end of the copying", {}}});
    if (code == SQLITE_DONE && finished == SQLITE_OK) return {};
    // Whichever of the two failed says why; the other's last call was good.
    return tl::unexpected(sqlite3_errcode(db_.get()) == SQLITE_OK ? target.error("write") : error("read"));
}

Transaction::~Transaction() {
    // After a failed write SQLite may already have rolled back.
    if (db_.in_transaction()) static_cast<void>(db_.run("ROLLBACK"));
}
StoreResult<void> Transaction::begin_write() {
    return db_.run("BEGIN IMMEDIATE");
}
StoreResult<void> Transaction::begin_read() {
    return db_.run("BEGIN");
}
StoreResult<void> Transaction::commit() {
    return db_.run("COMMIT");
}

StoreError damaged(const std::filesystem::path& path, std::string_view what) {
    return {StoreError::Kind::corrupt,
            {fmt::format("the store {} is damaged: {}", path.string(), what), damage_hint(path)}};
}

}  // namespace gantry::journal
