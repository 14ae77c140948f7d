#include "gateway/data_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::gateway {

namespace {
constexpr std::string_view gateway_itself = "gantry run";

std::string lock_file(const std::filesystem::path& directory) {
    return (directory / "gateway.lock").string();
}

std::string holder_of(int file) {
    std::array<char, 64> text{};
    auto size = ::pread(file, text.data(), text.size(), 0);
    return size > 0 ? printable(trimmed({text.data(), static_cast<std::size_t>(size)})) : std::string();
}
}  // namespace

Result<DataLock> DataLock::take(const std::filesystem::path& directory, std::string_view who) {
    auto cannot = [&](std::string_view what, const std::string& why) {
        return fail(fmt::format("cannot {} the data directory {}: {}", what, directory.string(), why),
                    "choose another with data_dir in [gateway], or make it writable");
    };
    std::error_code error;
    if (std::filesystem::create_directories(directory, error))
        std::filesystem::permissions(directory, std::filesystem::perms::owner_all, error);
    if (error) return cannot("make", error.message());
    DataLock lock;
    lock.file_ = ::open(lock_file(directory).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (lock.file_ < 0) return cannot("write in", std::strerror(errno));
    if (::flock(lock.file_, LOCK_EX | LOCK_NB) != 0) {
        auto holder = holder_of(lock.file_);
        if (holder.empty() || holder == gateway_itself)
            return fail(
                fmt::format("another gateway is running in {}", directory.string()),
                who == gateway_itself ? "stop it, or give this one a data_dir of its own" : "stop it first");
        return fail(fmt::format("`{}` is at work in {}", holder, directory.string()),
                    "wait until it is done");
    }
    // Only for whoever comes second: a disk that is full is no reason not to start.
    if (::ftruncate(lock.file_, 0) == 0)
        static_cast<void>(::pwrite(lock.file_, who.data(), who.size(), 0) == std::ssize(who));
    return lock;
}

void DataLock::release() {
    if (file_ >= 0) ::close(file_);
    file_ = -1;
}

}  // namespace gantry::gateway
