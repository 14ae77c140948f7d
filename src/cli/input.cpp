#include "cli/input.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <istream>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::cli {

namespace {
constexpr int at_end = std::char_traits<char>::eof();
}

Result<Input> Input::open(Context& context, const std::string& file) {
    Input input;
    if (file == "-") {
        input.in_ = &context.in;
        input.name_ = "the standard input";
        return input;
    }
    input.name_ = printable(file);
    std::error_code error;
    if (!std::filesystem::exists(file, error))
        return fail(fmt::format("there is no file {}", input.name_),
                    "name a file, or - for the standard input");
    if (std::filesystem::is_directory(file, error))
        return fail(fmt::format("{} is a directory", input.name_));
    auto stream = std::make_shared<std::ifstream>(file, std::ios::binary);
    if (!stream->is_open())
        return fail(fmt::format("{} cannot be opened", input.name_), "may this user read it?");
    input.owned_ = std::move(stream);
    input.in_ = input.owned_.get();
    return input;
}

Result<bool> Input::next_line(std::string& line) {
    line.clear();
    auto* buffer = in_->rdbuf();
    ++line_number_;
    for (;;) {
        int c = buffer->sbumpc();
        if (c == '\n') break;
        if (c == at_end) {
            if (line.empty()) return false;
            break;
        }
        if (line.size() == max_line)
            return fail(fmt::format("line {} of {} is over 64 MiB", line_number_, name_),
                        "is it binary? then use --raw");
        line.push_back(static_cast<char>(c));
    }
    if (line.ends_with('\r')) line.pop_back();
    return true;
}

Result<Bytes> Input::next_piece() {
    Bytes piece;
    auto* buffer = in_->rdbuf();
    if (buffer->sgetc() == at_end) return piece;  // waits for the first byte
    constexpr std::streamsize most = 64 << 10;
    piece.resize(static_cast<std::size_t>(std::clamp(buffer->in_avail(), std::streamsize{1}, most)));
    auto got =
        buffer->sgetn(reinterpret_cast<char*>(piece.data()), static_cast<std::streamsize>(piece.size()));
    piece.resize(static_cast<std::size_t>(got));
    return piece;
}

bool Input::idle() const {
    return in_->rdbuf()->in_avail() <= 0;
}

Error at_line(const Input& input, const Error& error) {
    return {fmt::format("line {}: {}", input.line_number(), error.what), error.hint};
}

Result<Bytes> read_hex(std::string_view text) {
    if (auto bytes = from_hex(text)) return std::move(*bytes);
    constexpr std::string_view fine = "0123456789abcdefABCDEF \t\r\n";
    auto bad = text.find_first_not_of(fine);
    if (bad == std::string_view::npos) return fail("an odd number of hex digits", "a byte is two digits");
    return fail(fmt::format("column {}: '{}' is no hex digit", bad + 1, printable(text.substr(bad, 1))),
                "write bytes as 8001 or 80 01");
}

}  // namespace gantry::cli
