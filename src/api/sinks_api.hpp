#pragma once
#include "gateway/gateway.hpp"
#include "http/message.hpp"

namespace gantry::api {

// GET  /api/v1/sinks                    every sink and how it is
// GET  /api/v1/sinks/NAME               one of them
// GET  /api/v1/sinks/NAME/dead          its dead letters: ?after=SEQ&limit=N (1 to 1000)
// POST /api/v1/sinks/NAME/retry         what waits is tried at once
// POST /api/v1/sinks/NAME/skip          the event that blocks becomes a dead letter
// POST /api/v1/sinks/NAME/dead/retry    offers dead letters again: {"events":[SEQ…]}, or {"all":true}
// POST /api/v1/sinks/NAME/dead/discard  throws them away: the same body
http::Response sinks(gateway::Gateway& gateway, const http::Request& request);

}  // namespace gantry::api
