#pragma once
#include <sys/un.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace gantry::testkit {

// The other end of a connection, plain and blocking: it says bytes as a test wants them. It waits ten seconds
// at most for bytes to come or to go.
class Peer {
public:
    explicit Peer(int fd);
    // A connection that does not come about fails the test.
    static Peer to(std::uint16_t port);  // TCP, 127.0.0.1
    static Peer to(const std::filesystem::path& unix_socket);
    Peer(Peer&& other) noexcept;
    Peer& operator=(Peer&& other) noexcept;
    ~Peer() { close(); }

    bool connect(std::uint16_t port) const;
    bool send(std::string_view text) const;
    // Up to `size` bytes; fewer only at the end of the stream or after an error.
    std::string receive(std::size_t size) const;
    std::string until(std::string_view mark) const;  // everything up to the end of the mark
    std::string rest() const;                        // everything up to the end of the stream
    bool at_end() const;
    void shutdown() const;
    void close();
    void reset();
    int fd() const { return fd_; }

private:
    int fd_;
};

sockaddr_un unix_address(const std::filesystem::path& path);

}  // namespace gantry::testkit
