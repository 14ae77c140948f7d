#pragma once
#include <filesystem>
#include <fstream>
#include <string>

#include "base/error.hpp"

namespace gantry::cli {

// A file that gets its name when all of it is written and synced: whoever looks meanwhile sees the old one or
// none. What is no plain file (a device, a pipe) is written as it is.
class WholeFile {
public:
    static Result<WholeFile> open(const std::string& name);
    WholeFile(WholeFile&& other) = default;
    WholeFile& operator=(WholeFile&&) = delete;
    ~WholeFile();  // without finish(): as if it had never been begun

    std::ostream& stream() { return out_; }
    Result<void> finish();

private:
    explicit WholeFile(std::filesystem::path name) : name_(std::move(name)) {}

    std::filesystem::path name_, part_;  // part_: empty when there is none (any more)
    std::ofstream out_;
};

}  // namespace gantry::cli
