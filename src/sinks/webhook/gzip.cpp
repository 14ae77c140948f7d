#include "sinks/webhook/gzip.hpp"

#include <zlib.h>

#include <new>

namespace gantry::sinks::webhook {

std::string gzipped(std::string_view text) {
    constexpr int gzip = 16, window = 15, memory = 8,
                  level = 3;  // events are alike: more costs time for little
    z_stream stream{};
    if (::deflateInit2(&stream, level, Z_DEFLATED, gzip + window, memory, Z_DEFAULT_STRATEGY) != Z_OK)
        throw std::bad_alloc();
    std::string out(::deflateBound(&stream, text.size()), '\0');
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
    stream.avail_in = static_cast<uInt>(text.size());
    stream.next_out = reinterpret_cast<Bytef*>(out.data());
    stream.avail_out = static_cast<uInt>(out.size());
    ::deflate(&stream, Z_FINISH);  // in one go: there is room for the worst
    out.resize(stream.total_out);
    ::deflateEnd(&stream);
    return out;
}

}  // namespace gantry::sinks::webhook
