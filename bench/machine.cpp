#include "bench/machine.hpp"

#include <sys/utsname.h>
#include <unistd.h>

#include <fstream>
#include <sstream>
#include <string_view>
#include <thread>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::bench {

namespace {
// The value of the first line "key : value" of a file under /proc; empty when there is none.
std::string value_of(const std::string& file, std::string_view key) {
    std::ifstream in(file);
    for (std::string line; std::getline(in, line);) {
        if (!line.starts_with(key)) continue;
        auto from = line.find_first_not_of(" \t", line.find(':') + 1);
        return from == std::string::npos ? std::string() : line.substr(from);
    }
    return {};
}

std::uint64_t kib_of(const std::string& file, std::string_view key) {
    std::istringstream in(value_of(file, key));
    std::uint64_t kib = 0;
    in >> kib;
    return kib * 1024;
}

std::string quoted(std::string_view text) {
    std::string out;
    append_json_string(out, text);
    return out;
}
}  // namespace

std::string machine_json() {
    utsname system{};
    ::uname(&system);
#if defined(__clang__)
    constexpr std::string_view compiler = "clang " __clang_version__;
#else
    constexpr std::string_view compiler = "g++ " __VERSION__;
#endif
#if defined(NDEBUG)
    constexpr std::string_view build = "release";
#else
    constexpr std::string_view build = "debug";
#endif
    return fmt::format(
        R"({{"cpu":{},"cores":{},"memory_bytes":{},"kernel":{},"compiler":{},"build":"{}","gantry":"{}"}})",
        quoted(value_of("/proc/cpuinfo", "model name")), std::thread::hardware_concurrency(),
        kib_of("/proc/meminfo", "MemTotal"), quoted(system.release), quoted(compiler), build, GANTRY_VERSION);
}

Usage usage_of(int pid) {
    auto folder = fmt::format("/proc/{}/", pid);
    Usage usage;
    usage.resident = kib_of(folder + "status", "VmRSS");
    usage.anonymous = kib_of(folder + "status", "RssAnon");
    std::ifstream in(folder + "stat");
    std::string stat((std::istreambuf_iterator<char>(in)), {});
    // The second field is a name in brackets that may hold anything; user and system time are fields 14
    // and 15.
    std::istringstream fields(stat.substr(std::min(stat.size(), stat.rfind(')') + 1)));
    std::string skipped;
    for (int i = 3; i < 14; ++i)
        fields >> skipped;
    double user = 0, kernel = 0;
    fields >> user >> kernel;
    usage.cpu_s = (user + kernel) / static_cast<double>(::sysconf(_SC_CLK_TCK));
    return usage;
}

}  // namespace gantry::bench
