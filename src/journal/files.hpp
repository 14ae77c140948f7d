#pragma once
#include <cstdint>
#include <filesystem>
#include <string_view>
#include <utility>

#include "journal/journal.hpp"

// What the store does with files beside SQLite: private ones, and changes of names that outlive the power.
namespace gantry::journal {

// What SQLite keeps beside a database: its log, and the index of the log.
inline constexpr std::string_view log_suffix = "-wal", index_suffix = "-shm";

std::filesystem::path beside(const std::filesystem::path& path, std::string_view suffix);
std::uint64_t size_of(const std::filesystem::path& path);  // 0: there is none

// Makes an empty file with mode 0600; false: there is one.
StoreResult<bool> make_private_file(const std::filesystem::path& path);
// What was written to the file is on the disk, and so are the names in the directory.
StoreResult<void> sync_file(const std::filesystem::path& path);
StoreResult<void> sync_directory(const std::filesystem::path& directory);
std::filesystem::path directory_of(const std::filesystem::path& path);

// Gives `from` the name `to` in one step and syncs the directory. Unless it may `replace`, a file that has
// the name already is left alone, and the error says so.
StoreResult<void> put_in_place(const std::filesystem::path& from, const std::filesystem::path& to,
                               bool replace);
// A database and what belongs to it.
void remove_database(const std::filesystem::path& path);

// A file that this process alone works on. A second one is told that somebody does, not kept waiting.
class FileClaim {
public:
    static StoreResult<FileClaim> take(const std::filesystem::path& path);
    FileClaim(FileClaim&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
    FileClaim& operator=(FileClaim&&) = delete;
    ~FileClaim();

private:
    explicit FileClaim(int file) : file_(file) {}
    int file_;
};

}  // namespace gantry::journal
