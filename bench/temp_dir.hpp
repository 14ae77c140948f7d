#pragma once
#include <filesystem>

namespace gantry::bench {

// A directory of a measurement's own, below $TMPDIR, removed with everything in it. TMPDIR should lie on a
// disk: in memory a sync costs nothing.
class TempDir {
public:
    TempDir();
    ~TempDir();
    TempDir(const TempDir&) = delete;
    TempDir& operator=(const TempDir&) = delete;
    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
};

}  // namespace gantry::bench
