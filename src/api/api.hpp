#pragma once
#include <memory>

#include "base/error.hpp"
#include "gateway/gateway.hpp"

namespace gantry::api {

// The gateway's verbs over HTTP: on the Unix socket gantry.sock in the data directory (mode 0600, the own
// user and root). The command line speaks to it, and so can anybody: curl --unix-socket gantry.sock
// http://gantry/api/v1/readers
class Api {
public:
    static Result<std::unique_ptr<Api>> start(gateway::Gateway& gateway);
    virtual ~Api() = default;
};

}  // namespace gantry::api
