#include "stream_fuzz.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    gantry::silion::fuzz::check_stream(data, size, gantry::wire::Direction::to_host);
    gantry::silion::fuzz::check_driver(data, size);
    return 0;
}
