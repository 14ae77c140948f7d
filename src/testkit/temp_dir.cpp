#include "testkit/temp_dir.hpp"

#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include <gtest/gtest.h>

namespace gantry::testkit {

TempDir::TempDir(const std::filesystem::path& parent) : path_(parent / "gantry-test-XXXXXX") {
    if (mkdtemp(path_.data()) == nullptr)
        throw std::runtime_error("no temporary directory in " + parent.string());
}

TempDir::~TempDir() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
}

void write_file(const std::string& path, const std::string& text) {
    std::ofstream file(path, std::ios::binary | std::ios::trunc);
    file << text;
    if (!file.flush()) ADD_FAILURE() << "cannot write " << path;
}

}  // namespace gantry::testkit
