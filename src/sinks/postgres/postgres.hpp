#pragma once
#include <memory>
#include <string>
#include <vector>

#include "sinks/postgres/resolver.hpp"
#include "sinks/postgres/target.hpp"

namespace gantry::sinks::postgres {

extern const sink::Kind kind;

// A batch is one transaction: copied into a table of the session, inserted from there where the key is new,
// committed. A row that makes it fail is found by halving the batch.
class PostgresSink : public sink::Sink {
public:
    explicit PostgresSink(Target target);
    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience& patience) override;
    void idle(const sink::Patience& patience) override;
    bool connected() const override;

private:
    Answer<void> connect(const sink::Patience& patience);
    Answer<void> connect_to(const Target::Host& host, const sink::Patience& patience);
    Answer<void> set_up(const Target::Host& host, const sink::Patience& patience);
    Answer<void> insert(std::span<const sink::Item> items, const sink::Patience& patience);
    void forget_gone_tags(const sink::Patience& patience);

    Target target_;
    Resolver resolver_;
    Session session_;
    std::string insert_;  // what a batch is followed by
    Steady forget_at_{};
    bool warned_ = false;
};

}  // namespace gantry::sinks::postgres
