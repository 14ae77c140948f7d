#include <unistd.h>

#include <csignal>
#include <iostream>

#include "cli/cli.hpp"

int main(int argc, char** argv) {
    std::ios::sync_with_stdio(false);
    std::cin.tie(nullptr);
    std::signal(SIGPIPE, SIG_IGN);  // a pipe or socket whose other end is gone is an answer, not the end
    gantry::cli::Context context{std::cin, std::cout, std::cerr, {}};
    context.out_fd = STDOUT_FILENO;
    context.in_fd = STDIN_FILENO;
    return gantry::cli::run({argv + (argc > 0 ? 1 : 0), argv + argc}, context);
}
