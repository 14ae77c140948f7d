#include "api/api.hpp"

#include "api/handlers.hpp"
#include "api/requests.hpp"
#include "http/server.hpp"

namespace gantry::api {

namespace {
class UnixApi : public Api {
public:
    explicit UnixApi(gateway::Gateway& gateway) : gateway_(gateway) {
        // Shared: a sink may be in the middle of a call when the interface ends.
        auto requests = std::make_shared<Requests>(gateway);
        gateway.serve_requests([requests](std::string_view operation, std::string body, auto answer) {
            requests->take(operation, std::move(body), std::move(answer));
        });
    }
    ~UnixApi() override { gateway_.serve_requests(nullptr); }

    Result<void> open(gateway::Gateway& gateway) {
        http::Limits limits;
        limits.workers = Waiters::workers;
        auto server = http::Server::open(
            gateway.config().data_dir / "gantry.sock",
            [this, &gateway](const http::Request& request) { return handle(gateway, waiters_, request); },
            limits);
        if (!server) return tl::unexpected(server.error());
        server_ = std::move(*server);
        return {};
    }

private:
    gateway::Gateway& gateway_;
    Waiters waiters_;
    std::unique_ptr<http::Server> server_;
};
}  // namespace

Result<std::unique_ptr<Api>> Api::start(gateway::Gateway& gateway) {
    auto api = std::make_unique<UnixApi>(gateway);
    if (auto opened = api->open(gateway); !opened) return tl::unexpected(opened.error());
    return api;
}

}  // namespace gantry::api
