// gantry decode: frames to JSON.
#include <ostream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "cli/commands.hpp"
#include "cli/frames.hpp"
#include "cli/input.hpp"
#include "cli/protocol.hpp"

namespace gantry::cli {

namespace {
struct DecodeOptions {
    Protocol protocol;
    std::string file = "-";
    bool raw = false;
    bool json = false;
};

struct Tally {
    std::size_t bytes = 0, places = 0;
    void add(const Frames& frames) {
        bytes += frames.bad_bytes();
        places += frames.bad_places();
    }
};

// Each line is a stream of its own: offsets count from its start.
Result<void> decode_lines(Context& context, const DecodeOptions& options, Input& input, Tally& tally) {
    std::string line, out;
    for (;;) {
        auto more = input.next_line(line);
        if (!more) return tl::unexpected(more.error());
        if (!*more) return {};
        auto bytes = read_hex(line);
        if (!bytes) return tl::unexpected(at_line(input, bytes.error()));
        auto frames = options.protocol.frames();
        out.clear();
        frames.add(*bytes, true, out);
        tally.add(frames);
        context.out << out;
        if (input.idle()) context.out << std::flush;
        if (!context.out) return {};
    }
}

Result<void> decode_raw(Context& context, const DecodeOptions& options, Input& input, Tally& tally) {
    auto frames = options.protocol.frames();
    std::string out;
    for (bool end = false; !end && context.out;) {
        auto piece = input.next_piece();
        if (!piece) return tl::unexpected(piece.error());
        end = piece->empty();
        out.clear();
        frames.add(*piece, end, out);
        context.out << out;
        if (end || input.idle()) context.out << std::flush;
    }
    tally.add(frames);
    return {};
}

int decode(Context& context, const DecodeOptions& options) {
    auto input = Input::open(context, options.file);
    if (!input) return complain(context, "decode", input.error());
    Tally tally;
    auto read = options.raw ? decode_raw(context, options, *input, tally)
                            : decode_lines(context, options, *input, tally);
    context.out << std::flush;
    if (!read) return complain(context, "decode", read.error());
    if (tally.bytes == 0 || !context.out) return done;  // run() looks at the output
    return complain(
        context, "decode",
        {fmt::format("{} {} could not be decoded", tally.bytes, tally.bytes == 1 ? "byte" : "bytes"),
         fmt::format("see the {} with \"error\" in the output",
                     tally.places == 1 ? "line" : fmt::format("{} lines", tally.places))});
}
}  // namespace

void add_decode(CLI::App& app, Context& context) {
    auto make = example_make();
    auto& command = add_command(
        app, "decode", "Frames as hex or raw bytes to JSON, one object a message",
        fmt::format("gantry decode -p {0} -d to-host frames.hex\n"
                    "gantry decode -p {0} -d to-host --raw capture.bin | jq -c 'select(.error)'\n"
                    "gantry decode -p {0} -d to-host frames.hex | gantry encode -p {0} -d to-host",
                    make));
    auto options = std::make_shared<DecodeOptions>();
    add_protocol(command, context, options->protocol);
    command.add_option("FILE", options->file,
                       "One hex frame, or several back to back, a line; blanks are allowed (default: -, the "
                       "standard input)");
    command.add_flag("--raw", options->raw, "FILE holds the bytes themselves, as one stream");
    command.add_flag("--json", options->json, "Nothing changes: the output is always JSON");
    on_run(command, context, [&context, options] { return decode(context, *options); });
}

}  // namespace gantry::cli
