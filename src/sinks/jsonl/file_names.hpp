#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"

// What the files of a sink are called: <stem>-<number>.jsonl, with .gz behind it once compressed. The number
// has eight digits or more, and a later file has a higher one whatever the clock does. Nothing of an event is
// ever part of a name.
namespace gantry::sinks::jsonl {

// The name of the sink's section; what is no letter, digit, '-', '_' or inner '.' comes out as %XX, so two
// names never share a stem.
std::string stem_of(std::string_view sink_name);

enum class Form : std::uint8_t { plain, gzipped, unfinished };  // unfinished: being compressed
std::string file_name(std::string_view stem, std::uint64_t number, Form form);

struct Found {
    std::uint64_t number = 0;
    Form form = Form::plain;
    friend auto operator<=>(const Found&, const Found&) = default;
};
// The files of this stem, rising by number; all else in the directory is not ours.
Result<std::vector<Found>> find_files(const std::string& dir, std::string_view stem);

// "/data/x: No space left on device", for the last call that failed. A hint where there is one.
Error system_error(std::string_view did, const std::string& path, int number);

}  // namespace gantry::sinks::jsonl
