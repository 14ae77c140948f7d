#include "cli/scenario.hpp"

#include <ostream>

#include "base/text.hpp"
#include "cli/input.hpp"

namespace gantry::cli {

Result<field::Scenario> load_scenario(Context& context, const std::string& file) {
    auto input = Input::open(context, file);
    if (!input) return tl::unexpected(input.error());
    std::string text;
    constexpr std::size_t most = 5 << 20;  // the parser says that it is too much before that
    for (bool end = false; !end && text.size() <= most;) {
        auto piece = input->next_piece();
        if (!piece) return tl::unexpected(piece.error());
        text += as_text(*piece);
        end = piece->empty();
    }
    auto names = make_names();
    std::vector<std::string_view> makes(names.begin(), names.end());
    return field::parse_scenario(text, file == "-" ? "stdin" : printable(file), makes);
}

int refuse_scenario(Context& context, const Error& error) {
    context.err << error.text() << '\n';
    return failed;
}

}  // namespace gantry::cli
