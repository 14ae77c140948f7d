#pragma once
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "sink/sink.hpp"
#include "sinks/mqtt/connection.hpp"
#include "sinks/mqtt/topics.hpp"

namespace gantry::sinks::mqtt {

// Requests of the API that come in over the broker, and their answers.
class Requests {
public:
    Requests(sink::Host& host, const Topics& topics)
        : host_(host), topics_(topics), box_(std::make_shared<Box>()) {}

    void take(const Incoming& message);

    struct Answer {
        std::string topic, payload, correlation;
    };
    bool waiting() const;                          // some are not answered yet
    void wait(std::chrono::milliseconds at_most);  // for one more answer
    std::vector<Answer> take_answers();
    void put_back(std::vector<Answer> answers);  // they could not be sent

private:
    // Outlives us: the gateway answers when it is done, on any thread.
    struct Box {
        std::mutex mutex;
        std::condition_variable changed;
        std::size_t under_way = 0;  // without an answer
        std::vector<Answer> answers;
    };
    sink::Host& host_;
    const Topics& topics_;
    std::shared_ptr<Box> box_;
};

}  // namespace gantry::sinks::mqtt
