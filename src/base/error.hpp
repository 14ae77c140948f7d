#pragma once
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace gantry {

// An error that is meant for the user: what happened and where, and what to do about it.
struct Error {
    std::string what;
    std::string hint = {};  // may be empty

    std::string text() const { return hint.empty() ? what : what + "; " + hint; }
    friend bool operator==(const Error&, const Error&) = default;
};

template <class T>
using Result = tl::expected<T, Error>;

inline tl::unexpected<Error> fail(std::string what, std::string hint = {}) {
    return tl::unexpected<Error>(Error{std::move(what), std::move(hint)});
}

}  // namespace gantry
