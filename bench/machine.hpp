#pragma once
#include <cstdint>
#include <string>

namespace gantry::bench {

// The machine and the build as one JSON object: figures mean nothing without them.
std::string machine_json();

// What the kernel says of a process: processor time in seconds, memory in bytes.
struct Usage {
    double cpu_s = 0;
    std::uint64_t resident = 0;   // RSS
    std::uint64_t anonymous = 0;  // of it: the process's own data, without the program and its libraries
};
Usage usage_of(int pid);

}  // namespace gantry::bench
