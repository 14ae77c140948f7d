// Who may open the socket, and what stands at its path.
#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "http_fixture.hpp"

namespace gantry::http {
namespace {

TEST_F(Http, TheSocketIsForItsUserAlone) {
    serve_echo();
    struct stat file {};
    ASSERT_EQ(::stat(path.c_str(), &file), 0);
    EXPECT_TRUE(S_ISSOCK(file.st_mode));
    EXPECT_EQ(file.st_mode & 0777, 0600u);
}

TEST_F(Http, AnotherUserIsTurnedAwayEvenIfTheFileLetsItIn) {
    if (::geteuid() != 0) GTEST_SKIP() << "only root can become somebody else";
    serve_echo();
    ASSERT_EQ(::chmod(folder.c_str(), 0755), 0);
    ASSERT_EQ(::chmod(path.c_str(), 0666), 0);
    // The child only makes system calls: other threads may have held locks when it was made.
    auto address = testkit::unix_address(path);
    int answers[2];
    ASSERT_EQ(::pipe2(answers, O_CLOEXEC), 0);
    pid_t child = ::fork();
    if (child == 0) {
        char text[512];
        int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
        if (::setuid(65534) != 0 || ::connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0)
            ::_exit(2);
        auto size = ::recv(fd, text, sizeof text, 0);
        if (size > 0 && ::write(answers[1], text, static_cast<std::size_t>(size)) == size) ::_exit(0);
        ::_exit(1);
    }
    ::close(answers[1]);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    ASSERT_EQ(WEXITSTATUS(status), 0);
    char text[512];
    auto size = ::read(answers[0], text, sizeof text);
    ::close(answers[0]);
    ASSERT_GT(size, 0);
    std::string_view answer(text, static_cast<std::size_t>(size));
    EXPECT_TRUE(answer.starts_with("HTTP/1.1 403 Forbidden")) << answer;
    EXPECT_EQ(server->connections(), 0u);
}

TEST_F(Http, AnAbandonedSocketIsReplacedAndALiveOneIsNot) {
    serve_echo();
    auto second = Server::open(path, [](const Request&) { return Response{}; });
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().what,
              "another gateway is running in " + folder.string() + ": it answers on " + path.string());
    EXPECT_EQ(get("/still")->body, "GET /still");
    server.reset();

    int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);  // as after a SIGKILL
    auto address = testkit::unix_address(path);
    ASSERT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    ::close(fd);
    ASSERT_TRUE(std::filesystem::exists(path));
    serve_echo();
    EXPECT_EQ(get("/again")->body, "GET /again");
}

TEST_F(Http, AFileThatIsNoSocketIsLeftAlone) {
    ::close(::open(path.c_str(), O_CREAT | O_WRONLY, 0600));
    auto opened = Server::open(path, [](const Request&) { return Response{}; });
    ASSERT_FALSE(opened);
    EXPECT_NE(opened.error().what.find("is not a socket"), std::string::npos);
    EXPECT_TRUE(std::filesystem::exists(path));
}

TEST_F(Http, ASocketThatCannotBeMadeSaysWhy) {
    auto nowhere =
        Server::open(folder / "missing" / "gantry.sock", [](const Request&) { return Response{}; });
    ASSERT_FALSE(nowhere);
    EXPECT_NE(nowhere.error().hint.find("must exist and be writable"), std::string::npos);
    auto longer = Server::open(folder / std::string(200, 'x'), [](const Request&) { return Response{}; });
    ASSERT_FALSE(longer);
    EXPECT_NE(longer.error().what.find("too long for a Unix socket"), std::string::npos);
}

TEST_F(Http, AClientWithoutAGatewaySaysWhatToDo) {
    auto none = get("/");
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().text(), "no gateway is running in " + folder.string() + ": cannot open " +
                                       path.string() + "; start one with `gantry run`");
    serve_echo();
    auto keep = folder / "keep";
    std::filesystem::rename(path, keep);  // the server removes only its own path
    server.reset();
    std::filesystem::rename(keep, path);
    auto dead = get("/");
    ASSERT_FALSE(dead);
    EXPECT_EQ(dead.error().text(), "no gateway is running in " + folder.string() + ": nobody answers on " +
                                       path.string() + "; start one with `gantry run`");
}

}  // namespace
}  // namespace gantry::http
