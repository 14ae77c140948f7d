#include "sinks/jsonl/line_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "sinks/jsonl/file_names.hpp"

namespace gantry::sinks::jsonl {

// How much of a file's end is looked through for holes: more than any batch has.
static constexpr std::uint64_t repair_window = 256 * 1024 * 1024;

static auto failure(std::string_view did, const std::string& path) {
    return tl::unexpected(system_error(did, path, errno));
}

Result<LineFile> LineFile::create(const std::string& path, unsigned mode) {
    LineFile file(::open(path.c_str(), O_RDWR | O_APPEND | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, mode),
                  path);
    if (file.fd_ < 0) return failure("cannot create", path);
    if (auto claimed = file.claim(mode); !claimed) return tl::unexpected(claimed.error());
    if (auto synced = file.sync_directory(); !synced) return tl::unexpected(synced.error());
    return file;
}

Result<LineFile> LineFile::resume(const std::string& path, unsigned mode) {
    LineFile file(::open(path.c_str(), O_RDWR | O_APPEND | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK), path);
    if (file.fd_ < 0) return failure("cannot write to", path);
    if (auto claimed = file.claim(mode); !claimed) return tl::unexpected(claimed.error());
    if (auto repaired = file.repair(); !repaired) return tl::unexpected(repaired.error());
    if (auto synced = file.sync_directory(); !synced) return tl::unexpected(synced.error());
    return file;
}

LineFile::LineFile(LineFile&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      path_(std::move(other.path_)),
      confirmed_(other.confirmed_),
      written_(other.written_),
      born_(other.born_) {}

LineFile::~LineFile() {
    if (fd_ >= 0) ::close(fd_);  // and unlocks
}

// Ours alone, a plain file, with the mode that was asked for whatever the umask says.
Result<void> LineFile::claim(unsigned mode) {
    struct statx about {};
    if (::statx(fd_, "", AT_EMPTY_PATH, STATX_BASIC_STATS | STATX_BTIME, &about) != 0)
        return failure("cannot look at", path_);
    if (!S_ISREG(about.stx_mode))
        return fail(fmt::format("{} is no plain file", printable(path_)), "move it out of the way");
    if (::flock(fd_, LOCK_EX | LOCK_NB) != 0) {
        if (errno != EWOULDBLOCK) return failure("cannot lock", path_);
        return fail(fmt::format("another program is writing to {}", printable(path_)),
                    "each sink needs a directory or a name of its own");
    }
    if ((about.stx_mode & 0777U) != mode && ::fchmod(fd_, mode) != 0)
        return failure("cannot set the mode of", path_);
    auto& born = (about.stx_mask & STATX_BTIME) != 0 ? about.stx_btime : about.stx_mtime;
    born_ = from_us(born.tv_sec * 1'000'000 + born.tv_nsec / 1000);
    confirmed_ = written_ = about.stx_size;
    return {};
}

Result<void> LineFile::repair() {
    std::vector<char> buffer(std::min<std::uint64_t>(confirmed_, 1024 * 1024));
    std::uint64_t whole = 0;  // everything up to here is whole lines
    auto at = confirmed_ > repair_window ? confirmed_ - repair_window : 0;
    for (whole = at; at < confirmed_;) {
        auto got = ::pread(fd_, buffer.data(), buffer.size(), static_cast<off_t>(at));
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return failure("cannot read", path_);
        if (got == 0) break;
        std::string_view part(buffer.data(), static_cast<std::size_t>(got));
        auto hole = part.find('\0');
        auto line_end = part.substr(0, hole).rfind('\n');
        if (line_end != std::string_view::npos) whole = at + line_end + 1;
        if (hole != std::string_view::npos) break;
        at += part.size();
    }
    if (whole == confirmed_) return {};
    if (::ftruncate(fd_, static_cast<off_t>(whole)) != 0) return failure("cannot repair", path_);
    log::info("sink", "{}: cut off {} bytes that a crash had left of an unfinished batch", printable(path_),
              confirmed_ - whole);
    confirmed_ = written_ = whole;
    return sync();
}

Result<void> LineFile::append(std::string_view bytes) {
    while (!bytes.empty()) {
        auto done = ::write(fd_, bytes.data(), bytes.size());
        if (done < 0 && errno == EINTR) continue;
        if (done < 0) return failure("cannot write to", path_);
        written_ += static_cast<std::uint64_t>(done);
        bytes.remove_prefix(static_cast<std::size_t>(done));
    }
    return {};
}

Result<void> LineFile::sync() {
    // Never a second try: what a failed one was about may be gone from memory and from disk.
    if (::fdatasync(fd_) != 0) return failure("cannot bring to disk", path_);
    confirmed_ = written_;
    return {};
}

void LineFile::undo() {
    if (::ftruncate(fd_, static_cast<off_t>(confirmed_)) != 0)
        log::warn("sink", "{}", system_error("cannot cut an unfinished batch off", path_, errno).text());
    written_ = confirmed_;
}

bool LineFile::still_at_path() const {
    struct stat here {
    }, there{};
    return ::fstat(fd_, &here) == 0 && ::stat(path_.c_str(), &there) == 0 && here.st_ino == there.st_ino &&
           here.st_dev == there.st_dev;
}

Result<void> LineFile::sync_directory() const {
    auto dir = path_.substr(0, path_.rfind('/') + 1);
    int fd = ::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return failure("cannot open", dir);
    bool done = ::fsync(fd) == 0 || errno == EINVAL;  // some file systems have nothing to do there
    int number = errno;
    ::close(fd);
    if (!done) return tl::unexpected(system_error("cannot bring to disk", dir, number));
    return {};
}

}  // namespace gantry::sinks::jsonl
