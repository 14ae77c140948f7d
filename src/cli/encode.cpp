// gantry encode: JSON, or a message by its name, to frames.
#include <algorithm>
#include <filesystem>
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "api/message_json.hpp"
#include "base/text.hpp"
#include "cli/commands.hpp"
#include "cli/input.hpp"
#include "cli/protocol.hpp"
#include "cli/typed_message.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {

namespace {
struct EncodeOptions {
    Protocol protocol;
    std::vector<std::string> words;  // FILE, or NAME Field=value ...
    bool raw = false;
    bool json = false;
};

void print(Context& context, const EncodeOptions& options, ByteView frame) {
    if (options.raw)
        context.out << as_text(frame);
    else if (options.json)
        context.out << "{\"hex\":\"" << to_hex(frame) << "\"}\n";
    else
        context.out << to_hex(frame) << '\n';
}

Result<Bytes> encode_line(const EncodeOptions& options, const std::string& text) {
    auto line = api::parse_line(text);
    if (!line) return tl::unexpected(line.error());
    auto& protocol = options.protocol;
    for (auto [said, wanted, option] : {std::tuple{&line->protocol, &protocol.name, "-p"},
                                        std::tuple{&line->direction, &protocol.direction_name, "-d"}})
        if (!said->empty() && *said != *wanted)
            return fail(fmt::format("the line is of {}, not {}", printable(*said), *wanted),
                        fmt::format("use {} {}", option, printable(*said)));
    if (auto* raw = std::get_if<Bytes>(&line->content)) return std::move(*raw);
    auto& message = std::get<wire::Message>(line->content);
    Bytes frame;
    auto& codec = protocol.codec();
    // No check(): what was decoded must come back whether or not it was legal.
    if (auto fine = codec.encode(message, protocol.direction(), frame); !fine)
        return tl::unexpected(explain(fine.error(), message.name, codec, protocol.direction()));
    return frame;
}

int encode_lines(Context& context, const EncodeOptions& options, const std::string& file) {
    auto input = Input::open(context, file);
    if (!input) return complain(context, "encode", input.error());
    std::string line;
    while (context.out) {
        auto more = input->next_line(line);
        if (!more) return complain(context, "encode", more.error());
        if (!*more) break;
        if (line.find_first_not_of(" \t") == std::string::npos) continue;
        auto frame = encode_line(options, line);
        if (!frame) {
            context.out << std::flush;
            return complain(context, "encode", at_line(*input, frame.error()));
        }
        print(context, options, *frame);
        if (input->idle()) context.out << std::flush;
    }
    return done;
}

int encode_typed(Context& context, const EncodeOptions& options) {
    auto& codec = options.protocol.codec();
    auto direction = options.protocol.direction();
    auto& name = options.words.front();
    auto message = typed_message(name, std::span(options.words).subspan(1));
    if (!message) return complain(context, "encode", message.error());
    Bytes frame;
    auto fine = codec.check(*message, direction);
    if (fine) fine = codec.encode(*message, direction, frame);
    if (!fine) return complain(context, "encode", explain(fine.error(), name, codec, direction));
    print(context, options, frame);
    return done;
}

// One word may be a message without fields or a file; a message of that name wins (./NAME is the file).
int encode(Context& context, const EncodeOptions& options) {
    auto names = options.protocol.codec().names(options.protocol.direction());
    if (options.words.empty()) return encode_lines(context, options, "-");
    auto& first = options.words.front();
    bool is_message = std::ranges::find(names, first) != names.end();
    std::error_code error;
    if (options.words.size() == 1 && !is_message && (first == "-" || std::filesystem::exists(first, error)))
        return encode_lines(context, options, first);
    if (is_message || options.words.size() > 1) return encode_typed(context, options);
    auto near = nearest(first, names);
    return complain(context, "encode",
                    {fmt::format("there is neither a message nor a file {}", printable(first)),
                     near.empty() ? fmt::format("messages: {}", fmt::join(names, ", "))
                                  : fmt::format("did you mean {}?", near)});
}

std::vector<std::string> message_names() {
    std::vector<std::string> names;
    for (auto* make : plugins())
        for (auto direction : {wire::Direction::to_reader, wire::Direction::to_host})
            for (auto name : make->codec().names(direction))
                names.emplace_back(name);
    std::ranges::sort(names);
    names.erase(std::unique(names.begin(), names.end()), names.end());
    return names;
}
}  // namespace

void add_encode(CLI::App& app, Context& context) {
    auto make = example_make();
    auto message = plugins().front()->codec().names(wire::Direction::to_reader).front();
    auto& command = add_command(
        app, "encode", "The JSON that decode prints, or a message by its name, to hex",
        fmt::format("gantry encode -p {0} -d to-reader {1}\n"
                    "gantry encode -p {0} -d to-reader NAME Field=value List='[{{\"Field\":1}}]'\n"
                    "gantry encode -p {0} -d to-host messages.jsonl\n"
                    "gantry decode -p {0} -d to-host --raw in.bin | gantry encode -p {0} -d "
                    "to-host --raw > same.bin",
                    make, message));
    auto options = std::make_shared<EncodeOptions>();
    add_protocol(command, context, options->protocol);
    auto* words = command.add_option(
        "FILE|NAME", options->words,
        "A file of JSON lines, - for the standard input (the default), or a message by its name with its "
        "fields as Field=value. A value that starts with [, { or \" is JSON");
    words->type_name("");
    context.words[words] = message_names();
    command.add_flag("--raw", options->raw, "Write the bytes themselves");
    command.add_flag("--json", options->json, "Write {\"hex\":\"…\"} instead of bare hex");
    on_run(command, context, [&context, options] { return encode(context, *options); });
}

}  // namespace gantry::cli
