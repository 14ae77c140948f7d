#include "protocols/dagprog/driver_dialog.hpp"

#include <fmt/format.h>

namespace gantry::dagprog {

std::string Reply::words() const {
    switch (what) {
        case What::answered:
            return "it answered";
        case What::refused:
            return "the unit does not know the command, or not in this form: \"??\"";
        case What::silent:
            break;
    }
    return "the unit did not answer";
}

Request UnitState::ask(Code code) const {
    auto& row = query(code);
    Request request{.code = code};
    append_line(request.line, forms.stx, row.word, {}, forms.separator);
    request.tries = 2;
    return request;
}

Request UnitState::set(Code code, std::uint32_t value) const {
    auto& row = setter(code);
    Request request{.code = code};
    append_line(request.line, forms.stx, row.word, std::array{written(row.parts[0], value)}, forms.separator);
    return request;
}

Request UnitState::write(Code code, std::uint32_t block, ByteView data) const {
    auto& row = setter(code);
    Request request{.until = Request::Until::written, .code = code, .patience = write_time};
    append_line(request.line, forms.stx, row.word, std::array{written(row.parts[0], block), to_hex(data)},
                forms.separator);
    return request;
}

std::optional<std::uint32_t> number_in(const Reply& reply) {
    if (!reply.ok() || reply.values.empty()) return {};
    static constexpr PartRow any{.name = "", .kind = Kind::decimal, .size = 5};
    auto number = parse_number(any, reply.values[0]);
    if (!number) return {};
    return static_cast<std::uint32_t>(*number);
}

std::optional<std::string> OncePerMinute::pass(std::string text, Steady now) {
    std::erase_if(told_, [&](auto& each) { return each.second.held == 0 && now - each.second.at >= 1min; });
    auto told = told_.find(text);
    if (told == told_.end()) {
        if (told_.size() >= most_texts) return {};
        told_.emplace(text, Told{now});
        return text;
    }
    if (now - told->second.at < 1min) {
        ++told->second.held;
        return {};
    }
    auto held = std::exchange(told->second.held, 0);
    told->second.at = now;
    if (held > 0) text += fmt::format(" (and {} times before)", held);
    return text;
}

}  // namespace gantry::dagprog
