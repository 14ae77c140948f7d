#include "stream_fuzz.hpp"

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned) {
    size = LLVMFuzzerMutate(data, size, max_size);
    return gantry::silion::fuzz::repaired(data, size, gantry::wire::Direction::to_host);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    gantry::silion::fuzz::check_stream(data, size, gantry::wire::Direction::to_host);
    gantry::silion::fuzz::check_driver(data, size);
    return 0;
}
