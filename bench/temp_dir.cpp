#include "bench/temp_dir.hpp"

#include <stdlib.h>

#include <string>
#include <system_error>

namespace gantry::bench {

TempDir::TempDir() {
    auto name = (std::filesystem::temp_directory_path() / "gantry-bench-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr)
        throw std::filesystem::filesystem_error("cannot make a directory", name,
                                                std::error_code(errno, std::generic_category()));
    path_ = name;
}

TempDir::~TempDir() {
    std::error_code ignored;  // what cannot be removed is left to the system
    std::filesystem::remove_all(path_, ignored);
}

}  // namespace gantry::bench
