#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "base/error.hpp"

namespace gantry::epc {

// An EPC by the GS1 Tag Data Standard 2.3. Members that do not exist for a scheme are empty.
struct Epc {
    std::string_view scheme;  // "sgtin-96"
    std::optional<unsigned> filter;
    std::string uri;      // "urn:epc:id:sgtin:0614141.812345.6789"
    std::string tag_uri;  // "urn:epc:tag:sgtin-96:3.0614141.812345.6789"
    std::string gs1;      // "(01)80614141123458(21)6789"
    std::string link;     // "https://id.gs1.org/01/80614141123458/21/6789"
    std::string doubt;    // bytes that decode but look like something else: why, for people; usually empty
};

// Decodes the EPC bank's bytes after the PC word. What is no EPC, or of a scheme we do not know, is an error
// whose text says why; it never fails harder than that.
Result<Epc> decode(ByteView bytes);

// From "urn:epc:tag:…", "urn:epc:id:…" (filter 0 or `filter`), or a GS1 element string "(01)…(21)…" with the
// number of digits of the company prefix.
Result<Bytes> encode(std::string_view text, std::optional<unsigned> filter = {},
                     std::optional<unsigned> prefix_digits = {});

}  // namespace gantry::epc
