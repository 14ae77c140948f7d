// gantry epc: the tag data standard, both ways.
#include "epc/epc.hpp"

#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/input.hpp"

namespace gantry::cli {

namespace {
struct DecodeOptions {
    std::vector<std::string> tags;
    bool json = false;
};

struct EncodeOptions {
    std::vector<std::string> texts;
    std::optional<unsigned> filter, prefix_digits;
    bool json = false;
};

struct Member {
    std::string_view key, label;
    std::string value;
};

std::vector<Member> members(const epc::Epc& epc) {
    std::vector<Member> out;
    out.push_back({"scheme", "scheme", std::string(epc.scheme)});
    if (epc.filter) out.push_back({"filter", "filter", fmt::format("{}", *epc.filter)});
    for (auto& member : {Member{"epc", "EPC", epc.uri}, Member{"tag_uri", "tag URI", epc.tag_uri},
                         Member{"gs1", "GS1", epc.gs1}, Member{"link", "link", epc.link},
                         Member{"doubt", "doubt", epc.doubt}})
        if (!member.value.empty()) out.push_back(member);
    return out;
}

std::string json_line(ByteView bytes, const Result<epc::Epc>& epc) {
    std::string out = "{\"hex\":\"" + to_hex(bytes) + '"';
    auto add = [&out](std::string_view key, std::string_view value) {
        out += fmt::format(",\"{}\":", key);
        append_json_string(out, value);
    };
    if (epc) {
        for (auto& member : members(*epc)) {
            if (member.key == "filter")
                out += fmt::format(",\"filter\":{}", member.value);
            else
                add(member.key, member.value);
        }
    } else {
        add("scheme", "unknown");
        add("reason", epc.error().text());
    }
    return out + "}\n";
}

std::string readable(ByteView bytes, const Result<epc::Epc>& epc) {
    auto out = to_hex(bytes) + '\n';
    if (!epc) return out + fmt::format("  no EPC   {}\n", epc.error().text());
    for (auto& member : members(*epc))
        out += fmt::format("  {:<8} {}\n", member.label, printable(member.value));
    return out;
}

// That a tag holds no EPC is an answer, not a failure; only what is not hex fails.
Result<void> decode_one(Context& context, const DecodeOptions& options, std::string_view text) {
    auto bytes = read_hex(text);
    if (!bytes)
        return fail(fmt::format("\"{}\" is not hex: {}", printable(text), bytes.error().what),
                    bytes.error().hint);
    auto epc = epc::decode(*bytes);
    context.out << (options.json ? json_line(*bytes, epc) : readable(*bytes, epc));
    return {};
}

// Calls `each` for every argument, and for every line of the standard input where an argument is "-".
Result<void> for_each(Context& context, const std::vector<std::string>& arguments,
                      const std::function<Result<void>(std::string_view)>& each) {
    for (auto& argument : arguments) {
        if (argument != "-") {
            if (auto fine = each(argument); !fine) return fine;
            continue;
        }
        auto input = Input::open(context, "-");
        std::string line;
        for (;;) {
            auto more = input->next_line(line);
            if (!more) return tl::unexpected(more.error());
            if (!*more) break;
            if (line.find_first_not_of(" \t") == std::string::npos) continue;
            if (auto fine = each(line); !fine) return tl::unexpected(at_line(*input, fine.error()));
            if (input->idle()) context.out << std::flush;
            if (!context.out) return {};  // run() says why, if it matters
        }
    }
    return {};
}

Result<void> encode_one(Context& context, const EncodeOptions& options, std::string_view text) {
    if (text.starts_with('(') && !options.prefix_digits)
        return fail(fmt::format("{} does not say how long its company prefix is", printable(text)),
                    "give the number of its digits with --prefix-digits, 6 to 12");
    auto bytes = epc::encode(text, options.filter, options.prefix_digits);
    if (!bytes) return tl::unexpected(bytes.error());
    if (options.json)
        context.out << json_line(*bytes, epc::decode(*bytes));
    else
        context.out << to_hex(*bytes) << '\n';
    return {};
}

int finish(Context& context, std::string_view command, const Result<void>& result) {
    context.out << std::flush;
    return result ? done : complain(context, command, result.error());
}

void add_epc_decode(CLI::App& app, Context& context) {
    auto& command = add_command(app, "decode", "What a tag's EPC memory says",
                                "gantry epc decode 3074257BF7194E4000001A85\n"
                                "gantry epc decode --json - < tags.txt");
    auto options = std::make_shared<DecodeOptions>();
    command
        .add_option("HEX", options->tags,
                    "EPC memory after the PC word, as hex; - reads lines from the standard input")
        ->required();
    command.add_flag("--json", options->json, "One JSON object a tag");
    on_run(command, context, [&context, options] {
        auto each = [&](std::string_view text) { return decode_one(context, *options, text); };
        return finish(context, "epc decode", for_each(context, options->tags, each));
    });
}

void add_epc_encode(CLI::App& app, Context& context) {
    auto& command = add_command(app, "encode", "The bytes of an EPC, as hex",
                                "gantry epc encode urn:epc:tag:sgtin-96:3.0614141.812345.6789\n"
                                "gantry epc encode urn:epc:id:sgtin:0614141.812345.6789 --filter 3\n"
                                "gantry epc encode '(01)80614141123458(21)6789' --prefix-digits 7");
    auto options = std::make_shared<EncodeOptions>();
    command
        .add_option(
            "TEXT", options->texts,
            "A tag URI, a pure identity URI or a GS1 element string; - reads lines from the standard input")
        ->required();
    command
        .add_option("--filter", options->filter, "The filter value, where TEXT does not say it (default 0)")
        ->check(CLI::Range(0, 7));
    command
        .add_option("--prefix-digits", options->prefix_digits,
                    "Digits of the company prefix, for a GS1 element string")
        ->check(CLI::Range(6, 12));
    command.add_flag("--json", options->json, "Print what `epc decode --json` prints");
    on_run(command, context, [&context, options] {
        auto each = [&](std::string_view text) { return encode_one(context, *options, text); };
        return finish(context, "epc encode", for_each(context, options->texts, each));
    });
}
}  // namespace

void add_epc(CLI::App& app, Context& context) {
    auto& command = add_command(app, "epc", "EPC numbers: from a tag's bytes and back",
                                "gantry epc decode 3074257BF7194E4000001A85");
    command.require_subcommand(1);
    add_epc_decode(command, context);
    add_epc_encode(command, context);
}

}  // namespace gantry::cli
