#include "cli/link_watch.hpp"

#include <algorithm>

#include "base/log.hpp"

namespace gantry::cli {

namespace {
constexpr auto pause = 30s;  // between two lines about the same trouble
// A gateway turns a reader away when it hears its name, which takes a first word: up to 5 s for some makes.
constexpr auto at_once = 10s;

std::string so_often(std::uint64_t count) {
    return count == 1 ? std::string() : fmt::format(" ({} times so far)", count);
}
}  // namespace

bool LinkWatch::due(Complaint& complaint, Steady now) {
    ++complaint.count;
    if (complaint.count > 1 && now < complaint.next) return false;
    complaint.next = now + pause;
    return true;
}

void LinkWatch::told(std::size_t reader, const std::string& name, const link::LinkNews& news, Steady now) {
    std::lock_guard lock(mutex_);
    auto& its = readers_[reader];
    using Kind = link::LinkNews::Kind;
    if (news.kind == Kind::up) {
        its.up_since = now;
        return;
    }
    last_reason_ = news.reason;
    if (news.kind == Kind::not_reached) {
        if (due(not_reached_, now))
            log::warn("emulate", "{}: {}{}; it keeps trying", name, news.reason,
                      so_often(not_reached_.count));
        return;
    }
    its.up_since.reset();
    if (news.heard || news.ours || news.lasted >= at_once) {
        its.taken = true;
        return;
    }
    its.turned_away = true;
    if (due(turned_away_, now))
        log::warn(
            "emulate",
            "{}: connected to {}, and at once {}{}; does the gateway know a reader of that name? Its log "
            "says why; this one keeps trying",
            name, place_, news.reason, so_often(turned_away_.count));
}

std::size_t LinkWatch::never_taken(Steady now) const {
    std::lock_guard lock(mutex_);
    // A link that is up is good, unless others like it were cut before and this one is still as young.
    return static_cast<std::size_t>(std::ranges::count_if(readers_, [now](auto& its) {
        bool up = its.up_since && (!its.turned_away || now - *its.up_since >= at_once);
        return !its.taken && !up;
    }));
}

std::string LinkWatch::last_reason() const {
    std::lock_guard lock(mutex_);
    return last_reason_;
}

}  // namespace gantry::cli
