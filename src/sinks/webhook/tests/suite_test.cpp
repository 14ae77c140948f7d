#include "web_server.hpp"

namespace gantry::sinks::webhook {
namespace {

class WebDestination : public testkit::Destination {
public:
    void start() override { server_.start(); }
    void kill() override { server_.kill(); }
    std::unique_ptr<sink::Sink> make_sink() override { return make_webhook(server_.url()); }
    std::vector<std::string> ids() override { return server_.ids(); }
    bool refuse(const std::string& id) override {
        refused_.emplace_back(id);
        server_.behave({{"refuse", refused_}});
        return true;
    }

private:
    WebServer server_;
    json::array refused_;
};

GANTRY_SINK_SUITE(Webhook, WebDestination)

}  // namespace
}  // namespace gantry::sinks::webhook
