// A virtual reader on a pseudo-terminal.
#include "link/pty.hpp"

#include <sys/stat.h>

#include <filesystem>

#include "line.hpp"
#include "testkit/temp_dir.hpp"
#include "toy.hpp"
#include "toy_device.hpp"

namespace gantry::link {
namespace {

constexpr std::uint32_t fast = 921'600;

struct PtyHosts : DeviceHosts {
    testkit::TempDir dir;
    std::string path = dir.path() + "/reader";

    void begin(std::uint32_t baud = fast) {
        auto made = make(false);
        made->echo = true;
        auto opened = DeviceHost::pty(loop, std::move(made), path, baud);
        ASSERT_TRUE(opened) << opened.error().text();
        host = std::move(*opened);
    }
    // A program that has the line open, and the device knows it.
    std::unique_ptr<Program> program() {
        auto opened = std::make_unique<Program>(path);
        EXPECT_TRUE(eventually([&] { return host->connected(); }));
        return opened;
    }
    void inject(std::string_view text) {
        host->with_device([&](Device& it, Now now) { EXPECT_TRUE(it.inject(text, now)); });
    }
    std::string heard() {
        return ask([&] { return device->heard; });
    }
    Result<std::unique_ptr<DeviceHost>> another() {
        return DeviceHost::pty(loop, std::make_unique<ToyDevice>(), path, fast);
    }
};

TEST_F(PtyHosts, APartyTalksToADeviceOverATerminal) {
    begin();
    Toy toy;
    toy.echo = false;
    std::shared_ptr<Link> link;
    auto text = random_text(3'000);
    toy.at_start = [&](Toy& self, Now) { self.say(text); };
    loop.run_and_wait([&] {
        SerialSettings line;
        line.path = path;
        auto socket = open_serial(line);
        ASSERT_TRUE(socket) << socket.error().text();
        link = Link::start(loop, std::move(*socket), toy, {});
    });
    EXPECT_TRUE(eventually([&] { return ask([&] { return toy.text.size(); }) >= text.size() + 2; }));
    EXPECT_TRUE(ask([&] { return toy.text == "hi" + text; }));
    EXPECT_TRUE(heard() == text);
    loop.run_and_wait([&] { link.reset(); });
}

TEST_F(PtyHosts, BytesThatDripInOneByOneArrive) {
    begin();
    auto program = this->program();
    EXPECT_EQ(program->receive(2), "hi");
    for (char c : std::string_view("a\n\x03\x04\0\r\xFF", 7)) {
        ASSERT_TRUE(program->send({&c, 1}));
        EXPECT_EQ(program->receive(1), std::string(1, c));
    }
}

TEST_F(PtyHosts, TheDeviceHasNoLinkBeforeAProgramHasOpenedTheLine) {
    begin();
    EXPECT_TRUE(eventually([&] { return ask([&] { return device->ticks; }) > 3; }));  // its time passes
    EXPECT_EQ(story(), "");
    EXPECT_FALSE(host->connected());
    auto program = this->program();
    EXPECT_EQ(story(), "s");
    EXPECT_EQ(program->receive(2), "hi") << "all that it says from then on arrives";
}

TEST_F(PtyHosts, WhatAProgramSaidThatHasGoneAgainIsHeard) {
    begin();
    ASSERT_TRUE(Program(path).send("x"));
    EXPECT_TRUE(eventually([&] { return heard() == "x"; }));
    EXPECT_TRUE(eventually([&] { return !host->connected(); }));
}

TEST_F(PtyHosts, AProgramMayCloseTheLineAndComeBack) {
    begin();
    for (int round = 0; round < 3; ++round) {
        Program program(path);
        auto text = "round " + std::to_string(round) + "\n";
        ASSERT_TRUE(program.send(text));
        EXPECT_TRUE(program.until(text).ends_with(text));
    }
    EXPECT_EQ(story(), "s");  // the device does not see it
    EXPECT_TRUE(eventually([&] { return !host->connected(); }));
    auto again = program();
    EXPECT_TRUE(host->connected());
}

TEST_F(PtyHosts, ADeviceThatEndsItsLinkIsPulledOutAndPluggedInAgain) {
    begin();
    for (auto* told : {"sl", "slsl"}) {
        auto program = this->program();
        if (story() == "s")
            ASSERT_TRUE(program->send("q"));
        else
            host->cut();
        EXPECT_TRUE(eventually([&] {  // its end
            char byte = 0;
            auto size = ::read(program->fd(), &byte, 1);
            return size == 0 || (size < 0 && errno == EIO);
        }));
        EXPECT_TRUE(eventually([&] { return std::filesystem::is_character_file(path); }));
        EXPECT_EQ(story(), told) << "plugged in, and nobody has opened it";
        EXPECT_FALSE(host->connected());
    }
    auto program = this->program();
    inject("still there");
    EXPECT_TRUE(program->until("still there").ends_with("still there"));
}

TEST_F(PtyHosts, ALineWhoseNameWasTakenMeanwhileComesBackWhenItIsFree) {
    begin();
    auto program = this->program();
    std::filesystem::remove(path);
    testkit::write_file(path, "in the way");
    host->cut();
    EXPECT_TRUE(eventually([&] { return story() == "sl"; }));
    EXPECT_FALSE(host->connected());
    std::filesystem::remove(path);
    EXPECT_TRUE(eventually([&] { return std::filesystem::is_character_file(path); }));
}

TEST_F(PtyHosts, AProgramThatWasKilledKeepsNobodyOut) {
    begin();
    auto terminal = std::filesystem::read_symlink(path).string();
    ASSERT_EQ(::chmod(terminal.c_str(), 0666), 0);
    auto killed = in_child(false, [&] {
        int fd = ::open(terminal.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
        return std::string(::ioctl(fd, TIOCEXCL) == 0 ? "mine" : "refused");
    });
    EXPECT_EQ(killed, "mine");
    EXPECT_TRUE(eventually([&] {  // root would not be kept out
        return in_child(::geteuid() == 0, [&] {
                   int fd = ::open(terminal.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
                   return std::string(fd < 0 ? "busy" : "open");
               }) == "open";
    }));
}

TEST_F(PtyHosts, TheLinkIsThereAsLongAsTheHost) {
    ASSERT_EQ(::symlink("/nowhere", path.c_str()), 0);  // left behind by one that was killed
    begin();
    EXPECT_EQ(std::filesystem::read_symlink(path).parent_path(), "/dev/pts");
    EXPECT_TRUE(std::filesystem::is_character_file(path));
    host.reset();
    EXPECT_FALSE(std::filesystem::is_symlink(path));
}

TEST_F(PtyHosts, WhatIsNoLinkIsNotReplaced) {
    testkit::write_file(path, "precious");
    auto refused = another();
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().what.find("something else is there"), std::string::npos);
    EXPECT_EQ(std::filesystem::file_size(path), 8u);
    path = dir.path() + "/no/folder";
    refused = another();
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().what.find("its folder does not exist"), std::string::npos);
    path = dir.path() + "/reader2";
    refused = DeviceHost::pty(loop, std::make_unique<ToyDevice>(), path, 0);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().what.find("0 baud"), std::string::npos);
}

TEST_F(PtyHosts, ALinkToATerminalInUseIsNotTaken) {
    begin();
    auto target = std::filesystem::read_symlink(path);
    auto second = another();
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().what,
              "cannot make the link " + path + ": it leads to " + target.string() + ", which is in use");
    EXPECT_EQ(std::filesystem::read_symlink(path), target);
    auto program = this->program();
    inject("still there");
    EXPECT_TRUE(program->until("still there").ends_with("still there"));
}

TEST_F(PtyHosts, ALinkThatLeadsElsewhereByNowStays) {
    begin();
    std::filesystem::remove(path);
    std::filesystem::create_symlink("/dev/null", path);
    host.reset();
    EXPECT_EQ(std::filesystem::read_symlink(path), "/dev/null");
}

TEST_F(PtyHosts, OneMayBeDestroyedAfterItsLoopHasStopped) {
    begin();
    Program program(path);
    loop.stop();
    EXPECT_FALSE(std::filesystem::is_symlink(path));
    EXPECT_EQ(program.until("never"), program.until("never"));  // at its end, at once
    host.reset();
}

// The line alone: the test holds the device's end.
struct PtyLine : ::testing::Test {
    Loop loop{"test"};
    testkit::TempDir dir;
    std::string path = dir.path() + "/line";
    std::unique_ptr<Pty> pty;
    Program device{-1};

