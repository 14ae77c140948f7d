#include "cli/whole_file.hpp"

#include <cerrno>
#include <cstring>

#include <fmt/format.h>

#include "base/text.hpp"
#include "journal/files.hpp"

namespace gantry::cli {

Result<WholeFile> WholeFile::open(const std::string& name) {
    WholeFile file(name);
    std::error_code none;
    auto there = std::filesystem::status(file.name_, none);
    if (!std::filesystem::exists(there) || std::filesystem::is_regular_file(there)) {
        // A link stays one: what it points to gets the new content.
        if (std::filesystem::is_symlink(file.name_, none))
            if (auto target = std::filesystem::weakly_canonical(file.name_, none); !none) file.name_ = target;
        file.part_ = journal::beside(file.name_, ".part");
    }
    file.out_.open(file.part_.empty() ? file.name_ : file.part_, std::ios::binary | std::ios::trunc);
    if (file.out_) return file;
    auto why = std::strerror(errno);
    file.part_.clear();
    return fail(fmt::format("cannot write {}: {}", printable(name), why),
                "is the directory there, and may this user write to it?");
}

Result<void> WholeFile::finish() {
    auto cannot = [&](const std::string& why) {
        return fail(fmt::format("cannot write {}", printable(name_.string())), why);
    };
    if (!out_.flush()) return cannot("is the disk full?");
    out_.close();
    if (part_.empty()) return {};
    if (auto synced = journal::sync_file(part_); !synced) return cannot(synced.error().error.what);
    if (auto placed = journal::put_in_place(part_, name_, true); !placed)
        return cannot(placed.error().error.what);
    part_.clear();
    return {};
}

WholeFile::~WholeFile() {
    if (part_.empty()) return;
    out_.close();
    std::error_code none;
    std::filesystem::remove(part_, none);
}

}  // namespace gantry::cli
