#pragma once
#include <iosfwd>
#include <memory>
#include <string>

#include "base/bytes.hpp"
#include "base/error.hpp"
#include "cli/cli.hpp"

namespace gantry::cli {

// A file, or the standard input for "-": read by lines or in pieces, with bounded memory, and without waiting
// for more than is there, so that it also serves a live pipe.
class Input {
public:
    static Result<Input> open(Context& context, const std::string& file);

    // The next line without its ending; nothing at the end. Lines over 64 MiB are an error.
    Result<bool> next_line(std::string& line);
    std::size_t line_number() const { return line_number_; }  // of the line last read
    // What has arrived, at least one byte, at most 64 KiB; empty at the end.
    Result<Bytes> next_piece();
    // True when reading on would wait: a good moment to flush what was written.
    bool idle() const;

    static constexpr std::size_t max_line = 64 << 20;

private:
    std::shared_ptr<std::istream> owned_;
    std::istream* in_ = nullptr;
    std::string name_;
    std::size_t line_number_ = 0;
};

// "line 3: what", for an error that is about one line.
Error at_line(const Input& input, const Error& error);
// Hex as people write it, blanks allowed; the error says which character is none.
Result<Bytes> read_hex(std::string_view text);

}  // namespace gantry::cli
