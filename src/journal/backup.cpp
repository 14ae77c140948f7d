#include <fmt/format.h>

#include "base/failpoint.hpp"
#include "base/text.hpp"
#include "journal/copy.hpp"
#include "journal/files.hpp"
#include "journal/schema.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal {

StoreResult<void> copy_database(const std::filesystem::path& from, const std::filesystem::path& to,
                                const Progress& progress) {
    auto source = Database::open(from, Database::Access::read);
    if (!source) return tl::unexpected(source.error());
    auto version = stored_version(*source, schema_version());
    if (!version) return tl::unexpected(version.error());
    if (*version == 0)
        return tl::unexpected(
            StoreError{StoreError::Kind::foreign, {fmt::format("{} holds no store", from.string()), {}}});
    auto target = Database::open(to, Database::Access::write);
    if (!target) return tl::unexpected(target.error());
    auto go_on = [&](std::uint64_t done, std::uint64_t all) { return !progress || progress(done, all); };
    if (auto copied = source->copy_to(*target, go_on); !copied) return copied;
    // A copy is one file, that can also be read where nothing can be written.
    return target->run("PRAGMA journal_mode=DELETE");
}

StoreResult<Checked> back_up(const std::filesystem::path& path, const std::filesystem::path& backup,
                             bool replace, const Progress& progress) {
    std::error_code none;
    if (std::filesystem::equivalent(path, backup, none))
        return tl::unexpected(StoreError{StoreError::Kind::other,
                                         {fmt::format("{} is the store itself", printable(backup.string())),
                                          "give the backup another name"}});
    if (!replace && std::filesystem::exists(backup, none))
        return tl::unexpected(StoreError{StoreError::Kind::other,
                                         {fmt::format("{} is there already", printable(backup.string())),
                                          "give another name, or --force to replace it"}});
    auto part = beside(backup, ".part");
    auto claim = FileClaim::take(part);
    if (!claim) return tl::unexpected(claim.error());
    // What one that was cut off has left.
    std::filesystem::resize_file(part, 0, none);
    std::filesystem::permissions(
        part, std::filesystem::perms::owner_read | std::filesystem::perms::owner_write, none);
    auto made = [&]() -> StoreResult<Checked> {
        if (auto copied = copy_database(path, part, progress); !copied) return tl::unexpected(copied.error());
        if (auto synced = sync_file(part); !synced) return tl::unexpected(synced.error());
        auto checked = check_store(part, progress);
        if (!checked) return checked;
        if (!checked->sound())
            return tl::unexpected(
                StoreError{StoreError::Kind::corrupt,
                           {fmt::format("the store {} is damaged, so this is no backup of it: {}",
                                        path.string(), checked->problems.front()),
                            "see `gantry store check`"}});
        die_at("backup_in_place");
        if (auto placed = put_in_place(part, backup, replace); !placed) return tl::unexpected(placed.error());
        return checked;
    }();
    if (!made) remove_database(part);
    return made;
}

}  // namespace gantry::journal