    void open(std::uint32_t baud) {
        loop.run_and_wait([&] {
            auto opened = Pty::open(loop, path, baud);
            ASSERT_TRUE(opened) << opened.error().text();
            pty = std::move(*opened);
        });
        connect();
    }
    void connect() {
        loop.run_and_wait([&] {
            auto socket = pty->connect();
            ASSERT_TRUE(socket) << socket.error().text();
            EXPECT_EQ(socket->peer(), path);
            device = Program(socket->release());
        });
    }
    bool opened() {
        bool answer = false;
        loop.run_and_wait([&] { answer = pty->opened(); });
        return answer;
    }
    ~PtyLine() override {
        loop.run_and_wait([&] { pty.reset(); });
    }
};

TEST_F(PtyLine, BytesKeepTheirOrderAndAreNotFasterThanTheLine) {
    open(19'200);
    Program program(path);
    auto text = random_text(480);  // a quarter of a second
    for (auto [from, to] : {std::pair(&device, &program), std::pair(&program, &device)}) {
        auto begin = read_clocks().steady;
        ASSERT_TRUE(from->send(text));
        EXPECT_TRUE(to->receive(text.size()) == text);
        EXPECT_GE(read_clocks().steady - begin, 250ms);
    }
}

TEST_F(PtyLine, MuchGoesThroughBothWaysAtOnce) {
    open(4'000'000);
    Program program(path);
    auto there = random_text(150'000), back = random_text(140'000);
    std::thread one([&] { EXPECT_TRUE(device.send(there)); });
    std::thread two([&] { EXPECT_TRUE(program.send(back)); });
    std::thread three([&] { EXPECT_TRUE(device.receive(back.size()) == back); });
    EXPECT_TRUE(program.receive(there.size()) == there);
    one.join();
    two.join();
    three.join();
}

TEST_F(PtyLine, WhatIsSentWhileNobodyHasTheLineOpenIsLost) {
    open(4'000'000);
    EXPECT_FALSE(opened());
    ASSERT_TRUE(device.send(random_text(20'000)));
    int waiting = 0;
    ASSERT_TRUE(eventually([&] { return ::ioctl(device.fd(), TIOCOUTQ, &waiting) == 0 && waiting == 0; }));
    Program program(path);
    EXPECT_TRUE(opened());
    ASSERT_TRUE(device.send("here I am"));
    EXPECT_LE(program.until("here I am").size(), 300u);  // no more than was under way
    program.close();
    EXPECT_FALSE(opened());
}

TEST_F(PtyLine, AProgramThatDoesNotReadHoldsTheDeviceUntilItLeaves) {
    open(4'000'000);
    Program program(path);
    constexpr std::size_t much = 400'000;
    std::atomic<std::size_t> sent = 0;
    std::thread sender([&] {
        std::string piece(500, 'x');
        while (sent < much && device.send(piece))
            sent += piece.size();
    });
    // The terminal takes some ten thousand bytes, then nothing moves.
    std::size_t before = 0;
    int looks = 0;
    EXPECT_TRUE(eventually([&] {
        looks = sent != 0 && sent == before ? looks + 1 : 0;
        before = sent;
        return looks == 60;
    }));
    EXPECT_LT(sent, much);
    program.close();
    sender.join();
    EXPECT_EQ(sent, much);
}

TEST_F(PtyLine, WhatADeviceSaidBeforeItsEndWasClosedStillGoesOut) {
    open(19'200);
    Program program(path);
    auto text = random_text(600);
    ASSERT_TRUE(device.send(text));
    connect();
    ASSERT_TRUE(device.send("and again"));
    EXPECT_TRUE(program.receive(text.size() + 9) == text + "and again");
    ASSERT_TRUE(program.send("both"));
    EXPECT_EQ(device.receive(4), "both");
}

}  // namespace
}  // namespace gantry::link
