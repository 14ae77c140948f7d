#include "sinks/jsonl/gzip_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <array>
#include <cerrno>
#include <new>
#include <span>
#include <vector>

#include "sinks/jsonl/file_names.hpp"

namespace gantry::sinks::jsonl {

namespace {

class OpenFile {
public:
    explicit OpenFile(int fd) : fd_(fd) {}
    OpenFile(const OpenFile&) = delete;
    OpenFile& operator=(const OpenFile&) = delete;
    ~OpenFile() {
        if (fd_ >= 0) ::close(fd_);
    }
    int fd() const { return fd_; }

private:
    int fd_;
};

class Deflater {
public:
    Deflater() {
        constexpr int gzip = 16, window = 15, memory = 8;
        if (::deflateInit2(&stream_, Z_DEFAULT_COMPRESSION, Z_DEFLATED, gzip + window, memory,
                           Z_DEFAULT_STRATEGY) != Z_OK)
            throw std::bad_alloc();
    }
    Deflater(const Deflater&) = delete;
    Deflater& operator=(const Deflater&) = delete;
    ~Deflater() { ::deflateEnd(&stream_); }

    // Hands what comes out to `sink`, which returns false to end it.
    template <class Sink>
    bool feed(std::span<unsigned char> input, bool last, Sink sink) {
        stream_.next_in = input.data();
        stream_.avail_in = static_cast<uInt>(input.size());
        do {
            stream_.next_out = out_.data();
            stream_.avail_out = static_cast<uInt>(out_.size());
            ::deflate(&stream_, last ? Z_FINISH : Z_NO_FLUSH);
            if (!sink(std::span(out_).first(out_.size() - stream_.avail_out))) return false;
        } while (stream_.avail_out == 0);
        return true;
    }

private:
    z_stream stream_{};
    std::array<unsigned char, 64 * 1024> out_{};
};

bool write_all(int fd, std::span<const unsigned char> bytes) {
    while (!bytes.empty()) {
        auto done = ::write(fd, bytes.data(), bytes.size());
        if (done < 0 && errno == EINTR) continue;
        if (done < 0) return false;
        bytes = bytes.subspan(static_cast<std::size_t>(done));
    }
    return true;
}

}  // namespace

Result<bool> gzip_file(const std::string& from, const std::string& to, unsigned mode,
                       const std::stop_token& stop) {
    OpenFile source(::open(from.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    struct stat about {};
    if (source.fd() < 0 || ::fstat(source.fd(), &about) != 0)
        return tl::unexpected(system_error("cannot read", from, errno));
    if (::flock(source.fd(), LOCK_SH | LOCK_NB) != 0) return false;
    OpenFile target(::open(to.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, mode));
    if (target.fd() < 0 || ::fchmod(target.fd(), mode) != 0)
        return tl::unexpected(system_error("cannot create", to, errno));
    Deflater deflater;
    std::vector<unsigned char> buffer(256 * 1024);
    auto keep = [&](std::span<const unsigned char> bytes) { return write_all(target.fd(), bytes); };
    for (bool last = false; !last;) {
        if (stop.stop_requested()) return false;
        auto got = ::read(source.fd(), buffer.data(), buffer.size());
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return tl::unexpected(system_error("cannot read", from, errno));
        last = got == 0;
        if (!deflater.feed(std::span(buffer).first(static_cast<std::size_t>(got)), last, keep))
            return tl::unexpected(system_error("cannot write to", to, errno));
    }
    std::array times = {about.st_atim, about.st_mtim};
    if (::futimens(target.fd(), times.data()) != 0 || ::fsync(target.fd()) != 0)
        return tl::unexpected(system_error("cannot bring to disk", to, errno));
    return true;
}

}  // namespace gantry::sinks::jsonl
