#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "sink/server_address.hpp"

namespace gantry::sinks::nats {

// The stream that events go to. It is made if there is none; one that is there is checked and never changed.
struct StreamPlan {
    std::string name;
    std::vector<std::string> subjects;         // of a new one
    std::string wanted;                        // what it must take, "gantry.site-7.*.events"
    std::chrono::seconds duplicate_window{0};  // at least so long
    std::chrono::seconds max_age{0};           // of a new one; 0: for ever
    int replicas = 1;                          // at least so many
    bool in_memory = false;                    // a new one
};

struct Access {
    std::vector<sink::ServerAddress> servers;  // tried in turn
    bool tls = false, tls_insecure = false;
    std::string tls_ca, tls_cert, tls_key;           // files; no tls_ca: what the system trusts
    std::string user, password, token, credentials;  // credentials: a file
    std::string name;                                // of the client, for the server's own lists
    StreamPlan stream;
};

// The server's answer to one message.
struct Answer {
    std::size_t item = 0;  // as given to publish()
    bool accepted = false;
    bool rejected = false;  // it will never take this message; neither: not now
    std::string why;
};

void start_library();  // before the first connection

// One connection to a server, to its end: nothing is sent again by itself. The library has threads of its
// own; they put answers into a box that this class reads.
class Connection {
public:
    // Blocks until it is there, and the stream, too; may take a minute.
    static Result<std::unique_ptr<Connection>> open(const Access& access);
    ~Connection();
    Connection(const Connection&) = delete;
    Connection& operator=(const Connection&) = delete;

    bool alive() const;
    std::string trouble() const;  // why it is not alive, or what the server forbids
    bool forbidden() const;       // the server said that we may not publish there: no answer will come

    enum class Handed : std::uint8_t { sent, refused, lost };
    // `item` comes back in the answer. `refusal`, if it is refused: it cannot be sent at all.
    Handed publish(const std::string& subject, std::string_view id, std::string_view payload,
                   std::size_t item, std::string& refusal);
    std::size_t in_flight() const;
    // Nothing is in flight and no answer waits to be taken: the next batch can use it.
    bool settled() const;
    // The answers that are there; waits for one so long at most.
    std::vector<Answer> answers(std::chrono::milliseconds at_most);
    // All servers that are known now, the one that we are connected to first.
    std::vector<sink::ServerAddress> servers() const;

private:
    struct Box;
    struct Callbacks;
    struct Client;
    Connection();
    Result<void> connect(const Access& access, const sink::ServerAddress& server);
    Result<void> ready_stream(const StreamPlan& plan);

    std::shared_ptr<Box> box_;
    std::uintptr_t box_number_ = 0;
    std::unique_ptr<Client> client_;
    std::string stream_name_;
    sink::ServerAddress server_;
};

}  // namespace gantry::sinks::nats
