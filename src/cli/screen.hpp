#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace gantry::cli {

// A full-screen view in a terminal: lines in, one frame out, cut to the terminal's size. Leaves the terminal
// as it was when it is destroyed.
class Screen {
public:
    Screen();
    ~Screen();
    Screen(const Screen&) = delete;
    Screen& operator=(const Screen&) = delete;

    static bool possible();  // is stdout a terminal that can do it?
    // Do single keys come on stdin, without Enter and without being shown? Not where stdin is something else,
    // or where the terminal belongs to another job.
    bool takes_keys() const { return keyboard_ != nullptr; }
    struct Size {
        std::size_t rows, columns;
    };
    static Size size();
    // Draws what fits. Lines hold plain UTF-8; `bold` is the indexes of lines to stand out.
    void draw(const std::vector<std::string>& lines, const std::vector<std::size_t>& bold);

private:
    struct Keyboard;
    std::unique_ptr<Keyboard> keyboard_;
};

// Cuts UTF-8 text to so many characters; an ellipsis shows that something is missing.
std::string fit(std::string_view text, std::size_t columns);

}  // namespace gantry::cli
