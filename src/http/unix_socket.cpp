#include "http/unix_socket.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <system_error>
#include <utility>

namespace gantry::http {

namespace {

std::string message_of(int error) {
    return std::system_category().message(error);
}

std::string folder_of(const std::filesystem::path& path) {
    auto folder = path.parent_path().string();
    return folder.empty() ? "." : folder;
}

std::optional<sockaddr_un> address_of(const std::filesystem::path& path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    auto text = path.string();
    if (text.empty() || text.size() >= sizeof address.sun_path) return {};
    std::memcpy(address.sun_path, text.data(), text.size());
    return address;
}

const sockaddr* raw(const sockaddr_un& address) {
    return reinterpret_cast<const sockaddr*>(&address);
}

tl::unexpected<Error> too_long(const std::filesystem::path& path) {
    return fail(fmt::format("the path {} is too long for a Unix socket", path.string()),
                fmt::format("choose a data_dir whose path is shorter; the whole may have {} characters",
                            sizeof(sockaddr_un::sun_path) - 1));
}

// Makes room for a socket at `path`, if that harms nobody.
Result<void> clear_away(const std::filesystem::path& path, const sockaddr_un& address) {
    struct stat file {};
    if (::lstat(path.c_str(), &file) != 0) return {};
    if (!S_ISSOCK(file.st_mode)) {
        return fail(fmt::format("{} is in the way: it is not a socket", path.string()), "move it elsewhere");
    }
    int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0) return fail(fmt::format("cannot make a socket: {}", message_of(errno)));
    int error = ::connect(fd, raw(address), sizeof address) == 0 ? 0 : errno;
    ::close(fd);
    if (error == 0 || error == EAGAIN) {  // EAGAIN: alive, with a full queue
        return fail(
            fmt::format("another gateway is running in {}: it answers on {}", folder_of(path), path.string()),
            "stop it first, or give this one a data_dir of its own");
    }
    if (error != ECONNREFUSED && error != ENOENT) {
        return fail(fmt::format("cannot tell whether a gateway is running behind {}: {}", path.string(),
                                message_of(error)),
                    "remove that file if none is");
    }
    if (::unlink(path.c_str()) != 0 && errno != ENOENT) {
        return fail(fmt::format("cannot remove the abandoned {}: {}", path.string(), message_of(errno)));
    }
    return {};
}

}  // namespace

Result<UnixListener> UnixListener::open(const std::filesystem::path& path) {
    auto address = address_of(path);
    if (!address) return too_long(path);
    if (auto cleared = clear_away(path, *address); !cleared) return tl::unexpected(cleared.error());
    int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0) return fail(fmt::format("cannot make a socket: {}", message_of(errno)));
    UnixListener listener(fd, {});
    // The file that bind makes takes the mode of the descriptor: there is no moment when others may connect.
    if (::fchmod(fd, S_IRUSR | S_IWUSR) != 0 || ::bind(fd, raw(*address), sizeof *address) != 0) {
        int error = errno;
        return fail(fmt::format("cannot make the socket {}: {}", path.string(), message_of(error)),
                    error == EACCES || error == ENOENT
                        ? fmt::format("the folder {} must exist and be writable", folder_of(path))
                        : std::string());
    }
    listener.path_ = path;
    struct stat file {};
    if (::lstat(path.c_str(), &file) == 0) listener.inode_ = file.st_ino;
    if (::listen(fd, SOMAXCONN) != 0) {
        return fail(fmt::format("cannot listen on {}: {}", path.string(), message_of(errno)));
    }
    return listener;
}

UnixListener::UnixListener(UnixListener&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      path_(std::move(other.path_)),
      inode_(std::exchange(other.inode_, 0)) {}

UnixListener::~UnixListener() {
    struct stat file {};
    if (inode_ != 0 && ::lstat(path_.c_str(), &file) == 0 && file.st_ino == inode_) ::unlink(path_.c_str());
    if (fd_ >= 0) ::close(fd_);
}

int UnixListener::release() {
    return std::exchange(fd_, -1);
}

Result<int> connect_unix(const std::filesystem::path& path, std::chrono::milliseconds timeout) {
    auto address = address_of(path);
    if (!address) return too_long(path);
    int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0) return fail(fmt::format("cannot make a socket: {}", message_of(errno)));
    auto us = std::max<std::int64_t>(std::chrono::microseconds(timeout).count(), 1);
    timeval patience{us / 1'000'000, us % 1'000'000};
    ::setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    if (::connect(fd, raw(*address), sizeof *address) == 0) return fd;
    int error = errno;
    ::close(fd);
    switch (error) {
        case ENOENT:
        case ENOTDIR:
            return fail(
                fmt::format("no gateway is running in {}: cannot open {}", folder_of(path), path.string()),
                "start one with `gantry run`");
        case ECONNREFUSED:
            return fail(fmt::format("no gateway is running in {}: nobody answers on {}", folder_of(path),
                                    path.string()),
                        "start one with `gantry run`");
        case EAGAIN:
            return fail(
                fmt::format("the gateway in {} takes no connection: its queue is full", folder_of(path)),
                "it may be overloaded or suspended; look at its log");
        case EACCES:
        case EPERM:
            return fail(fmt::format("no permission to open {}", path.string()),
                        "run this as the user that runs the gateway, or as root");
        default:
            return fail(fmt::format("cannot open {}: {}", path.string(), message_of(error)));
    }
}

bool is_trusted_peer(int fd) {
    ucred peer{};
    socklen_t size = sizeof peer;
    if (::getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) != 0) return false;
    return peer.uid == 0 || peer.uid == ::geteuid();
}

}  // namespace gantry::http
