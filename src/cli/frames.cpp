#include "cli/frames.hpp"

#include "api/message_json.hpp"

namespace gantry::cli {

// Returns how many bytes the line covers; 0 when the frame is not complete yet.
std::size_t Frames::print_one(ByteView rest, bool end, std::string& out) {
    auto decoded = codec_.decode(rest, direction_, end);
    if (decoded.more && !end) return 0;
    auto length = decoded.length;
    if (decoded.message && length > 0 && length <= rest.size()) {
        out += api::message_line({offset_, length, protocol_, direction_}, *decoded.message);
    } else {
        // A decoder that claims nothing would hold us here for ever: then all that is left is the error.
        if (length == 0 || length > rest.size()) length = rest.size();
        auto why = decoded.message ? std::string("incomplete") : decoded.message.error().text();
        out += api::error_line({offset_, length, protocol_, direction_}, why, rest.first(length));
        bad_bytes_ += length;
        ++bad_places_;
    }
    out += '\n';
    return length;
}

void Frames::add(ByteView bytes, bool end, std::string& out) {
    kept_.insert(kept_.end(), bytes.begin(), bytes.end());
    ByteView rest = kept_;
    while (!rest.empty()) {
        auto length = print_one(rest, end, out);
        if (length == 0) break;
        rest = rest.subspan(length);
        offset_ += length;
    }
    kept_.erase(kept_.begin(), kept_.end() - static_cast<std::ptrdiff_t>(rest.size()));
}

}  // namespace gantry::cli
