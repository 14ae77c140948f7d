#pragma once
#include <condition_variable>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "sinks/kafka/target.hpp"

namespace gantry::sinks::kafka {

extern const sink::Kind kind;

// Ends producers in a thread of its own, one at a time: they wait for threads of theirs.
class Retirement {
public:
    ~Retirement();
    void begin(std::unique_ptr<Producer> producer);  // no other may be under way
    bool wait(const sink::Patience& patience);       // none is under way; false: patience is over

private:
    std::mutex mutex_;
    std::condition_variable_any changed_;
    bool under_way_ = false;
    std::thread thread_;
};

// A batch is handed to the producer whole, and lasts until every message is reported. A producer that did
// not deliver all of one is given up with what it holds, so that nothing is sent behind our back; the next
// one starts when it is gone.
class KafkaSink : public sink::Sink {
public:
    explicit KafkaSink(Target target);
    ~KafkaSink() override;
    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override;
    void idle(const sink::Patience& patience) override;
    bool connected() const override;

private:
    // How a producer goes on when a broker refuses messages.
    enum class Manner : std::uint8_t {
        in_order,  // not at all: what follows them must not overtake them
        one_by_one
    };
    struct Delivery;

    std::string connect(Manner manner, const sink::Patience& patience);  // empty: done
    void give_up(std::vector<Report>& reports);
    void send(std::span<const std::size_t> items, Delivery& delivery);
    void take(Delivery& delivery);
    void send_alone(std::span<const std::size_t> items, Delivery& delivery);
    std::string no_answer(const sink::Patience& patience) const;

    Target target_;
    std::size_t batch_bytes_;  // of one request and partition; less after a broker found it too much
    Retirement retirement_;
    std::unique_ptr<Producer> producer_;
    Manner manner_{};
    bool asked_ = false;  // the producer has found the topic
    bool warned_ = false;
};

}  // namespace gantry::sinks::kafka
