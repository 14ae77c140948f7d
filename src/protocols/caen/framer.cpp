#include <algorithm>

#include "protocols/caen/message.hpp"

namespace gantry::caen {

static bool begins(ByteView bytes, std::string_view text) {
    auto size = std::min(bytes.size(), text.size());
    return std::ranges::equal(bytes.first(size), as_bytes(text).first(size));
}

bool out_of_band(ByteView bytes) {
    return begins(bytes, upgrade_text) || begins(bytes, out_of_band_text);
}

void Framer::add(ByteView bytes) {
    // What was taken goes, so that no more is kept than the rest of one message and these bytes.
    buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(taken_));
    taken_ = 0;
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

void Framer::drop(std::size_t used) {
    if (pending() > used) {
        tally_.skipped_bytes += pending() - used;
        ++tally_.resyncs;
    }
    reset();
}

void Framer::reset() {
    buffer_.clear();
    taken_ = 0;
    in_stream_ = lost_ = false;
}

// Could a message or a raw signal start here?
bool Framer::may_start(ByteView bytes) const {
    if (plausible_header(bytes, fixed_)) return true;
    if (either_ && plausible_header(bytes, fixed_ ^ request_bit)) return true;
    return fixed_ == to_reader_head && (bytes[0] == abort_byte || out_of_band(bytes));
}

Framer::Item Framer::take(What what, std::size_t size) {
    auto bytes = ByteView(buffer_).subspan(taken_, size);
    taken_ += size;
    return {what, bytes};
}

// Drops what cannot be the start of anything.
void Framer::skip() {
    auto rest = ByteView(buffer_).subspan(taken_);
    std::size_t size = 1;
    while (size < rest.size() && !may_start(rest.subspan(size)))
        ++size;
    taken_ += size;
    tally_.skipped_bytes += size;
    if (!lost_) ++tally_.resyncs;
    lost_ = true;
}

std::optional<Framer::Item> Framer::next() {
    while (taken_ < buffer_.size()) {
        auto rest = ByteView(buffer_).subspan(taken_);
        bool start = may_start(rest);
        if (in_stream_ && !start) {
            // Pairs one by one, until a header cannot be taken for one (section 8).
            if (rest.size() < avp_header_size) return {};
            std::size_t size = static_cast<std::size_t>(rest[2] << 8 | rest[3]);
            if (size >= avp_header_size && size <= most_stream_pair) {
                if (rest.size() < size) return {};
                return take(What::avp, size);
            }
            in_stream_ = false;
        }
        if (!start) {
            skip();
            continue;
        }
        if (fixed_ == to_reader_head) {
            if (rest[0] == abort_byte) return take(What::abort, 1);
            if (out_of_band(rest)) {
                if (rest.size() < header_size) return {};
                lost_ = false;
                return take(What::out_of_band, header_size);
            }
        }
        auto header = read_header(rest);
        if (!header) return {};
        if (header->undefined_length()) {
            in_stream_ = true;
            lost_ = false;
            return take(What::stream_head, header_size);
        }
        if (rest.size() < header->length) return {};
        in_stream_ = lost_ = false;
        ++tally_.messages;
        return take(What::message, header->length);
    }
    return {};
}

}  // namespace gantry::caen
