#pragma once
#include "wire/message.hpp"

namespace gantry::caen {

// The generic face: bytes to named values and back, byte for byte. A message is named by its CommandName;
// its fields are all other pairs in the order of the wire, repeated as often as they come, ResultCode among
// them. Header members: `id`; `framed` true where the length is 0 (then all pairs up to the next header are
// fields); `code` where no row of the table has it; `reserved`, a list of what stands in the reserved bytes
// of each pair, where that is not 0. A pair that no row knows, or whose size is not its row's, is the field
// "Attribute": {"type": "0x1234", "value": "hex"}, which a person may type as 0x1234=hex. Text without its
// NUL is {"unterminated": "text"}. The raw abort byte is the message `Abort`, the ten-byte texts of section 1
// are `UpgradeRequest` and `OutOfBandCommand`.
const wire::Codec& codec();

}  // namespace gantry::caen
