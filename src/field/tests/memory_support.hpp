#pragma once
#include <gtest/gtest.h>

#include <optional>

#include "field/field.hpp"
#include "field/memory.hpp"
#include "testkit/vectors.hpp"

namespace gantry::field {

using testkit::hex;

inline TagSpec spec(std::string_view epc, std::uint32_t access_password = 0,
                    std::uint32_t kill_password = 0) {
    TagSpec spec;
    spec.id = event::TagId(hex(epc));
    spec.access_password = access_password;
    spec.kill_password = kill_password;
    return spec;
}
inline TagSpec spec_of(event::Technology technology, std::string_view id) {
    auto made = spec(id);
    made.technology = technology;
    return made;
}

inline Bytes read(const TagMemory& tag, Bank bank, std::uint32_t word, std::uint32_t words,
                  std::uint32_t password = 0) {
    auto bytes = tag.read(bank, word, words, password);
    EXPECT_TRUE(bytes.has_value());
    return bytes.value_or(Bytes{});
}

// None: it went well.
template <class T>
std::optional<AirError> error(const AirResult<T>& result) {
    return result ? std::optional<AirError>{} : result.error();
}

}  // namespace gantry::field
