#pragma once
#include <filesystem>
#include <string_view>
#include <utility>

#include "base/error.hpp"

namespace gantry::gateway {

// The data directory is this process's alone: gateway.lock in it, held until the object goes or the process
// ends. It says who has it, for whoever comes second.
class DataLock {
public:
    // Makes the directory, for this user alone, if there is none. `who`: "gantry run", say.
    static Result<DataLock> take(const std::filesystem::path& directory, std::string_view who);

    DataLock() = default;
    DataLock(DataLock&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
    DataLock& operator=(DataLock&& other) noexcept {
        std::swap(file_, other.file_);
        return *this;
    }
    ~DataLock() { release(); }
    void release();

private:
    int file_ = -1;
};

}  // namespace gantry::gateway
