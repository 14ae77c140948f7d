#include "sinks/jsonl/jsonl.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/log.hpp"
#include "base/text.hpp"
#include "document/check.hpp"
#include "sinks/jsonl/file_names.hpp"
#include "sinks/jsonl/sample.hpp"  // made by CMake from sample.toml

namespace gantry::sinks::jsonl {

using sink::Outcome;

static constexpr std::size_t buffered = 1024 * 1024;  // bytes between two writes

static Steady steady_now() {
    return std::chrono::steady_clock::now();
}

Outcome Jsonl::deliver(std::span<const sink::Item> batch, const sink::Patience& patience) {
    if (patience.over(steady_now()))
        return Outcome::kept(batch.size(), "the time was over before anything was written");
    std::uint64_t bytes = 0;
    for (auto& item : batch)
        bytes += item.payload.size() + 1;
    if (auto ready = get_ready(bytes); !ready) return Outcome::kept(batch.size(), ready.error().text());
    if (auto written = write(batch); !written) {
        file_->undo();
        file_.reset();
        return Outcome::kept(batch.size(), written.error().text());
    }
    return Outcome::accepted(batch.size());
}

// A file that is old is full, so that whoever takes the full ones gets it though nothing comes any more.
void Jsonl::idle(const sink::Patience& /*patience*/) {
    if (!file_ || file_->size() == 0 || !is_old() || !file_->still_at_path()) return;
    if (auto begun = begin_file(number_ + 1); !begun) {
        log::warn("sink", "{}", begun.error().text());
        old_at_ = steady_now() + 1min;
    }
}

Result<void> Jsonl::get_ready(std::uint64_t bytes) {
    if (file_ && !file_->still_at_path()) {
        log::info("sink", "{} was moved away or deleted by somebody", printable(path_of(number_)));
        file_.reset();
    }
    if (!file_)
        if (auto opened = open_newest(); !opened) return opened;
    bool full = file_->size() + bytes > rotation_.size && bytes != 0;
    if (file_->size() == 0 || (!full && !is_old())) return {};
    return begin_file(number_ + 1);
}

Result<void> Jsonl::open_newest() {
    auto newest = [this]() -> Result<Found> {
        auto found = find_files(keeping_.dir, keeping_.stem);
        if (!found) return tl::unexpected(found.error());
        return found->empty() ? Found{} : found->back();
    };
    auto last = newest();
    if (!last) return tl::unexpected(last.error());
    auto number = last->number;
    // Of one number the plain form sorts first: any other behind it means that it is full.
    if (number == 0 || last->form != Form::plain) return begin_file(number + 1);
    auto file = LineFile::resume(path_of(number), keeping_.mode);
    if (!file) return tl::unexpected(file.error());
    // Whoever had it until now may just have gone on to the next one.
    last = newest();
    if (!last) return tl::unexpected(last.error());
    if (last->number != number)
        return fail(fmt::format("another program is writing to {}", printable(path_of(last->number))),
                    "each sink needs a directory or a name of its own");
    number_ = number;
    auto wall = std::chrono::time_point_cast<std::chrono::microseconds>(std::chrono::system_clock::now());
    old_at_ = steady_now() + rotation_.after - std::clamp(file->age(wall), 0us, rotation_.after);
    file_.emplace(std::move(*file));
    keeper_.tidy_below(number_);
    return {};
}

// The new one is there and locked before the old one is let go, so nobody takes the old one for the newest.
Result<void> Jsonl::begin_file(std::uint64_t number) {
    auto file = LineFile::create(path_of(number), keeping_.mode);
    if (!file) return tl::unexpected(file.error());
    file_.emplace(std::move(*file));  // the old one is closed, and unlocked for the keeper
    number_ = number;
    old_at_ = steady_now() + rotation_.after;
    keeper_.tidy_below(number_);
    return {};
}

Result<void> Jsonl::write(std::span<const sink::Item> batch) {
    buffer_.clear();
    for (auto& item : batch) {
        buffer_ += item.payload;
        buffer_ += '\n';
        if (buffer_.size() < buffered) continue;
        if (auto done = file_->append(buffer_); !done) return done;
        buffer_.clear();
    }
    if (auto done = file_->append(buffer_); !done) return done;
    return batch.empty() ? Result<void>() : file_->sync();
}

bool Jsonl::is_old() const {
    return rotation_.after != 0us && steady_now() >= old_at_;
}

std::string Jsonl::path_of(std::uint64_t number) const {
    return keeping_.dir + '/' + file_name(keeping_.stem, number, Form::plain);
}

namespace {

constexpr std::array<std::string_view, 2> modes = {"0600", "0640"};

constexpr SettingRow rows[] = {
    {.name = "dir",
     .kind = SettingRow::Kind::text,
     .fallback = "",
     .help = "Where the files go, from the root on. It must be there. Required.",
     .min = 0,
     .max = 1000},
    {.name = "rotate_size",
     .kind = SettingRow::Kind::text,
     .fallback = "128MiB",
     .help = "A new file is begun before this one would grow beyond that."},
    {.name = "rotate_after",
     .kind = SettingRow::Kind::duration,
     .fallback = "1d",
     .help = "A new file is begun when this one is so old; 0s: never.",
     .min = 0,
     .max = 366.0 * 86'400},
    {.name = "gzip",
     .kind = SettingRow::Kind::boolean,
     .fallback = "false",
     .help = "Compress the files that are full."},
    {.name = "keep_files",
     .kind = SettingRow::Kind::number,
     .fallback = "0",
     .help = "How many files stay, the oldest are deleted; 0: all.",
     .min = 0,
     .max = 1e9},
    {.name = "mode",
     .kind = SettingRow::Kind::choice,
     .fallback = "0600",
     .help = "Who may read the files: this user, or also its group.",
     .choices = modes},
};

Result<std::unique_ptr<sink::Sink>> make(const sink::Options& options, sink::Host& /*host*/) {
    constexpr std::size_t longest_stem = 200;
    auto& settings = options.settings;
    Keeping keeping{.dir = std::string(settings.text("dir")),
                    .stem = stem_of(options.name),
                    .gzip = settings.boolean("gzip"),
                    .files = static_cast<std::uint64_t>(settings.number("keep_files")),
                    .mode = settings.text("mode") == "0640" ? 0640U : 0600U};
    if (keeping.dir.empty())
        return fail("[[sink]] of type jsonl needs a dir", "add dir = \"/var/lib/gantry/archive\"");
    if (!keeping.dir.starts_with('/'))
        return fail(fmt::format("dir = \"{}\" does not begin with /", printable(keeping.dir)),
                    "name the directory from the root on, like \"/var/lib/gantry/archive\"");
    if (keeping.dir.find('\0') != std::string::npos) return fail("dir holds a NUL byte");
    if (keeping.stem.empty() || keeping.stem.size() > longest_stem)
        return fail("the sink's name is empty or too long to be part of a file's name",
                    "give it a shorter one");
    auto size = document::parse_size(settings.text("rotate_size"));
    if (!size || *size == 0)
        return fail(fmt::format("rotate_size = \"{}\" is no size", printable(settings.text("rotate_size"))),
                    "write it like \"128MiB\" or \"1GiB\"");
    return std::make_unique<Jsonl>(
        keeping, Rotation{static_cast<std::uint64_t>(*size), settings.duration("rotate_after")});
}

}  // namespace

const sink::Kind kind{
    .name = "jsonl",
    .title = "JSON Lines files",
    .summary = "one event a line; confirmed when the line and its file's name are on disk (fdatasync)",
    .schemes = {},
    .settings = rows,
    .batch = 1000,
    .idempotent = false,
    .sample_toml = sample_toml,
    .make = &make,
};

}  // namespace gantry::sinks::jsonl
