#pragma once
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"

// One idempotent producer. All that knows librdkafka is behind this header.
namespace gantry::sinks::kafka {

// librdkafka's words (its CONFIGURATION.md) and their values.
using Words = std::vector<std::pair<std::string, std::string>>;

struct Message {
    std::string_view key;  // empty: none
    std::string_view value, id, type, schema, content_type;
};

// What became of a message that was put.
struct Report {
    std::size_t item = 0;
    std::string error = {};  // empty: all in-sync replicas have it; else the name: "MSG_SIZE_TOO_LARGE"
    std::string text = {};   // of the error, for people
};

class Producer {
public:
    // Connects by itself, in threads of its own.
    static Result<std::unique_ptr<Producer>> make(const Words& words, const std::string& topic);
    // Waits for its threads, and those for the system's resolver: seconds, if it is bad. Nothing is
    // sent any more.
    ~Producer();
    Producer(const Producer&) = delete;
    Producer& operator=(const Producer&) = delete;

    // Asks the cluster for the topic. Empty: it is there, and its partitions have leaders.
    std::string ask(std::chrono::milliseconds wait);
    static std::string_view timed_out();  // what it says of a question that was cut short

    enum class Put : std::uint8_t { taken, full, refused };
    // Copies the message. Full: serve() makes room. Refused: `refusal` says why.
    Put put(const Message& message, std::size_t item, Report& refusal);
    std::size_t unreported() const;
    // Sends what was put, and waits until something is reported or the time is over.
    void serve(std::chrono::milliseconds wait, std::vector<Report>& reports);
    // What was not sent never will be, and acknowledgements of the rest do not count. All is reported.
    void give_up(std::vector<Report>& reports);

    // All brokers that it knows are away, as far as it knows. Changes in calls of the others only.
    bool away() const;
    // A broker and we do not trust each other: a certificate or a password is wrong. Waiting does not help.
    bool unwelcome() const;
    std::string last_error() const;  // of a connection, or one that ends the producer; empty: none yet

private:
    struct Impl;
    explicit Producer(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace gantry::sinks::kafka
