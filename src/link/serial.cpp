#include "link/serial.hpp"

#include <asm/termbits.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/serial.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>

#include <array>
#include <cerrno>
#include <charconv>

#include "base/text.hpp"
#include "link/serial_owner.hpp"
#include "link/socket.hpp"

namespace gantry::link {

namespace {

using Parity = SerialSettings::Parity;
using Flow = SerialSettings::Flow;

constexpr std::uint32_t slowest = 50, fastest = 4'000'000;

struct Speed {
    std::uint32_t baud;
    tcflag_t code;
};
constexpr Speed speeds[] = {
    {50, B50},           {75, B75},           {110, B110},         {134, B134},         {150, B150},
    {200, B200},         {300, B300},         {600, B600},         {1200, B1200},       {1800, B1800},
    {2400, B2400},       {4800, B4800},       {9600, B9600},       {19200, B19200},     {38400, B38400},
    {57600, B57600},     {115200, B115200},   {230400, B230400},   {460800, B460800},   {500000, B500000},
    {576000, B576000},   {921600, B921600},   {1000000, B1000000}, {1152000, B1152000}, {1500000, B1500000},
    {2000000, B2000000}, {2500000, B2500000}, {3000000, B3000000}, {3500000, B3500000}, {4000000, B4000000},
};

tcflag_t speed_code(std::uint32_t baud) {
    for (auto& each : speeds)
        if (each.baud == baud) return each.code;
    return BOTHER;  // the kernel takes the number itself
}

template <class Value>
struct Word {
    std::string_view text;
    Value value;
};
constexpr std::array<Word<Parity>, 3> parities{
    {{"none", Parity::none}, {"odd", Parity::odd}, {"even", Parity::even}}};
constexpr std::array<Word<Flow>, 3> flows{
    {{"none", Flow::none}, {"hardware", Flow::hardware}, {"software", Flow::software}}};
constexpr std::array<std::string_view, 5> option_names{"baud", "data", "parity", "stop", "flow"};

template <class Value>
Result<void> choose(Value& out, std::string_view option, std::string_view given,
                    const std::array<Word<Value>, 3>& words) {
    for (auto& each : words)
        if (each.text == given) {
            out = each.value;
            return {};
        }
    return fail(fmt::format("{}={}: there is no such {}", option, printable(given), option),
                fmt::format("write {}={}, {} or {}", option, words[0].text, words[1].text, words[2].text));
}

template <class Number>
Result<void> number(Number& out, std::string_view option, std::string_view given, std::uint32_t least,
                    std::uint32_t most) {
    std::uint32_t value = 0;
    auto [end, error] = std::from_chars(given.data(), given.data() + given.size(), value);
    if (error != std::errc{} || end != given.data() + given.size() || value < least || value > most)
        return fail(
            fmt::format("{}={}: that is no number from {} to {}", option, printable(given), least, most),
            fmt::format("write one like {}={}", option, option == "baud" ? 115200 : least));
    out = static_cast<Number>(value);
    return {};
}

Result<void> take_option(SerialSettings& settings, std::string_view name, std::string_view value) {
    if (name == "baud") return number(settings.baud, name, value, slowest, fastest);
    if (name == "data") return number(settings.data_bits, name, value, 7, 8);
    if (name == "stop") return number(settings.stop_bits, name, value, 1, 2);
    if (name == "parity") return choose(settings.parity, name, value, parities);
    if (name == "flow") return choose(settings.flow, name, value, flows);
    auto near = nearest(name, option_names);
    return fail(fmt::format("a serial line has no option \"{}\"", printable(name)),
                near.empty() ? fmt::format("its options: {}", fmt::join(option_names, ", "))
                             : fmt::format("did you mean {}=?", near));
}

tl::unexpected<Error> busy(const std::string& path) {
    auto owner = owner_of(path);
    return fail(fmt::format("cannot open {}: it is busy, {} has it", printable(path),
                            owner.empty() ? "another program" : owner),
                owner.empty() ? fmt::format("`sudo fuser -v {}` names it: a second gateway, a terminal "
                                            "program, ModemManager, a login prompt",
                                            printable(path))
                              : "end that program, or give it another line");
}

// Who may use the line is said by its file: as a rule the group dialout.
std::string permission(const std::string& path) {
    auto user = user_name();
    struct stat file {};
    bool known = ::stat(path.c_str(), &file) == 0;
    constexpr mode_t both = S_IRGRP | S_IWGRP;
    if (known && (file.st_gid == 0 || (file.st_mode & both) != both))
        return fmt::format(
            "it is for no group of users: `sudo chgrp dialout {0} && sudo chmod g+rw {0}`, "
            "and add {1} to that group: `sudo usermod -aG dialout {1}`",
            printable(path), user);
    return fmt::format(
        "add {0} to the group {1}: `sudo usermod -aG {1} {0}`, then log in again, or restart the "
        "service",
        user, known ? group_name(file.st_gid) : "dialout");
}

tl::unexpected<Error> refuse(const SerialSettings& settings, int error) {
    auto path = printable(settings.path);
    switch (error) {
        case ENOENT:
        case ENXIO:
        case ENODEV:
        case EIO:  // a port of the board that has no connector
            return fail(fmt::format("cannot open {}: there is no such device", path),
                        "is the adapter plugged in? `ls /dev/serial/by-id /dev/ttyS* /dev/ttyUSB* "
                        "/dev/ttyACM*` shows what is there");
        case EACCES:
        case EPERM:
            return fail(fmt::format("cannot open {}: permission denied", path), permission(settings.path));
        case EBUSY:
        case EWOULDBLOCK:
            return busy(settings.path);
        case ENOTTY:
        case EINVAL:
            return fail(fmt::format("cannot open {}: it is no serial line", path),
                        "name a device file like /dev/ttyUSB0");
        default:
            return fail(fmt::format("cannot open {}: {}", path, describe_errno(error)));
    }
}

}  // namespace

Result<SerialSettings> parse_serial(std::string_view path,
                                    std::span<const std::pair<std::string, std::string>> options,
                                    SerialSettings defaults) {
    defaults.path = path;
    for (auto& [name, value] : options)
        if (auto taken = take_option(defaults, name, value); !taken) return tl::unexpected(taken.error());
    return defaults;
}

std::uint32_t baud_of(std::string_view line) {
    constexpr std::string_view name = "baud=";
    auto baud = SerialSettings{}.baud;
    if (auto at = line.find(name); at != std::string_view::npos)
        std::from_chars(line.data() + at + name.size(), line.data() + line.size(), baud);
    return baud;
}

std::string to_text(const SerialSettings& settings) {
    constexpr std::string_view letters = "NOE";
    auto letter = letters[static_cast<std::size_t>(settings.parity)];
    auto flow = flows[static_cast<std::size_t>(settings.flow)].text;
    return fmt::format("{}, {} {}{}{}{}", settings.path, settings.baud, settings.data_bits, letter,
                       settings.stop_bits,
                       settings.flow == Flow::none ? "" : fmt::format(", {} flow control", flow));
}

void put_mode(const SerialSettings& settings, ::termios2& line) {
    line = {};
    // A break is silence. A byte that came in damaged is dropped: a frame too short is noticed, a wrong byte
    // in a tag's id would not be.
    line.c_iflag = IGNBRK | IGNPAR;
    line.c_cflag = CREAD | CLOCAL | speed_code(settings.baud);
    line.c_cflag |= settings.data_bits == 7 ? CS7 : CS8;
    if (settings.stop_bits == 2) line.c_cflag |= CSTOPB;
    if (settings.parity != Parity::none) {
        line.c_cflag |= PARENB;
        line.c_iflag |= INPCK;
    }
    if (settings.parity == Parity::odd) line.c_cflag |= PARODD;
    if (settings.flow == Flow::hardware) line.c_cflag |= CRTSCTS;
    if (settings.flow == Flow::software) line.c_iflag |= IXON | IXOFF;
    line.c_cc[VSTART] = 0x11;  // XON
    line.c_cc[VSTOP] = 0x13;   // XOFF
    line.c_cc[VMIN] = 1;       // with 0 a read that finds nothing would look like the end of the line
    line.c_cc[VTIME] = 0;
    line.c_ispeed = line.c_ospeed = settings.baud;
}

int set_mode(int fd, const SerialSettings& settings) {
    ::termios2 line{};
    put_mode(settings, line);
    return ::ioctl(fd, TCSETS2, &line) == 0 ? 0 : errno;
}

void lower_latency(int fd, int (*control)(int fd, unsigned long request, void* argument)) {
    constexpr int low = static_cast<int>(ASYNC_LOW_LATENCY);
    serial_struct port{};
    if (control(fd, TIOCGSERIAL, &port) != 0 || (port.flags & low) != 0) return;
    port.flags |= low;
    control(fd, TIOCSSERIAL, &port);
}

void flush_input(int fd) {
    ::ioctl(fd, TCFLSH, TCIFLUSH);
}

bool still_sending(int fd) {
    int waiting = 0;
    return ::ioctl(fd, TIOCOUTQ, &waiting) == 0 && waiting > 0;
}

void leave_line(int fd) {
    end_exclusive(fd);
    // Closing waits until all is sent, for half a minute if the other side holds the line.
    if (still_sending(fd)) ::ioctl(fd, TCFLSH, TCOFLUSH);
}

void end_exclusive(int fd) {
    ::ioctl(fd, TIOCNXCL);
}

Result<Socket> open_serial(const SerialSettings& settings) {
    struct stat file {};
    if (::stat(settings.path.c_str(), &file) != 0) return refuse(settings, errno);
    if (!S_ISCHR(file.st_mode)) return refuse(settings, ENOTTY);
    int fd = ::open(settings.path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) return refuse(settings, errno);
    Socket socket(fd, settings.path, settings.path);
    ::termios2 line{};
    if (::ioctl(fd, TCGETS2, &line) != 0) return refuse(settings, errno);
    // The lock keeps out those that ask for it, root too; the other keeps out all but root.
    if (::flock(fd, LOCK_EX | LOCK_NB) != 0) return refuse(settings, errno);
    if (::ioctl(fd, TIOCEXCL) != 0) return refuse(settings, errno);
    if (int error = set_mode(fd, settings); error != 0) {
        end_exclusive(fd);
        return refuse(settings, error);
    }
    lower_latency(fd, [](int line_fd, unsigned long request, void* argument) {
        return ::ioctl(line_fd, request, argument);
    });
    // A line that cannot do the speed takes the nearest it can. A UART bears some 2 % of difference.
    if (::ioctl(fd, TCGETS2, &line) == 0 && line.c_ospeed != 0 &&
        (line.c_ospeed < settings.baud - settings.baud / 40 ||
         line.c_ospeed > settings.baud + settings.baud / 40)) {
        end_exclusive(fd);
        return fail(fmt::format("cannot open {}: the line cannot do {} baud", printable(settings.path),
                                settings.baud),
                    fmt::format("the nearest it can is {}: set the reader and baud= to a speed both can do",
                                line.c_ospeed));
    }
    ::ioctl(fd, TCFLSH, TCIOFLUSH);
    return socket;
}

}  // namespace gantry::link
