#include "stream_fuzz.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    gantry::caen::fuzz::check_stream(data, size, gantry::wire::Direction::to_reader);
    gantry::caen::fuzz::check_device(data, size);
    return 0;
}
