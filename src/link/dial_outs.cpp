#include "link/dial_outs.hpp"

#include <algorithm>

#include "base/log.hpp"
#include "base/text.hpp"

namespace gantry::link {

namespace {
constexpr auto dial_timeout = 10s;
constexpr auto shortest_pause = 50ms;  // between tries of a channel that does not wait by itself
}  // namespace

class DialOuts::Channel {
public:
    Channel(Loop& loop, std::shared_ptr<DialOut> party, std::function<void()> turned)
        : loop_(loop), party_(std::move(party)), turned_(std::move(turned)), timer_(loop) {}

    const std::shared_ptr<DialOut>& party() const { return party_; }
    bool over() const { return ending_ && !link_; }

    void look() {
        if (!link_) return plan();
        link_->wake();
    }

    // It is not wanted any more: what it has said still goes out.
    void end() {
        if (std::exchange(ending_, true)) return;
        timer_.cancel();
        dial_.reset();
        if (link_) link_->finish("no longer wanted");
    }

private:
    void plan() {
        if (ending_ || dial_) return;
        auto at = party_->dial_at();
        if (!at) return timer_.cancel();
        timer_.at(std::max(*at, next_try_), [this] { dial(); });
    }

    void dial() {
        auto at = party_->dial_at();
        if (!at || *at > read_clocks().steady) return plan();
        auto endpoint = parse_endpoint(party_->address());
        if (!endpoint) return failed(endpoint.error());
        dial_ = Dial::start(loop_, *endpoint, dial_timeout, [this](Result<Socket> socket) {
            dial_.reset();
            if (!socket) return failed(socket.error());
            take(std::move(*socket));
        });
    }

    void failed(const Error& error) {
        log::debug("emulator", "channel to {}: {}", printable(party_->address()), error.text());
        auto now = read_clocks();
        next_try_ = now.steady + shortest_pause;
        party_->dial_failed(now);
        plan();
        tell();
    }

    void take(Socket socket) {
        Link::Callbacks callbacks;
        callbacks.after_turn = turned_;
        callbacks.closed = [this](std::string_view reason) { lost(reason); };
        callbacks.peer_is = "the gateway";
        link_ = Link::start(loop_, std::move(socket), *party_, std::move(callbacks));
    }

    void lost(std::string_view reason) {
        log::debug("emulator", "channel to {}: {}", printable(party_->address()), reason);
        auto now = read_clocks();
        next_try_ = now.steady + shortest_pause;
        link_.reset();
        party_->link_lost(now);
        plan();
        tell();
    }

    void tell() {
        auto turned = turned_;  // it may let go of this channel
        turned();
    }

    Loop& loop_;
    std::shared_ptr<DialOut> party_;
    std::function<void()> turned_;
    Timer timer_;
    std::unique_ptr<Dial> dial_;
    std::shared_ptr<Link> link_;
    Steady next_try_{};
    bool ending_ = false;
};

DialOuts::DialOuts(Loop& loop, std::function<void()> turned) : loop_(loop), turned_(std::move(turned)) {}
DialOuts::~DialOuts() = default;

void DialOuts::look(const std::vector<std::shared_ptr<DialOut>>& wanted) {
    if (wanted.empty() && channels_.empty()) return;
    for (auto& party : wanted) {
        auto is_it = [&](const auto& channel) { return channel->party() == party; };
        if (std::ranges::any_of(channels_, is_it)) continue;
        channels_.push_back(std::make_shared<Channel>(loop_, party, turned_));
    }
    auto now_there = channels_;  // a channel's turn may come back here and change the list
    for (auto& channel : now_there) {
        if (std::ranges::find(wanted, channel->party()) == wanted.end()) channel->end();
        channel->look();
    }
    std::erase_if(channels_, [](const auto& channel) { return channel->over(); });
}

}  // namespace gantry::link
