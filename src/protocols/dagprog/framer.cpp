#include "protocols/dagprog/framer.hpp"

#include <algorithm>

namespace gantry::dagprog {

void Framer::give(ByteView bytes) {
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

void Framer::skip(std::size_t bytes) {
    at_ += bytes;
    tally_.skipped += bytes;
}

void Framer::took(std::size_t bytes, std::size_t lines) {
    at_ += bytes;
    tally_.line_bytes += bytes;
    tally_.lines += lines;
}

std::optional<Line> Framer::next() {
    for (;;) {
        ByteView rest = ByteView(buffer_).subspan(at_);
        if (astray_) {  // the rest of a line that was too long must not be taken for one of its own
            auto end =
                std::ranges::find_if(rest, [](auto byte) { return byte == byte_stx || byte == byte_cr; });
            auto size = static_cast<std::size_t>(end - rest.begin());
            if (end == rest.end()) {
                skip(size);
                return {};
            }
            skip(*end == byte_cr ? size + 1 : size);
            astray_ = false;
            continue;
        }
        auto look = look_at(rest, direction_);
        switch (look.what) {
            case Look::What::more:
                return {};
            case Look::What::line_feed:
                took(1, 0);
                break;
            case Look::What::wrong:
                ++tally_.resyncs;
                if (look.why == wire::Errc::too_big) ++tally_.too_long;
                skip(look.size);
                astray_ = look.ends_in_line;
                break;
            case Look::What::line: {
                line_at_ = at_;
                took(look.size, 1);
                auto line = parse_line(look.body, direction_);
                line.has_stx = look.has_stx;
                return line;
            }
        }
    }
}

void Framer::settle() {
    if (at_ == 0) return;
    buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(at_));
    at_ = line_at_ = 0;
}

}  // namespace gantry::dagprog
