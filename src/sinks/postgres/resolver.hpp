#pragma once
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "sink/sink.hpp"

namespace gantry::sinks::postgres {

// Host names to addresses. The system's resolver may take minutes and knows neither patience nor a stop, so
// it is asked on a thread of its own; one at a time for each name, however often it is asked for.
class Resolver {
public:
    // "192.168.0.7", "::1" …, at least one.
    Result<std::vector<std::string>> addresses(const std::string& host, const sink::Patience& patience);

private:
    struct Lookup;
    std::map<std::string, std::shared_ptr<Lookup>> running_;
};

}  // namespace gantry::sinks::postgres
