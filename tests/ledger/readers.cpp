// gantry_ledger_readers: virtual readers of all makes in which every read carries the reader's number and its
// own, and which keep the books of it. The proofs of delivery (tools/prove) run it beside the gateway; it
// survives the gateway and comes back to it. See --help.
#include <poll.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>
#include <sstream>
#include <thread>

#include <CLI/CLI.hpp>

#include "fleet.hpp"
#include "link/link.hpp"

namespace gantry::ledger {
namespace {

constexpr int look_every = 100;  // ms: a file of figures is that old at most

// Lines from stdin and SIGTERM as they come, or nothing within `look_every`.
class Orders {
public:
    Orders() {
        sigset_t set;
        sigemptyset(&set);
        sigaddset(&set, SIGTERM);
        sigaddset(&set, SIGINT);
        pthread_sigmask(SIG_BLOCK, &set, nullptr);
        signals_ = ::signalfd(-1, &set, SFD_CLOEXEC);
    }
    std::optional<std::string> next() {
        if (auto line = take_line()) return line;
        std::array<pollfd, 2> ready{{{signals_, POLLIN, 0}, {open_ ? STDIN_FILENO : -1, POLLIN, 0}}};
        if (::poll(ready.data(), ready.size(), look_every) <= 0) return {};
        if (ready[0].revents != 0) {
            signalfd_siginfo signal{};
            return ::read(signals_, &signal, sizeof signal) > 0 ? std::optional<std::string>("end")
                                                                : std::nullopt;
        }
        std::array<char, 4096> bytes{};
        auto got = ::read(STDIN_FILENO, bytes.data(), bytes.size());
        if (got <= 0)
            open_ = false;  // whoever commands it may go; a signal ends it
        else
            text_.append(bytes.data(), static_cast<std::size_t>(got));
        return take_line();
    }

private:
    std::optional<std::string> take_line() {
        auto at = text_.find('\n');
        if (at == std::string::npos) return {};
        auto line = text_.substr(0, at);
        text_.erase(0, at + 1);
        return line;
    }
    int signals_ = -1;
    bool open_ = true;
    std::string text_;
};

struct Options {
    FleetOptions fleet;
    std::string ledger;
    double drain_within = 60;
};

void say(std::string_view word, Fleet& fleet) {
    std::cout << word << ' ' << to_json(fleet.figures()) << std::endl;
}

// Under its name it is always whole.
void keep(const std::string& path, Fleet& fleet) {
    if (path.empty()) return;
    {
        std::ofstream file(path + ".new");
        file << to_json(fleet.figures()) << '\n';
    }
    std::filesystem::rename(path + ".new", path);
}

bool drain(Fleet& fleet, double seconds) {
    fleet.stop();
    auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (!fleet.drained()) {
        if (std::chrono::steady_clock::now() > end) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return true;
}

int run(const Options& options) {
    Orders orders;  // before any thread, so that all leave the signals to it
    link::raise_file_limit();
    auto fleet = Fleet::make(options.fleet);
    if (!fleet) {
        std::cerr << "gantry_ledger_readers: " << fleet.error().text() << '\n';
        return 1;
    }
    say("ready", **fleet);
    bool all = true;
    for (;;) {
        keep(options.ledger, **fleet);
        auto order = orders.next();
        if (!order) continue;
        std::istringstream words(*order);
        std::string word;
        double rate = 0;
        words >> word;
        if (word == "figures") {
            say("figures", **fleet);
        } else if (word == "rate" && words >> rate && rate > 0) {
            (*fleet)->set_rate(rate);
            std::cout << "done" << std::endl;
        } else if (word == "begin") {
            (*fleet)->begin();
            std::cout << "done" << std::endl;
        } else if (word == "stop" || word == "end") {
            all = drain(**fleet, options.drain_within);
            keep(options.ledger, **fleet);
            say(all ? "final" : "undrained", **fleet);
            if (word == "end") return all ? 0 : 1;
        } else {
            std::cout << "what is \"" << *order << "\"? There are: begin, figures, rate NUMBER, stop, end"
                      << std::endl;
        }
    }
}

}  // namespace
}  // namespace gantry::ledger

int main(int argc, char** argv) {
    gantry::ledger::Options options;
    auto& fleet = options.fleet;
    CLI::App app(
        "Virtual readers whose every read is numbered.\n\n"
        "Prints `ready` and one line of JSON with where each reader is. Then, on stdin: `figures` prints "
        "what each\n"
        "knows; `rate NUMBER` changes the reads a second; `stop` ends the reading, waits until all that "
        "waits for an\n"
        "acknowledgement has it, and prints `final` (`undrained` when it took too long); `end`, or SIGTERM, "
        "does\n"
        "that and ends.");
    app.add_option("--silion", fleet.silion, "Silion readers that ask for acknowledgement");
    app.add_option("--silion-plain", fleet.silion_plain, "Silion readers that do not");
    app.add_option("--harting", fleet.harting, "HARTING readers, each at a port of its own");
    app.add_option("--caen", fleet.caen, "CAEN readers, each at a port of its own");
    app.add_option("--dagprog", fleet.dagprog, "DAGProg units, each at a pseudo-terminal");
    app.add_option("--connect", fleet.connect, "HOST:PORT that Silion readers dial");
    app.add_option("--pty-dir", fleet.pty_dir, "directory for the pseudo-terminals");
    app.add_option("--rate", fleet.rate, "reads a second of each reader")->check(CLI::Range(0.1, 100'000.0));
    app.add_option("--dagprog-rate", fleet.dagprog_rate, "reads a second of each DAGProg unit")
        ->check(CLI::Range(0.1, 2.0));
    app.add_option("--count", fleet.count, "reads of each reader; 0: until it is told to stop");
    app.add_option("--ledger", options.ledger, "file that always holds the newest figures");
    app.add_option("--drain-within", options.drain_within, "seconds that `stop` waits");
    CLI11_PARSE(app, argc, argv);
    if ((fleet.silion + fleet.silion_plain) != 0 && fleet.connect.empty()) {
        std::cerr << "gantry_ledger_readers: Silion readers dial; say where with --connect HOST:PORT\n";
        return 2;
    }
    if (fleet.dagprog != 0 && fleet.pty_dir.empty()) {
        std::cerr << "gantry_ledger_readers: DAGProg units need --pty-dir\n";
        return 2;
    }
    return gantry::ledger::run(options);
}
