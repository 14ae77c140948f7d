#pragma once
#include <memory>
#include <string>

#include "cli/place.hpp"
#include "journal/journal.hpp"

// The gateway's store, for commands that look into it. Works beside a running gateway and without one.
namespace gantry::cli {

struct StorePlace {
    Place place;
    std::string db;
};
// -c, --data-dir and --db
void add_store_place(CLI::App& command, StorePlace& place);
// The file, which is there; that of --db at least begins as a store does.
Result<std::filesystem::path> store_file(const StorePlace& place);
Result<std::unique_ptr<journal::Reader>> open_store(const StorePlace& place);

// As the journal's filters do: empty fits all, * stands for anything.
bool matches(std::string_view pattern, std::string_view text);
// Nothing was found for --reader: says so on stderr where the store never heard of such a reader.
void mention_unknown_reader(Context& context, const journal::Reader& store, const std::string& reader);

}  // namespace gantry::cli
