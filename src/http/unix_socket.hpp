#pragma once
#include <chrono>
#include <filesystem>

#include "base/error.hpp"

namespace gantry::http {

// A listening Unix socket with mode 0600 from its first moment. An abandoned socket file is replaced; one
// that somebody answers on is refused.
class UnixListener {
public:
    static Result<UnixListener> open(const std::filesystem::path& path);
    UnixListener(UnixListener&& other) noexcept;
    UnixListener& operator=(UnixListener&&) = delete;
    ~UnixListener();  // closes, and removes the file if it is still its own
    int release();    // whoever takes the descriptor closes it; the file is still removed here

private:
    UnixListener(int fd, std::filesystem::path path) : fd_(fd), path_(std::move(path)) {}
    int fd_;
    std::filesystem::path path_;
    unsigned long inode_ = 0;
};

// A connected, blocking descriptor, or the error for people. Waits while the other side's queue is full.
Result<int> connect_unix(const std::filesystem::path& path, std::chrono::milliseconds timeout);

// Does the process at the other end belong to this user or to root?
bool is_trusted_peer(int fd);

}  // namespace gantry::http
