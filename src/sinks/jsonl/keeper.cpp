#include "sinks/jsonl/keeper.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <utility>
#include <vector>

#include "base/log.hpp"
#include "sinks/jsonl/file_names.hpp"
#include "sinks/jsonl/gzip_file.hpp"

namespace gantry::sinks::jsonl {

Keeper::Keeper(Keeping keeping) : keeping_(std::move(keeping)) {
    if (keeping_.gzip || keeping_.files != 0)
        thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void Keeper::tidy_below(std::uint64_t current) {
    {
        std::lock_guard lock(mutex_);
        current_ = current;
        due_ = true;
    }
    changed_.notify_one();
}

void Keeper::run(const std::stop_token& stop) {
    for (;;) {
        std::uint64_t current = 0;
        {
            std::unique_lock lock(mutex_);
            if (!changed_.wait(lock, stop, [this] { return due_; })) return;
            due_ = false;
            current = current_;
        }
        // What failed is tried again with the next file.
        if (auto done = tidy(keeping_, current, stop); !done) log::warn("sink", "{}", done.error().text());
    }
}

static Result<void> sync_dir(const std::string& dir) {
    int fd = ::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return tl::unexpected(system_error("cannot open", dir, errno));
    bool done = ::fsync(fd) == 0 || errno == EINVAL;  // some file systems have nothing to do there
    int number = errno;
    ::close(fd);
    if (!done) return tl::unexpected(system_error("cannot bring to disk", dir, number));
    return {};
}

static Result<void> delete_file(const std::string& path) {
    if (::unlink(path.c_str()) != 0 && errno != ENOENT)
        return tl::unexpected(system_error("cannot delete", path, errno));
    return {};
}

// The plain file goes only when the compressed one is on disk under its own name.
static Result<void> compress(const Keeping& keeping, std::uint64_t number, const std::stop_token& stop) {
    auto path = [&](Form form) { return keeping.dir + '/' + file_name(keeping.stem, number, form); };
    auto plain = path(Form::plain), unfinished = path(Form::unfinished);
    auto made = gzip_file(plain, unfinished, keeping.mode, stop);
    if (!made || !*made) {
        ::unlink(unfinished.c_str());
        return made ? Result<void>() : tl::unexpected(made.error());
    }
    if (::rename(unfinished.c_str(), path(Form::gzipped).c_str()) != 0)
        return tl::unexpected(system_error("cannot rename", unfinished, errno));
    if (auto synced = sync_dir(keeping.dir); !synced) return synced;
    return delete_file(plain);
}

Result<void> tidy(const Keeping& keeping, std::uint64_t current, const std::stop_token& stop) {
    auto found = find_files(keeping.dir, keeping.stem);
    if (!found) return tl::unexpected(found.error());
    std::erase_if(*found, [&](auto& each) { return each.number >= current; });
    std::vector<std::uint64_t> numbers;  // of full files, rising
    for (auto& each : *found)
        if (numbers.empty() || numbers.back() != each.number) numbers.push_back(each.number);
    auto has = [&](std::uint64_t number, Form form) {
        return std::ranges::find(*found, Found{number, form}) != found->end();
    };
    auto remove = [&](std::uint64_t number, Form form) -> Result<void> {
        if (!has(number, form)) return {};
        return delete_file(keeping.dir + '/' + file_name(keeping.stem, number, form));
    };
    std::size_t too_many =
        keeping.files != 0 && numbers.size() >= keeping.files ? numbers.size() + 1 - keeping.files : 0;
    for (std::size_t i = 0; i < numbers.size() && !stop.stop_requested(); ++i) {
        auto number = numbers[i];
        bool goes = i < too_many;
        if (auto done = remove(number, Form::unfinished); !done) return done;
        // With both forms there, a crash came between the two steps of compress().
        if (goes || has(number, Form::gzipped))
            if (auto done = remove(number, Form::plain); !done) return done;
        if (goes)
            if (auto done = remove(number, Form::gzipped); !done) return done;
        if (!goes && keeping.gzip && has(number, Form::plain) && !has(number, Form::gzipped))
            if (auto done = compress(keeping, number, stop); !done) return done;
    }
    return {};
}

}  // namespace gantry::sinks::jsonl
