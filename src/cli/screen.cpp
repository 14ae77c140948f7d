#include "cli/screen.hpp"

#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

namespace gantry::cli {

static void put(std::string_view text) {
    std::fwrite(text.data(), 1, text.size(), stdout);
    std::fflush(stdout);
}

bool Screen::possible() {
    const char* terminal = std::getenv("TERM");
    return isatty(STDOUT_FILENO) != 0 && terminal != nullptr && std::string_view(terminal) != "dumb";
}

// Keys one by one while it lives. Ctrl-C stays what it is.
struct Screen::Keyboard {
    termios before{};

    static std::unique_ptr<Keyboard> take() {
        auto keyboard = std::make_unique<Keyboard>();
        // In the background the terminal would stop us for touching it.
        auto foreground = tcgetpgrp(STDIN_FILENO);
        if (foreground > 0 && foreground != getpgrp()) return {};
        if (tcgetattr(STDIN_FILENO, &keyboard->before) != 0) return {};
        auto now = keyboard->before;
        now.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
        if (tcsetattr(STDIN_FILENO, TCSANOW, &now) != 0) return {};
        keyboard->changed = true;
        return keyboard;
    }
    ~Keyboard() {
        if (changed) tcsetattr(STDIN_FILENO, TCSAFLUSH, &before);
    }
    bool changed = false;
};

Screen::Screen() : keyboard_(Keyboard::take()) {
    put("\x1b[?1049h\x1b[?25l");  // the other screen, no cursor
}
Screen::~Screen() {
    put("\x1b[?25h\x1b[?1049l");
}

Screen::Size Screen::size() {
    winsize window{};
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &window) != 0 || window.ws_row == 0 || window.ws_col == 0)
        return {24, 80};
    return {window.ws_row, window.ws_col};
}

std::string fit(std::string_view text, std::size_t columns) {
    auto is_start = [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; };
    auto characters = static_cast<std::size_t>(std::ranges::count_if(text, is_start));
    if (characters <= columns) return std::string(text);
    if (columns == 0) return {};
    std::string out;
    std::size_t taken = 0;
    for (char c : text) {
        if (is_start(c) && ++taken == columns) break;
        out += c;
    }
    return out + "…";
}

void Screen::draw(const std::vector<std::string>& lines, const std::vector<std::size_t>& bold) {
    auto [rows, columns] = size();
    std::string frame = "\x1b[H";
    for (std::size_t i = 0; i < rows; ++i) {
        bool stands_out = std::ranges::find(bold, i) != bold.end();
        if (stands_out) frame += "\x1b[1m";
        if (i < lines.size()) frame += fit(lines[i], columns);
        if (stands_out) frame += "\x1b[0m";
        frame += "\x1b[K";
        if (i + 1 < rows) frame += "\r\n";
    }
    put(frame);
}

}  // namespace gantry::cli
