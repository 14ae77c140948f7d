#pragma once
#include <span>
#include <utility>

#include "link/link.hpp"

struct termios2;  // the kernel's, from asm/termbits.h, which no file can include beside termios.h

namespace gantry::link {

// A serial line as a user describes it.
struct SerialSettings {
    enum class Parity : std::uint8_t { none, odd, even };
    enum class Flow : std::uint8_t {
        none,
        hardware,
        software
    };  // software takes 11h and 13h out of the data
    std::string path;
    std::uint32_t baud = 115200;
    std::uint8_t data_bits = 8;  // 7 or 8
    Parity parity = Parity::none;
    std::uint8_t stop_bits = 1;  // 1 or 2
    Flow flow = Flow::none;
    friend bool operator==(const SerialSettings&, const SerialSettings&) = default;
};

// The options of an address: "baud=115200", "data=8", "parity=even", "stop=1", "flow=none". What is not named
// comes from `defaults`, which are those of the make.
Result<SerialSettings> parse_serial(std::string_view path,
                                    std::span<const std::pair<std::string, std::string>> options,
                                    SerialSettings defaults = {});
// The speed that "baud=38400&parity=even" names, the usual one where it names none.
std::uint32_t baud_of(std::string_view line);
std::string to_text(const SerialSettings& settings);  // "/dev/ttyS0, 115200 8N1"

// Opens the line for us alone, raw, with what came in before thrown away. Does not block.
Result<Socket> open_serial(const SerialSettings& settings);

// What open_serial() asks of the kernel: nothing but the settings, every other bit of the line is decided.
void put_mode(const SerialSettings& settings, ::termios2& line);

// A USB adapter holds what comes in back, 16 ms by default, to fill its packets. Asks its driver not to;
// those that cannot, and ports of the board, refuse it, and nothing is lost. `control` is ioctl(), but for
// tests.
void lower_latency(int fd, int (*control)(int fd, unsigned long request, void* argument));

// For this module: on an open line. The first returns errno, or 0.
int set_mode(int fd, const SerialSettings& settings);
void flush_input(int fd);
bool still_sending(int fd);
void leave_line(int fd);  // before it is closed: nobody is kept out, and closing does not wait
void end_exclusive(int fd);

}  // namespace gantry::link
