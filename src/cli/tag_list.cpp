// gantry tag list: the tags that are there now, and how a tag is named.
#include <algorithm>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <boost/json.hpp>

#include "api/json_text.hpp"
#include "base/text.hpp"
#include "cli/input.hpp"
#include "cli/store.hpp"
#include "cli/tag_words.hpp"
#include "epc/epc.hpp"
#include "link/link.hpp"

namespace gantry::cli {

Result<Bytes> read_tag_id(std::string_view text) {
    constexpr std::string_view pure = "urn:epc:id:", uri = "urn:epc:";
    if (text.starts_with(pure) || text.starts_with('('))
        return fail(
            fmt::format("{} is not all that a tag holds: its filter value is missing{}", printable(text),
                        text.starts_with('(') ? ", and how long the company prefix is" : ""),
            "write it as urn:epc:tag:…, or take the hex that `gantry epc encode` gives");
    auto bytes = text.starts_with(uri) ? epc::encode(text) : read_hex(text);
    if (!bytes && !text.starts_with(uri))
        return fail(fmt::format("{} is no tag: {}", printable(text), bytes.error().what),
                    "write its id in hex, as `gantry tag list` shows it, or as urn:epc:tag:…");
    if (!bytes) return bytes;
    if (bytes->empty() || bytes->size() > event::TagId::max_size)
        return fail(
            fmt::format("{} is no tag: an id has 1 to {} bytes", printable(text), event::TagId::max_size),
            "write it in hex, as `gantry tag list` shows it");
    return bytes;
}

namespace {
namespace json = boost::json;

struct Options {
    StorePlace store;
    std::string reader, zone;
    bool json = false;
};

json::object to_json(const journal::PresentTag& tag) {
    json::object out;
    auto add = [&](std::string_view key, const std::string& value) {
        if (!value.empty()) out[key] = value;
    };
    out["tag"] = to_hex(tag.tag.view());
    add("epc", tag.epc);
    add("zone", tag.zone);
    add("reader", tag.reader);
    add("antenna", tag.antenna);
    out["first_seen"] = to_rfc3339(tag.first_seen);
    out["last_seen"] = to_rfc3339(tag.last_seen);
    out["reads"] = tag.reads;
    if (tag.rssi) out["rssi_dbm"] = *tag.rssi / 10.0;
    add("pc", to_hex(event::pc_words(tag.pc).view()));
    add("xpc", to_hex(event::xpc_words(tag.xpc).view()));
    return out;
}

void print_table(std::ostream& out, const std::vector<journal::PresentTag>& tags, Wall now) {
    std::size_t tag_width = 3, zone_width = 4, place_width = 6;
    auto place = [](const journal::PresentTag& tag) {
        return printable(tag.antenna.empty() ? tag.reader : tag.reader + "/" + tag.antenna);
    };
    for (auto& tag : tags) {
        tag_width = std::max<std::size_t>(tag_width, 2 * tag.tag.view().size());
        zone_width = std::max(zone_width, printable(tag.zone).size());
        place_width = std::max(place_width, place(tag).size());
    }
    out << fmt::format("{:<{}}  {:<{}}  {:<{}}  {:>9} {:>8}  {:<12}  {}\n", "TAG", tag_width, "ZONE",
                       zone_width, "READER", place_width, "RSSI", "READS", "SINCE", "EPC");
    for (auto& tag : tags)
        out << fmt::format("{:<{}}  {:<{}}  {:<{}}  {:>9} {:>8}  {:<12}  {}\n", to_hex(tag.tag.view()),
                           tag_width, printable(tag.zone), zone_width, place(tag), place_width,
                           tag.rssi ? fmt::format("{:.1f} dBm", *tag.rssi / 10.0) : "-", tag.reads,
                           approximate(now - tag.first_seen), tag.epc.empty() ? "-" : tag.epc);
}

int list(Context& context, const Options& options) {
    constexpr std::string_view verb = "tag list";
    auto store = open_store(options.store);
    if (!store) return complain(context, verb, store.error());
    std::vector<journal::PresentTag> tags;
    auto read = (*store)->present_tags([&](const journal::PresentTag& tag) {
        if (matches(options.reader, tag.reader) && matches(options.zone, tag.zone)) tags.push_back(tag);
        return true;
    });
    if (!read) return complain(context, verb, read.error().error);
    std::ranges::sort(tags, {}, &journal::PresentTag::first_seen);
    if (options.json) {
        for (auto& tag : tags)
            context.out << api::json_text(to_json(tag)) << '\n';
    } else if (tags.empty()) {
        context.out << "No tag is there now.\n";
    } else {
        print_table(context.out, tags, link::read_clocks().wall);
    }
    if (tags.empty()) mention_unknown_reader(context, **store, options.reader);
    return done;
}
}  // namespace

void add_tag_list(CLI::App& tag, Context& context) {
    auto options = std::make_shared<Options>();
    auto& command = add_command(tag, "list", "The tags that are there now, as the gateway's store has them",
                                "gantry tag list\ngantry tag list --zone dock\n"
                                "gantry tag list --reader 'gate-*' --json | jq -r .tag");
    add_store_place(command, options->store);
    command.add_option("--reader", options->reader,
                       "Only tags that this reader saw last; * stands for anything");
    command.add_option("--zone", options->zone, "Only this zone; * stands for anything");
    command.add_flag("--json", options->json, "One JSON object a line");
    on_run(command, context, [&context, options] { return list(context, *options); });
}

}  // namespace gantry::cli
