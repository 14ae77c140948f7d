#pragma once
#include <chrono>
#include <string>

namespace gantry::bench {

struct DrainOptions {
    std::string program;  // gantry
    std::string kind;     // of the sink, for the figures' names
    std::string section;  // file with its section
    double rate = 10'000;
    std::chrono::milliseconds away{5000};
};

// Readers send at an even rate to a gateway whose sink is away. Once the time is over it prints the line
// "backlog" on stdout: whoever started this starts the server then. Until the sink has caught up the reads go
// on. Prints how fast the backlog went, and how many times the live rate that is. Throws Failure when a read
// is lost on its way into the store.
void measure_drain(const DrainOptions& options);

}  // namespace gantry::bench
