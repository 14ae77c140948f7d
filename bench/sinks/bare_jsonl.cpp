#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <fmt/format.h>

#include "bench/load/outcome.hpp"
#include "bench/sinks/bare_client.hpp"

namespace gantry::bench {

namespace {
// Lines appended to a file, synced a batch.
class BareFile final : public BareClient {
public:
    explicit BareFile(const std::string& path)
        : fd_(::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600)) {
        if (fd_ < 0) throw Failure(fmt::format("{}: {}", path, std::strerror(errno)));
    }
    ~BareFile() override { ::close(fd_); }

    void deliver(std::span<const sink::Item> batch) override {
        lines_.clear();
        for (auto& item : batch) {
            lines_ += item.payload;
            lines_ += '\n';
        }
        for (std::size_t written = 0; written < lines_.size();) {
            auto size = ::write(fd_, lines_.data() + written, lines_.size() - written);
            if (size < 0) throw Failure(fmt::format("the file cannot be written: {}", std::strerror(errno)));
            written += static_cast<std::size_t>(size);
        }
        if (::fdatasync(fd_) != 0) throw Failure(fmt::format("no sync: {}", std::strerror(errno)));
    }

private:
    int fd_;
    std::string lines_;
};
}  // namespace

std::unique_ptr<BareClient> bare_jsonl(const std::string& place) {
    return std::make_unique<BareFile>(place + "/bare.lines");
}

}  // namespace gantry::bench
