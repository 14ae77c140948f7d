#include "link/serial_owner.hpp"

#include <fmt/format.h>
#include <grp.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <array>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string_view>

#include "base/text.hpp"

namespace gantry::link {

namespace fs = std::filesystem;

static bool has_open(const fs::path& process, dev_t device) {
    std::error_code error;
    for (fs::directory_iterator each(process / "fd", error), end; !error && each != end;
         each.increment(error)) {
        struct stat file {};
        if (::stat(each->path().c_str(), &file) == 0 && S_ISCHR(file.st_mode) && file.st_rdev == device)
            return true;
    }
    return false;
}

static int number(std::string_view text) {
    int value = 0;
    auto [rest, wrong] = std::from_chars(text.data(), text.data() + text.size(), value);
    return wrong == std::errc{} && rest == text.data() + text.size() ? value : 0;
}

static std::string describe(int process) {
    if (process == ::getpid()) return fmt::format("this program (process {})", process);
    std::string name;
    std::getline(std::ifstream(fmt::format("/proc/{}/comm", process)), name);
    return fmt::format("{} (process {})", name.empty() ? "another program" : printable(name), process);
}

// The kernel's list tells of all users' programs who has locked which file:
// "5: FLOCK  ADVISORY  WRITE 4711 00:1a:5 0 EOF".
static int locked_by(const struct stat& file) {
    auto place = fmt::format("{:02x}:{:02x}:{}", major(file.st_dev), minor(file.st_dev), file.st_ino);
    std::ifstream locks("/proc/locks");
    for (std::string line; std::getline(locks, line);) {
        std::istringstream words(line);
        std::string index, kind, how, what, process, where;
        words >> index >> kind >> how >> what >> process >> where;
        if (kind == "FLOCK" && where == place) return number(process);
    }
    return 0;
}

std::string user_name() {
    std::array<char, 4096> buffer;
    passwd entry{}, *found = nullptr;
    auto number = ::geteuid();
    ::getpwuid_r(number, &entry, buffer.data(), buffer.size(), &found);
    return found != nullptr ? printable(entry.pw_name) : std::to_string(number);
}

std::string group_name(unsigned number) {
    std::array<char, 4096> buffer;
    group entry{}, *found = nullptr;
    ::getgrgid_r(number, &entry, buffer.data(), buffer.size(), &found);
    return found != nullptr ? printable(entry.gr_name) : std::to_string(number);
}

std::string owner_of(const std::string& path) {
    struct stat file {};
    if (::stat(path.c_str(), &file) != 0 || !S_ISCHR(file.st_mode)) return {};
    if (int process = locked_by(file); process > 0) return describe(process);
    std::error_code error;
    for (fs::directory_iterator each("/proc", error), end; !error && each != end; each.increment(error)) {
        int process = number(each->path().filename().string());
        if (process > 0 && has_open(each->path(), file.st_rdev)) return describe(process);
    }
    return {};
}

}  // namespace gantry::link
