#pragma once
#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

#include "base/error.hpp"
#include "base/time.hpp"

namespace gantry::sinks::jsonl {

// A file that lines are appended to, locked against other writers. What was confirmed is on disk, and what
// was not is cut off again: between two calls of append() the file is whole lines.
class LineFile {
public:
    // `mode` is 0600 or 0640. Both put the name on disk, too.
    static Result<LineFile> create(const std::string& path, unsigned mode);  // it must not be there
    // Cuts off what a crash left of a batch: a line without its end, and everything from a NUL byte on, which
    // is what a power cut leaves where bytes did not reach the disk.
    static Result<LineFile> resume(const std::string& path, unsigned mode);

    LineFile(LineFile&& other) noexcept;
    LineFile& operator=(LineFile&& other) = delete;
    ~LineFile();

    // Hands bytes to the system; sync() confirms all of them. After an error of either the file must be given
    // up: undo() cuts off what was not confirmed, and the next resume() makes sure of it.
    Result<void> append(std::string_view bytes);
    Result<void> sync();
    void undo();

    bool still_at_path() const;  // false: it was moved away or deleted
    std::uint64_t size() const { return confirmed_; }
    std::chrono::microseconds age(Wall now) const { return now - born_; }

private:
    LineFile(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
    Result<void> claim(unsigned mode);
    Result<void> repair();
    Result<void> sync_directory() const;

    int fd_ = -1;
    std::string path_;
    std::uint64_t confirmed_ = 0, written_ = 0;  // bytes
    Wall born_{};
};

}  // namespace gantry::sinks::jsonl
