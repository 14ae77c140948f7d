#pragma once
#include <filesystem>
#include <string>

namespace gantry::testkit {

// A directory of the test's own, removed with everything in it.
class TempDir {
public:
    explicit TempDir(const std::filesystem::path& parent = std::filesystem::temp_directory_path());
    ~TempDir();
    TempDir(const TempDir&) = delete;
    TempDir& operator=(const TempDir&) = delete;
    const std::string& path() const { return path_; }

private:
    std::string path_;
};
void write_file(const std::string& path, const std::string& text);

}  // namespace gantry::testkit
