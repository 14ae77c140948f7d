#pragma once
#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "reader/clock_watch.hpp"
#include "reader/driver.hpp"

// What drivers of several makes share: how reports grow, and how often a fault is told.
namespace gantry {

// Gathers what one piece of input brings into one report.
class Reports {
public:
    // More open tickets than this are never made by reading on.
    static constexpr std::size_t max_open = 16;

    explicit Reports(std::vector<Report>& to) : to_(to) {}
    Report& open(Now now);
    // The notices of a report come after its tags.
    Report& open_for_tags(Now now) {
        if (open_ && !open_->notices.empty()) flush();
        return open(now);
    }
    void notice(Notice notice, Now now) { open(now).notices.push_back(std::move(notice)); }
    // After tags were added to it, from this one on: drops times that are none, and notices that the reader's
    // clock was set.
    void take_times(Report& report, std::size_t from);
    void flush();  // what has a mark is kept though nothing else is in it
    void committed(Ticket ticket) { committed_ = std::max(committed_, std::min(ticket, issued_)); }
    bool full() const { return issued_ - committed_ >= max_open; }
    bool all_committed() const { return issued_ == committed_; }
    Ticket last_issued() const { return issued_; }
    Ticket last_committed() const { return committed_; }

private:
    std::vector<Report>& to_;
    std::optional<Report> open_;
    Ticket issued_ = 0, committed_ = 0;
    ClockWatch clock_;
};

// Lets a text through once a minute, and says then how often it was held back: what a reader sends must not
// fill the store with faults.
class OncePerMinute {
public:
    static constexpr std::size_t most_texts = 16;  // in one minute

    std::optional<std::string> pass(std::string text, Now now);

private:
    struct Told {
        Steady at;
        std::uint64_t held = 0;
    };
    std::map<std::string, Told> told_;
};

// A reader's clock before the year 2000 was never set: such times are not passed on.
void drop_implausible_times(std::span<Observation> observations);

}  // namespace gantry
