#include "gateway/side_link.hpp"

#include <utility>

namespace gantry::gateway {

void SideLink::start(link::Socket socket, std::function<void()> after_turn,
                     std::function<void(std::string_view)> ended) {
    close("a newer connection took its place");
    auto* party = driver_.notifications();
    if (party == nullptr) return ended("notifications are not wanted from it");
    link::Link::Callbacks callbacks;
    callbacks.after_turn = std::move(after_turn);
    callbacks.closed = [this, ended = std::move(ended)](std::string_view reason) {
        closed();
        ended(reason);
    };
    link_ = link::Link::start(loop_, std::move(socket), *party, std::move(callbacks));
}

void SideLink::wake() {
    if (link_) link_->wake();
}

void SideLink::close(std::string_view reason) {
    if (auto link = link_) link->close(reason);
}

void SideLink::closed() {
    // The link is in the middle of this call.
    loop_.post([link = std::exchange(link_, nullptr)] {});
    if (auto* party = driver_.notifications()) party->link_lost(link::read_clocks());
}

}  // namespace gantry::gateway
