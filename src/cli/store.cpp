#include "cli/store.hpp"

#include <fstream>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"

namespace gantry::cli {

namespace {
// A file that was named may be anything; the journal takes what it is given for a damaged store.
Result<void> must_be_store(const std::string& file) {
    constexpr std::string_view magic = "SQLite format 3";
    constexpr std::string_view hint = "give the file gantry.db in the data directory of a gateway";
    auto shown = printable(file);
    std::error_code error;
    if (!std::filesystem::exists(file, error))
        return fail(fmt::format("--db: there is no file {}", shown), std::string(hint));
    if (std::filesystem::is_directory(file, error))
        return fail(fmt::format("--db: {} is a directory", shown), "a directory is given with --data-dir");
    std::string begin(magic.size(), '\0');
    if (std::ifstream in(file, std::ios::binary);
        in && (!in.read(begin.data(), std::ssize(begin)) || begin != magic))
        return fail(fmt::format("--db: {} is not a Gantry store", shown), std::string(hint));
    return {};
}
}  // namespace

void add_store_place(CLI::App& command, StorePlace& place) {
    add_place(command, place.place);
    command.add_option("--db", place.db, "The store's file, instead of gantry.db in the data directory")
        ->type_name("FILE");
}

Result<std::filesystem::path> store_file(const StorePlace& options) {
    if (!options.db.empty()) {
        if (auto fine = must_be_store(options.db); !fine) return tl::unexpected(fine.error());
        return options.db;
    }
    auto directory = options.place.directory();
    if (!directory) return tl::unexpected(directory.error());
    auto path = *directory / "gantry.db";
    std::error_code error;
    if (!std::filesystem::exists(path, error) && !error)
        return fail(fmt::format("there is no store {}", printable(path.string())),
                    "name the gateway's place with -c FILE or --data-dir DIR; `gantry run` makes the store");
    return path;
}

Result<std::unique_ptr<journal::Reader>> open_store(const StorePlace& options) {
    auto path = store_file(options);
    if (!path) return tl::unexpected(path.error());
    auto reader = journal::Reader::open(*path);
    if (reader) return std::move(*reader);
    if (reader.error().kind == journal::StoreError::Kind::foreign)
        return fail(reader.error().error.what, "give the data directory of a gateway, or its gantry.db");
    return tl::unexpected(reader.error().error);
}

bool matches(std::string_view pattern, std::string_view text) {
    if (pattern.empty()) return true;
    // What follows the last * may begin anywhere: go back there when it did not fit.
    std::size_t at = 0, star = std::string_view::npos, resume = 0, i = 0;
    while (i < text.size()) {
        if (at < pattern.size() && pattern[at] == '*') {
            star = at++;
            resume = i;
        } else if (at < pattern.size() && pattern[at] == text[i]) {
            ++at;
            ++i;
        } else if (star != std::string_view::npos) {
            at = star + 1;
            i = ++resume;
        } else {
            return false;
        }
    }
    while (at < pattern.size() && pattern[at] == '*')
        ++at;
    return at == pattern.size();
}

void mention_unknown_reader(Context& context, const journal::Reader& store, const std::string& reader) {
    if (reader.empty()) return;
    journal::Filter filter;
    filter.reader = reader;
    bool known = false;
    auto read = store.query(filter, [&](const event::Event& /*event*/) {
        known = true;
        return false;
    });
    if (!read || known) return;
    context.out << std::flush;
    context.err << fmt::format("the store knows no reader \"{}\": see `gantry reader list`\n",
                               printable(reader))
                << std::flush;
}

}  // namespace gantry::cli
