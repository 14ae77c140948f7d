#pragma once
#include <stop_token>
#include <string>

#include "base/error.hpp"

namespace gantry::sinks::jsonl {

// Writes the bytes of `from` to `to` as gzip, on disk when it returns, with the same times. False: it was
// stopped, or `from` is locked because somebody writes to it. `to` may be left unfinished.
Result<bool> gzip_file(const std::string& from, const std::string& to, unsigned mode,
                       const std::stop_token& stop);

}  // namespace gantry::sinks::jsonl
