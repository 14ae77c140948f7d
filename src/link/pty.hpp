#pragma once
#include <functional>
#include <memory>
#include <string>

#include "link/link.hpp"

namespace gantry::link {

// A pseudo-terminal that stands for the serial line of a virtual reader: a program opens its link as it would
// open /dev/ttyUSB0. Bytes pass both ways no faster than the baud rate says, ten bits a byte. What is sent
// while nobody has the line open is lost, as on a real one. Lives on the loop; the destructor too runs there,
// or when the loop has ended.
class Pty {
public:
    // `link` becomes a symbolic link to the terminal until this is destroyed. What is there already is
    // replaced if it is a symbolic link that does not lead to a terminal in use, else it is refused.
    // `used` is called on the loop after a program has opened or closed the line; it may destroy this.
    static Result<std::unique_ptr<Pty>> open(Loop& loop, const std::string& link, std::uint32_t baud,
                                             std::function<void()> used = {});
    virtual ~Pty() = default;
    // The reader's end of the line, for a Link. The end given before takes no more part.
    virtual Result<Socket> connect() = 0;
    virtual bool opened() = 0;  // does a program have the line open?
};

}  // namespace gantry::link
