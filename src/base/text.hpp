#pragma once
#include <span>
#include <string>
#include <string_view>

namespace gantry {

// Text from a peer is hostile. This makes it safe to show in a terminal, a log, a topic or a page as text:
// valid UTF-8 passes, but control characters, invalid bytes, and characters that reorder or hide text come
// out as \xNN or \u{NNNN}, and a backslash as \\. What comes out is always valid, printable UTF-8.
std::string printable(std::string_view raw);

// Without the blanks, tabs and line ends around it.
std::string_view trimmed(std::string_view text);

bool is_printable_ascii(std::string_view text);
bool is_utf8(std::string_view text);

// Appends `text` as a JSON string with its quotes. Bytes that are not valid UTF-8 become U+FFFD.
void append_json_string(std::string& out, std::string_view text);

// Are they the same, ASCII letters of either case counting as one?
bool alike(std::string_view a, std::string_view b);

// True when `name` matches `pattern`; `*` stands for any run of characters, everything else for itself.
bool matches(std::string_view pattern, std::string_view name);

// The candidate nearest to `word` by edit distance, or empty when none is near enough to be a slip.
std::string_view nearest(std::string_view word, std::span<const std::string_view> candidates);

}  // namespace gantry
