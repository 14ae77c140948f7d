#pragma once
#include <memory>
#include <optional>
#include <string>

#include "sink/attempt.hpp"
#include "sink/sink.hpp"
#include "sinks/nats/connection.hpp"
#include "sinks/nats/subjects.hpp"

namespace gantry::sinks::nats {

struct Plan {
    Access access;
    std::string prefix, gateway_id;
    std::size_t window = 2000;  // messages under way without an answer
};

class NatsSink : public sink::Sink {
public:
    explicit NatsSink(Plan plan);
    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override;
    void idle(const sink::Patience& patience) override;
    bool connected() const override { return connection_ && connection_->alive(); }

private:
    bool connect(const sink::Patience& patience, std::string& trouble);
    void remember_servers();

    Plan plan_;
    Subjects subjects_;
    std::vector<sink::ServerAddress> configured_;
    std::optional<sink::Attempt<Result<std::unique_ptr<Connection>>>> attempt_;
    Steady attempt_end_{};  // then it is given up: a handshake in it may have no end
    int left_behind_ = 0;   // attempts that have not ended, as far as we know
    std::unique_ptr<Connection> connection_;
};

}  // namespace gantry::sinks::nats
