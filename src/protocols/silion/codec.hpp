#pragma once
#include "wire/message.hpp"

namespace gantry::silion {

// The generic face: bytes to named values and back, byte for byte. Header members: `reader`, `status` (to the
// host), `flags`, `crc` (as on the wire, where flag bit 1 is set; left out, it is computed), `code` (where no
// row of the table has it), `bank_length_bytes` (2: the tag variant of section 5), `status_text` (for people;
// not read back). Bytes after the last field of a message are its field `Trailing`.
const wire::Codec& codec();

}  // namespace gantry::silion
