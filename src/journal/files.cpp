#include "journal/files.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/text.hpp"

namespace gantry::journal {

namespace {
tl::unexpected<StoreError> file_trouble(std::string_view doing, const std::filesystem::path& path, int why,
                                        std::string hint) {
    auto kind = why == ENOSPC || why == EDQUOT ? StoreError::Kind::full : StoreError::Kind::io;
    return tl::unexpected(
        StoreError{kind,
                   {fmt::format("cannot {} {}: {}", doing, printable(path.string()), std::strerror(why)),
                    std::move(hint)}});
}

StoreResult<void> sync(const std::filesystem::path& path, int flags) {
    int file = ::open(path.c_str(), flags | O_CLOEXEC);
    if (file < 0) return file_trouble("open", path, errno, {});
    int failed = ::fsync(file) == 0 ? 0 : errno;
    ::close(file);
    if (failed != 0) return file_trouble("write", path, failed, "check the disk and the system log");
    return {};
}
}  // namespace

std::filesystem::path beside(const std::filesystem::path& path, std::string_view suffix) {
    auto name = path;
    name += suffix;
    return name;
}

std::uint64_t size_of(const std::filesystem::path& path) {
    std::error_code none;
    auto size = std::filesystem::file_size(path, none);
    return none ? 0 : size;
}

std::filesystem::path directory_of(const std::filesystem::path& path) {
    auto directory = path.parent_path();
    return directory.empty() ? "." : directory;
}

StoreResult<bool> make_private_file(const std::filesystem::path& path) {
    int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (file < 0 && errno == EEXIST) return false;
    if (file < 0)
        return file_trouble("make", path, errno,
                            "check that the directory exists and that this user may write to it");
    ::close(file);
    return true;
}

StoreResult<void> sync_file(const std::filesystem::path& path) {
    return sync(path, O_RDONLY);
}
StoreResult<void> sync_directory(const std::filesystem::path& directory) {
    return sync(directory, O_RDONLY | O_DIRECTORY);
}

StoreResult<void> put_in_place(const std::filesystem::path& from, const std::filesystem::path& to,
                               bool replace) {
    auto taken = [&] {
        return tl::unexpected(StoreError{StoreError::Kind::other,
                                         {fmt::format("{} is there already", printable(to.string())),
                                          "give another name, or --force to replace it"}});
    };
    int failed = 0;
    if (!replace && ::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) != 0) {
        if (errno == EEXIST) return taken();
        // Some file systems cannot look and rename in one step.
        if (errno != EINVAL && errno != ENOSYS) return file_trouble("make", to, errno, {});
        if (std::error_code none; std::filesystem::exists(to, none)) return taken();
        replace = true;
    }
    if (replace && ::rename(from.c_str(), to.c_str()) != 0) failed = errno;
    if (failed != 0) return file_trouble("make", to, failed, {});
    return sync_directory(directory_of(to));
}

void remove_database(const std::filesystem::path& path) {
    std::error_code none;
    for (auto suffix : {log_suffix, index_suffix, std::string_view("-journal"), std::string_view()})
        std::filesystem::remove(beside(path, suffix), none);
}

StoreResult<FileClaim> FileClaim::take(const std::filesystem::path& path) {
    int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (file < 0)
        return file_trouble("write", path, errno,
                            "check that the directory exists and that this user may write to it");
    FileClaim claim(file);
    // In a directory that everybody may write to, somebody may have put a file of his there.
    struct stat is {};
    if (::fstat(file, &is) != 0 || !S_ISREG(is.st_mode) || is.st_uid != ::geteuid())
        return tl::unexpected(StoreError{StoreError::Kind::other,
                                         {fmt::format("{} is not ours", printable(path.string())),
                                          "remove it, or choose another directory"}});
    if (::flock(file, LOCK_EX | LOCK_NB) != 0)
        return tl::unexpected(
            StoreError{StoreError::Kind::other,
                       {fmt::format("another program is writing {}", printable(path.string())),
                        "wait until it is done"}});
    return claim;
}

FileClaim::~FileClaim() {
    if (file_ >= 0) ::close(file_);
}

}  // namespace gantry::journal
