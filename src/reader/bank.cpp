#include "reader/bank.hpp"

#include <array>

namespace gantry {

static constexpr std::array<std::string_view, 4> names = {"reserved", "epc", "tid", "user"};

std::string_view to_text(Bank bank) {
    return names[static_cast<std::size_t>(bank) % names.size()];
}

std::optional<Bank> parse_bank(std::string_view text) {
    for (std::size_t i = 0; i < names.size(); ++i)
        if (text == names[i] || (text.size() == 1 && text[0] == static_cast<char>('0' + i)))
            return static_cast<Bank>(i);
    return {};
}

}  // namespace gantry
