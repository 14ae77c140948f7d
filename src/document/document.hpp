#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <tl/expected.hpp>

// A TOML text as a plain tree with the place of everything in it. The TOML library stays in one .cpp file.
namespace gantry::document {

struct Place {
    std::uint32_t line = 1, column = 1;  // from 1; columns count characters
    friend auto operator<=>(const Place&, const Place&) = default;
};

struct Entry;
struct Node {
    struct Date {};  // dates and times: nothing in our files is one
    using List = std::vector<Node>;
    using Table = std::vector<Entry>;

    Place at;
    std::variant<Table, List, std::string, std::int64_t, double, bool, Date> of;

    template <class T>
    const T* get() const {
        return std::get_if<T>(&of);
    }
    std::string_view kind() const;  // "text", "a number", ... for a person
};
struct Entry {
    std::string key;
    Place at;
    Node value;
};

struct SyntaxFault {
    Place at;
    std::string what;
};
// The root is a table. Any text is safe to give, of any size.
tl::expected<Node, SyntaxFault> parse_document(std::string_view text);

}  // namespace gantry::document
