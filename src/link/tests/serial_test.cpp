// Serial lines: their settings, and opening them.
#include "link/serial.hpp"

#include <asm/termbits.h>
#include <linux/serial.h>
#include <sys/stat.h>

#include "line.hpp"
#include "link/serial_owner.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::link {
namespace {

using Options = std::vector<std::pair<std::string, std::string>>;
using Parity = SerialSettings::Parity;
using Flow = SerialSettings::Flow;

std::string refusal(const Options& options) {
    auto parsed = parse_serial("/dev/ttyS0", options);
    return parsed ? "accepted" : parsed.error().text();
}

TEST(Serial, OptionsOfAnAddressAreRead) {
    auto plain = parse_serial("/dev/ttyS0", {});
    ASSERT_TRUE(plain);
    EXPECT_EQ(to_text(*plain), "/dev/ttyS0, 115200 8N1");
    auto all = parse_serial(
        "/dev/ttyUSB1",
        Options{{"baud", "921600"}, {"data", "7"}, {"parity", "even"}, {"stop", "2"}, {"flow", "hardware"}});
    ASSERT_TRUE(all);
    EXPECT_EQ(*all, (SerialSettings{"/dev/ttyUSB1", 921600, 7, Parity::even, 2, Flow::hardware}));
    EXPECT_EQ(to_text(*all), "/dev/ttyUSB1, 921600 7E2, hardware flow control");
}

TEST(Serial, WhatIsNotNamedComesFromTheMake) {
    SerialSettings defaults;
    defaults.baud = 38400;
    defaults.parity = Parity::odd;
    auto parsed = parse_serial("/dev/ttyS0", Options{{"stop", "2"}}, defaults);
    ASSERT_TRUE(parsed);
    EXPECT_EQ(to_text(*parsed), "/dev/ttyS0, 38400 8O2");
}

TEST(Serial, WrongOptionsAreRefusedWithAHint) {
    EXPECT_EQ(refusal({{"boud", "9600"}}), "a serial line has no option \"boud\"; did you mean baud=?");
    EXPECT_NE(refusal({{"x", ""}}).find("its options: baud, data, parity, stop, flow"), std::string::npos);
    EXPECT_EQ(refusal({{"parity", "mark"}}),
              "parity=mark: there is no such parity; write parity=none, odd or even");
    EXPECT_EQ(refusal({{"flow", "rts"}}),
              "flow=rts: there is no such flow; write flow=none, hardware or software");
    for (auto* wrong : {"", "0", "49", "4000001", "9600x", "-1", "99999999999"})
        EXPECT_NE(refusal({{"baud", wrong}}).find("no number from 50 to 4000000"), std::string::npos)
            << wrong;
    for (auto* wrong : {"6", "9", "8bits"})
        EXPECT_NE(refusal({{"data", wrong}}).find("no number from 7 to 8"), std::string::npos) << wrong;
    for (auto* wrong : {"0", "3", "1.5"})
        EXPECT_NE(refusal({{"stop", wrong}}).find("no number from 1 to 2"), std::string::npos) << wrong;
}

// Everything the protocol manual names under BaudRate, DataBits, StopBits, Parity, FlowCtrl.
TEST(Serial, EverySettingBecomesItsBits) {
    constexpr std::pair<std::uint32_t, tcflag_t> rates[] = {
        {9600, B9600},     {19200, B19200},   {38400, B38400},   {57600, B57600},
        {115200, B115200}, {230400, B230400}, {460800, B460800}, {921600, B921600}};
    for (auto [baud, code] : rates)
        for (auto data : {std::uint8_t{7}, std::uint8_t{8}})
            for (auto stop : {std::uint8_t{1}, std::uint8_t{2}})
                for (auto parity : {Parity::none, Parity::odd, Parity::even})
                    for (auto flow : {Flow::none, Flow::hardware, Flow::software}) {
                        SerialSettings settings{"", baud, data, parity, stop, flow};
                        SCOPED_TRACE(to_text(settings));
                        ::termios2 line{};
                        put_mode(settings, line);
                        EXPECT_EQ(line.c_cflag & CBAUD, code);
                        EXPECT_EQ(line.c_cflag & CSIZE, data == 7 ? CS7 : CS8);
                        EXPECT_EQ((line.c_cflag & CSTOPB) != 0, stop == 2);
                        EXPECT_EQ((line.c_cflag & PARENB) != 0, parity != Parity::none);
                        EXPECT_EQ((line.c_iflag & INPCK) != 0, parity != Parity::none);
                        EXPECT_EQ((line.c_cflag & PARODD) != 0, parity == Parity::odd);
                        EXPECT_EQ((line.c_cflag & CRTSCTS) != 0, flow == Flow::hardware);
                        EXPECT_EQ((line.c_iflag & (IXON | IXOFF)) == (IXON | IXOFF), flow == Flow::software);
                        EXPECT_EQ((line.c_iflag & (IXON | IXOFF)) == 0, flow != Flow::software);
                    }
}

TEST(Serial, ALineIsRawAndItsReadsDoNotWait) {
    ::termios2 line{};
    line.c_lflag = ECHO | ICANON | ISIG;
    line.c_oflag = OPOST | ONLCR;
    line.c_iflag = ICRNL | ISTRIP | IXANY;
    put_mode({}, line);
    EXPECT_EQ(line.c_lflag, 0u);
    EXPECT_EQ(line.c_oflag, 0u);
    EXPECT_EQ(line.c_iflag, tcflag_t{IGNBRK | IGNPAR});
    EXPECT_EQ(line.c_cflag & (CREAD | CLOCAL), tcflag_t{CREAD | CLOCAL});
    EXPECT_EQ(line.c_cc[VMIN], 1);
    EXPECT_EQ(line.c_cc[VTIME], 0);
}

TEST(Serial, ASpeedWithoutAConstantIsGivenAsANumber) {
    for (std::uint32_t baud : {14400U, 28800U, 250000U, 1843200U}) {
        SerialSettings settings;
        settings.baud = baud;
        ::termios2 line{};
        put_mode(settings, line);
        EXPECT_EQ(line.c_cflag & CBAUD, tcflag_t{BOTHER});
        EXPECT_EQ(line.c_ospeed, baud);
        EXPECT_EQ(line.c_ispeed, baud);
    }
}

TEST(Serial, OpeningALineSetsItAndKeepsOthersOut) {
    Cable cable;
    cable.line.baud = 250000;
    auto socket = open_serial(cable.line);
    ASSERT_TRUE(socket) << socket.error().text();
    EXPECT_EQ(socket->peer(), cable.line.path);
    EXPECT_EQ(socket->local_host(), "");
    Program line(socket->release());
    EXPECT_NE(::fcntl(line.fd(), F_GETFL) & O_NONBLOCK, 0);
    EXPECT_NE(::fcntl(line.fd(), F_GETFD) & FD_CLOEXEC, 0);
    EXPECT_TRUE(is_exclusive(line.fd()));
    ::termios2 set{};
    ASSERT_EQ(::ioctl(line.fd(), TCGETS2, &set), 0);
    EXPECT_EQ(set.c_lflag, 0u);
    EXPECT_EQ(set.c_ospeed, 250000u);
    ASSERT_TRUE(line.send(std::string("a\n\x03\x04\0\r\xFF", 7)));
    EXPECT_EQ(cable.master.receive(7), std::string("a\n\x03\x04\0\r\xFF", 7));
}

// The kernel's own idea of an open line. A pseudo-terminal keeps no parity.
TEST(Serial, TheKernelIsToldOfEverySpeed) {
    for (auto [baud, code] : {std::pair(9600U, tcflag_t{B9600}), std::pair(38400U, tcflag_t{B38400}),
                              std::pair(115200U, tcflag_t{B115200}), std::pair(921600U, tcflag_t{B921600}),
                              std::pair(14400U, tcflag_t{BOTHER}), std::pair(1843200U, tcflag_t{BOTHER})}) {
        Cable cable;
        cable.line.baud = baud;
        auto socket = open_serial(cable.line);
        ASSERT_TRUE(socket) << socket.error().text();
        Program line(socket->release());
        ::termios2 set{};
        ASSERT_EQ(::ioctl(line.fd(), TCGETS2, &set), 0);
        EXPECT_EQ(set.c_cflag & CBAUD, code) << baud;
        EXPECT_EQ(set.c_ospeed, baud);
        EXPECT_EQ(set.c_ispeed, baud);
    }
}

TEST(Serial, EveryByteGoesThroughTheLineDisciplineAsItIs) {
    Cable cable;  // it begins as a terminal for people: echo, lines, signals
    auto socket = open_serial(cable.line);
    ASSERT_TRUE(socket) << socket.error().text();
    Program line(socket->release());
    std::string all;
    for (int byte = 0; byte < 256; ++byte)
        all += static_cast<char>(byte);
    ASSERT_TRUE(line.send(all));
    EXPECT_EQ(cable.master.receive(all.size()), all);
    ASSERT_TRUE(cable.master.send(all));
    EXPECT_EQ(line.receive(all.size()), all);
    for (char byte : all) {
        ASSERT_TRUE(cable.master.send({&byte, 1}));
        EXPECT_EQ(line.receive(1), std::string(1, byte));
    }
    int echoed = 0;
    ASSERT_EQ(::ioctl(cable.master.fd(), FIONREAD, &echoed), 0);
    EXPECT_EQ(echoed, 0);
}

TEST(Serial, ALineIsOpenedThroughALinkAndItsOwnerFoundThroughAnother) {
    Cable cable;
    testkit::TempDir dir;
    auto by_id = dir.path() + "/by-id", by_path = dir.path() + "/by-path";
    ASSERT_EQ(::symlink(cable.line.path.c_str(), by_path.c_str()), 0);
    ASSERT_EQ(::symlink("by-path", by_id.c_str()), 0);
    auto line = cable.line;
    line.path = by_id;
    auto socket = open_serial(line);
    ASSERT_TRUE(socket) << socket.error().text();
    EXPECT_EQ(socket->peer(), by_id);
    line.path = by_path;
    auto second = open_serial(line);
    ASSERT_FALSE(second);
    EXPECT_NE(second.error().what.find(by_path + ": it is busy, this program"), std::string::npos);
    // It was plugged in again and has another number.
    Cable other;
    ASSERT_EQ(::unlink(by_path.c_str()), 0);
    line.path = by_id;
    auto gone = open_serial(line);
    ASSERT_FALSE(gone);
    EXPECT_NE(gone.error().what.find("there is no such device"), std::string::npos);
    ASSERT_EQ(::symlink(other.line.path.c_str(), by_path.c_str()), 0);
    auto again = open_serial(line);
    ASSERT_TRUE(again) << again.error().text();
    Program there(again->release());
    ASSERT_TRUE(other.master.send("the other"));
    EXPECT_EQ(there.receive(9), "the other");
}

TEST(Serial, WhatCameInBeforeIsThrownAway) {
    Cable cable;
    Program before(cable.line.path);
    ASSERT_EQ(set_mode(before.fd(), cable.line), 0);
    ASSERT_TRUE(cable.master.send("stale"));
    int waiting = 0;
    ASSERT_TRUE(eventually([&] { return ::ioctl(before.fd(), FIONREAD, &waiting) == 0 && waiting == 5; }));
    auto socket = open_serial(cable.line);
    ASSERT_TRUE(socket) << socket.error().text();
    ASSERT_TRUE(cable.master.send("fresh"));
    EXPECT_EQ(before.receive(5), "fresh");
}

TEST(Serial, ALineHasOneOwnerAtATime) {
    Cable cable;
    auto first = open_serial(cable.line);
    ASSERT_TRUE(first);
    auto second = open_serial(cable.line);
    ASSERT_FALSE(second);
    EXPECT_NE(second.error().what.find("it is busy, this program (process " + std::to_string(::getpid())),
              std::string::npos)
        << second.error().what;
    *first = Socket();
    EXPECT_TRUE(open_serial(cable.line));
}

TEST(Serial, TheOwnerOfALineIsNamedWhetherItLocksOrNot) {
    Cable cable;
    auto file = cable.line.path;
    EXPECT_EQ(owner_of(file), "");
    Program plain(file);
    auto self = " (process " + std::to_string(::getpid()) + ")";
    EXPECT_EQ(owner_of(file), "this program" + self);
    plain.close();
    auto socket = open_serial(cable.line);
    ASSERT_TRUE(socket);
    // Who is another user sees it all the same: by the lock.
    auto by_nobody = in_child(::geteuid() == 0, [&] { return owner_of(file); });
    EXPECT_TRUE(by_nobody.ends_with(self)) << by_nobody;
    EXPECT_EQ(owner_of("/dev/null/none"), "");
}

// What an adapter's driver has been asked, in place of ioctl().
struct Adapter {
    static inline int flags = 0, set = 0;
    static inline bool refuses = false;
    static int control(int, unsigned long request, void* argument) {
        auto& port = *static_cast<serial_struct*>(argument);
        if (refuses) return -1;
        if (request == TIOCGSERIAL) port.flags = flags;
        if (request != TIOCSSERIAL) return 0;
        flags = port.flags;
        ++set;
        return 0;
    }
};

TEST(Serial, AnAdapterIsAskedToHoldNothingBack) {
    Adapter::flags = ASYNC_SPD_VHI;
    lower_latency(-1, &Adapter::control);
    EXPECT_EQ(Adapter::flags, ASYNC_SPD_VHI | ASYNC_LOW_LATENCY);
    lower_latency(-1, &Adapter::control);
    Adapter::refuses = true;
    lower_latency(-1, &Adapter::control);
    EXPECT_EQ(Adapter::set, 1);
}

std::string try_as_nobody(const SerialSettings& line) {
    return in_child(true, [&] {
        auto socket = open_serial(line);
        return socket ? std::string("opened") : socket.error().text();
    });
}

TEST(Serial, WithoutPermissionItIsSaidWhatToDo) {
    if (::geteuid() != 0) GTEST_SKIP() << "needs root to become another user";
    Cable cable;
    auto path = cable.line.path;
    auto refused = "cannot open " + path + ": permission denied; ";
    constexpr gid_t dialout = 20;  // by this name on Debian
    ASSERT_EQ(::chown(path.c_str(), 0, dialout), 0);
    ASSERT_EQ(::chmod(path.c_str(), 0660), 0);
    auto its_group = group_name(dialout);
    EXPECT_EQ(try_as_nobody(cable.line), refused + "add nobody to the group " + its_group +
                                             ": `sudo usermod -aG " + its_group +
                                             " nobody`, then log in again, or restart the service");
    ASSERT_EQ(::chmod(path.c_str(), 0600), 0);
    EXPECT_EQ(try_as_nobody(cable.line),
              refused + "it is for no group of users: `sudo chgrp dialout " + path + " && sudo chmod g+rw " +
                  path + "`, and add nobody to that group: `sudo usermod -aG dialout nobody`");
    ASSERT_EQ(::chmod(path.c_str(), 0666), 0);
    EXPECT_EQ(try_as_nobody(cable.line), "opened");
}

TEST(Serial, TheKernelTooKeepsOtherUsersOut) {
    if (::geteuid() != 0) GTEST_SKIP() << "needs root to become another user";
    Cable cable;
    ASSERT_EQ(::chmod(cable.line.path.c_str(), 0666), 0);
    EXPECT_EQ(try_as_nobody(cable.line), "opened");
    Program keeps_it_open(cable.line.path);
    end_exclusive(keeps_it_open.fd());  // that process has ended, and the terminal has not
    auto socket = open_serial(cable.line);
    ASSERT_TRUE(socket);
    auto plain = in_child(true, [&] {
        int fd = ::open(cable.line.path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
        return std::string(fd < 0 && errno == EBUSY ? "busy" : "something else");
    });
    EXPECT_EQ(plain, "busy");
    EXPECT_NE(try_as_nobody(cable.line).find("it is busy"), std::string::npos);
}

TEST(Serial, WhatIsNoLineIsRefused) {
    testkit::TempDir dir;
    auto refused = [](const std::string& path) {
        SerialSettings line;
        line.path = path;
        auto socket = open_serial(line);
        return socket ? std::string("opened") : socket.error().text();
    };
    EXPECT_NE(refused(dir.path() + "/none").find("there is no such device"), std::string::npos);
    testkit::write_file(dir.path() + "/file", "x");
    for (auto& path : {dir.path(), dir.path() + "/file", std::string("/dev/null")})
        EXPECT_NE(refused(path).find("it is no serial line"), std::string::npos) << path;
}

}  // namespace
}  // namespace gantry::link
