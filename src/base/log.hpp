#pragma once
#include <string>
#include <string_view>

#include <fmt/format.h>

namespace gantry::log {

enum class Level { debug, info, warn, error, off };

// Logs go to stderr: for people when it is a terminal, one JSON object a line when it is not or when asked.
enum class Format { automatic, human, json };
void start(Level level, Format format = Format::automatic);
bool enabled(Level level);
// `message` must already be printable: pass what a peer sent through printable() first.
void write(Level level, std::string_view module, std::string_view message);

// While one lives, lines go into it instead of to stderr: a test reads what was said, a full-screen view
// shows it.
class Capture {
public:
    Capture();
    ~Capture();
    Capture(const Capture&) = delete;
    Capture& operator=(const Capture&) = delete;
    std::string take();  // all lines so far as "level module message\n"
};

template <class... Args>
void debug(std::string_view module, fmt::format_string<Args...> format, Args&&... args) {
    if (enabled(Level::debug)) write(Level::debug, module, fmt::format(format, std::forward<Args>(args)...));
}
template <class... Args>
void info(std::string_view module, fmt::format_string<Args...> format, Args&&... args) {
    if (enabled(Level::info)) write(Level::info, module, fmt::format(format, std::forward<Args>(args)...));
}
template <class... Args>
void warn(std::string_view module, fmt::format_string<Args...> format, Args&&... args) {
    if (enabled(Level::warn)) write(Level::warn, module, fmt::format(format, std::forward<Args>(args)...));
}
template <class... Args>
void error(std::string_view module, fmt::format_string<Args...> format, Args&&... args) {
    if (enabled(Level::error)) write(Level::error, module, fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace gantry::log
