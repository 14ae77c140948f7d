// Another store in the place of the one there is: a backup, or a new one where the old is damaged. What takes
// the place is made ready beside it. With the name gantry.db.restored it is decided: from then on the change
// is carried through, after a crash by whoever comes next, and the old store is in a directory of its own.
#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>

#include <fmt/format.h>

#include "base/failpoint.hpp"
#include "base/text.hpp"
#include "journal/copy.hpp"
#include "journal/files.hpp"
#include "journal/ids.hpp"
#include "journal/schema.hpp"
#include "journal/upkeep.hpp"

namespace gantry::journal {

namespace {
constexpr std::string_view preparing_suffix = ".restoring", decided_suffix = ".restored";
constexpr std::string_view aside_name = "set-aside-";
constexpr std::size_t most_aside = 3;  // of damaged stores: a disk that breaks each new one must not fill up

tl::unexpected<StoreError> other(std::string what, std::string hint = {}) {
    return tl::unexpected(StoreError{StoreError::Kind::other, {std::move(what), std::move(hint)}});
}

// What must not be used again.
struct Used {
    std::string gateway_id;
    std::uint64_t epoch = 0;
    Seq next_seq = 1;
};

// Of a store that may be damaged, of an older version, or not there. Nothing: it cannot be known.
std::optional<Used> used_by(const std::filesystem::path& path) {
    if (size_of(path) == 0) return {};
    auto db = Database::open(path, Database::Access::read);
    if (!db) return {};
    auto version = stored_version(*db, schema_version());
    if (!version || *version == 0) return {};
    // Version 1 had two columns less.
    auto columns = *version > 1
                       ? std::string(select_state)
                       : "SELECT id, gateway_id, epoch, next_seq, last_commit_us, next_tag, max_presence, 0, "
                         "0, sum FROM state";
    auto row = db->prepare(columns);
    State state;
    if (!row || row->step() != Step::row || !take(*row, state).sound()) return {};
    return Used{state.gateway_id, state.epoch, state.next_seq};
}

// The highest epoch for which a store was set aside here; 0: none.
std::uint64_t highest_aside(const std::filesystem::path& path) {
    std::uint64_t highest = 0;
    std::error_code none;
    for (auto& entry : std::filesystem::directory_iterator(directory_of(path), none)) {
        auto name = entry.path().filename().string();
        if (!name.starts_with(aside_name)) continue;
        std::uint64_t epoch = 0;
        std::from_chars(name.data() + aside_name.size(), name.data() + name.size(), epoch);
        highest = std::max(highest, epoch);
    }
    return highest;
}

// Higher than any before. Where those are not known it is the second that we live in: no count of restores
// comes near it.
std::uint64_t next_epoch(const std::filesystem::path& path, const std::optional<Used>& used,
                         std::uint64_t in_backup, Wall now) {
    auto known = std::max(in_backup, highest_aside(path));
    if (used) return std::max(used->epoch, known) + 1;
    auto second = static_cast<std::uint64_t>(std::max<std::int64_t>(to_us(now), 0)) / 1'000'000;
    return std::max(second, known + 1);
}

std::filesystem::path aside_of(const std::filesystem::path& path, std::uint64_t epoch) {
    return directory_of(path) / fmt::format("{}{}", aside_name, epoch);
}

// Both are as they should be on the disk, then the change is decided.
StoreResult<void> decide(const std::filesystem::path& path) {
    auto ready = beside(path, preparing_suffix);
    {
        // One file, which can be looked into without making others.
        auto db = Database::open(ready, Database::Access::write);
        if (!db) return tl::unexpected(db.error());
        if (auto alone = db->run("PRAGMA journal_mode=DELETE"); !alone) return alone;
    }
    if (size_of(beside(ready, log_suffix)) != 0)
        return other(fmt::format("{} could not be finished: its log is not empty", ready.string()));
    if (auto synced = sync_file(ready); !synced) return synced;
    die_at("restore_decided");
    if (auto decided = put_in_place(ready, beside(path, decided_suffix), true); !decided) return decided;
    return finish_restore(path);
}
}  // namespace

StoreResult<void> finish_restore(const std::filesystem::path& path) {
    auto decided = beside(path, decided_suffix);
    if (size_of(decided) == 0) return {};
    auto is = used_by(decided);
    if (!is)
        return tl::unexpected(damaged(
            decided, "it was about to take the place of the store; remove it, and restore once more"));
    auto aside = aside_of(path, is->epoch);
    std::error_code error;
    for (auto suffix : {log_suffix, index_suffix, std::string_view()}) {
        auto from = beside(path, suffix);
        if (!std::filesystem::exists(from, error)) continue;
        std::filesystem::create_directory(aside, error);
        std::filesystem::permissions(aside, std::filesystem::perms::owner_all, error);
        std::filesystem::rename(from, aside / from.filename(), error);
        if (error)
            return other(
                fmt::format("cannot move {} into {}: {}", from.string(), aside.string(), error.message()),
                "check that this user may write to the directory, and start again");
        die_at("restore_moved");
    }
    if (std::filesystem::exists(aside, error))
        if (auto synced = sync_directory(aside); !synced) return synced;
    if (auto synced = sync_directory(directory_of(path)); !synced) return synced;
    return put_in_place(decided, path, true);
}

std::vector<std::filesystem::path> stores_set_aside(const std::filesystem::path& path) {
    std::vector<std::filesystem::path> all;
    std::error_code error;
    for (auto& entry : std::filesystem::directory_iterator(directory_of(path), error))
        if (entry.path().filename().string().starts_with(aside_name) &&
            std::filesystem::exists(entry.path() / path.filename(), error))
            all.push_back(entry.path());
    std::ranges::sort(all);
    return all;
}

StoreResult<Restored> restore(const std::filesystem::path& path, const std::filesystem::path& backup,
                              const RestoreOptions& options, const Progress& progress) {
    std::error_code error;
    if (std::filesystem::equivalent(path, backup, error))
        return other(fmt::format("{} is the store itself", printable(backup.string())),
                     "give the file that `gantry store backup` wrote");
    if (auto finished = finish_restore(path); !finished) return tl::unexpected(finished.error());
    auto ready = beside(path, preparing_suffix);
    remove_database(ready);
    auto made = make_private_file(ready);
    if (!made) return tl::unexpected(made.error());

    Restored out;
    auto prepared = [&]() -> StoreResult<void> {
        if (auto copied = copy_database(backup, ready, progress); !copied) return copied;
        auto journal = Journal::open({.path = ready, .max_size = 2 * size_of(ready) + (1 << 30)});
        if (!journal) return tl::unexpected(journal.error());
        auto checked = check_store(ready, progress);
        if (!checked) return tl::unexpected(checked.error());
        if (!checked->sound()) return tl::unexpected(damaged(backup, checked->problems.front()));
        out.backup = std::move(*checked);
        auto before = used_by(path);
        auto id = (*journal)->gateway_id();
        if (before && before->gateway_id != id && !options.another)
            return other(
                fmt::format("{} is of the gateway {}, and {} of the gateway {}", printable(backup.string()),
                            printable(id), path.string(), printable(before->gateway_id)),
                "with --force it takes its place");
        auto in_backup = used_by(ready);
        out.epoch = next_epoch(path, before, in_backup ? in_backup->epoch : 0, options.now);
        out.numbers_go_on = before.has_value();
        auto raised = (*journal)->raise_epoch(out.epoch, before ? before->next_seq : 1);
        if (!raised) return raised;
        out.id_prefix = (*journal)->id_prefix();
        out.next_seq = (*journal)->last_seq() + 1;
        return {};
    }();
    if (!prepared) {
        remove_database(ready);
        auto why = prepared.error();
        // The copy's name means nothing to whoever gave the backup.
        if (auto at = why.error.what.find(ready.string()); at != std::string::npos)
            why.error.what.replace(at, ready.string().size(), printable(backup.string()));
        if (why.kind == StoreError::Kind::corrupt || why.kind == StoreError::Kind::foreign)
            why.error.hint = "nothing was changed; give another backup";
        return tl::unexpected(std::move(why));
    }
    if (size_of(path) != 0) out.aside = aside_of(path, out.epoch);
    if (auto done = decide(path); !done) return tl::unexpected(done.error());
    return out;
}

namespace {
// Can it be used? Where it is read at a start, and where it grows.
StoreResult<void> usable(Journal& journal) {
    if (auto read = journal.load_presence([](const PresenceRow&) {}); !read) return read;
    return journal.try_to_append();
}

// Whether the file was a store of ours, however damaged: what is another program's is left alone. Not while
// this process has it open.
bool was_ours(const std::filesystem::path& path) {
    std::array<char, 4> id{};
    std::ifstream in(path, std::ios::binary);
    return in.seekg(68) && in.read(id.data(), std::ssize(id)) &&
           std::string_view(id.data(), id.size()) == "GNTR";
}
}  // namespace

StoreResult<Opened> open_or_set_aside(const Options& options, Wall now) {
    auto& path = options.path;
    if (auto finished = finish_restore(path); !finished) return tl::unexpected(finished.error());
    Opened out;
    auto journal = Journal::open(options);
    StoreResult<void> good;
    if (!journal)
        good = tl::unexpected(journal.error());
    else
        good = usable(**journal);
    if (good) {
        out.journal = std::move(*journal);
        return out;
    }
    journal = {};
    // A log without its store is somebody's slip, not damage.
    if (good.error().kind != StoreError::Kind::corrupt || !was_ours(path))
        return tl::unexpected(good.error());
    out.damage = good.error().error.what;
    if (stores_set_aside(path).size() >= most_aside) {
        auto why = good.error();
        why.error.hint = fmt::format(
            "{} stores are set aside in {} already: check the disk and the memory of this machine, move them "
            "elsewhere, and start again",
            most_aside, directory_of(path).string());
        return tl::unexpected(std::move(why));
    }
    auto before = used_by(path);
    auto ready = beside(path, preparing_suffix);
    remove_database(ready);
    {
        auto fresh = options;
        fresh.path = ready;
        auto opened = Journal::open(fresh);
        if (!opened) return tl::unexpected(opened.error());
        if (before)
            if (auto set = (*opened)->set_gateway_id(before->gateway_id); !set)
                return tl::unexpected(set.error());
        auto epoch = next_epoch(path, before, 0, now);
        if (auto raised = (*opened)->raise_epoch(epoch, before ? before->next_seq : 1); !raised)
            return tl::unexpected(raised.error());
        out.aside = aside_of(path, epoch);
    }
    if (auto done = decide(path); !done) return tl::unexpected(done.error());
    auto opened = Journal::open(options);
    if (!opened) return tl::unexpected(opened.error());
    out.journal = std::move(*opened);
    return out;
}

}  // namespace gantry::journal
