#include "reader/reports.hpp"

#include <utility>

#include <fmt/format.h>

namespace gantry {

static constexpr std::int64_t year_2000_us = 946'684'800'000'000;

Report& Reports::open(Now now) {
    if (!open_) {
        open_.emplace();
        open_->ticket = ++issued_;
        open_->received = now;
    }
    return *open_;
}

void Reports::take_times(Report& report, std::size_t from) {
    auto reads = std::span(report.observations).subspan(from);
    drop_implausible_times(reads);
    if (auto by = clock_.look(reads, report.received)) report.notices.emplace_back(ClockNotice{*by});
}

void Reports::flush() {
    if (!open_) return;
    auto ready = std::exchange(open_, {});
    if (ready->observations.empty() && ready->notices.empty() && !ready->mark) {
        --issued_;  // nothing in it
        return;
    }
    to_.push_back(std::move(*ready));
}

std::optional<std::string> OncePerMinute::pass(std::string text, Now now) {
    auto over = [&](const Told& told) { return now.steady >= told.at + std::chrono::minutes{1}; };
    auto known = told_.find(text);
    if (known != told_.end()) {
        auto& told = known->second;
        if (!over(told)) {
            ++told.held;
            return {};
        }
        if (told.held > 0) text += fmt::format(" ({} more since the last of these)", told.held);
        told = {.at = now.steady};
        return text;
    }
    if (told_.size() >= most_texts) std::erase_if(told_, [&](auto& each) { return over(each.second); });
    if (told_.size() >= most_texts) return {};
    told_.emplace(text, Told{.at = now.steady});
    return text;
}

void drop_implausible_times(std::span<Observation> observations) {
    for (auto& each : observations)
        if (each.reader_time_us < year_2000_us) each.reader_time_us = 0;
}

}  // namespace gantry
