// The runner's middle: events out of the journal, to the sink, and what became of them.
#include <algorithm>

#include <fmt/format.h>

#include "base/failpoint.hpp"
#include "base/log.hpp"
#include "base/text.hpp"
#include "event/event_json.hpp"
#include "event/event_parse.hpp"
#include "gateway/sink_runner.hpp"
#include "link/link.hpp"

namespace gantry::gateway {

namespace {
constexpr std::size_t line_bytes = 8u << 20;    // of payload that is lent at a time
constexpr std::size_t scanned_a_turn = 50'000;  // events that nobody wants are passed in steps
constexpr std::size_t letters_a_turn = 500;
constexpr std::size_t longest_reason = 2000;
constexpr auto say_refused_every = 1min;
}  // namespace

// Reads on in the journal. True: there is something to offer.
bool SinkRunner::refill(Now now) {
    {
        std::lock_guard lock(mutex_);
        news_ = false;  // before we look: what is committed from now on wakes us again
    }
    auto end = reader_->last_seq();
    if (!end) {
        blocker_ = Blocker::none;
        fail(end.error().error.text(), {}, false, now);
        reader_.reset();
        return false;
    }
    last_seq_ = *end;
    if (*end <= scanned_) {
        nothing_waits(now);
        return false;
    }
    auto all = read_on(*end);
    auto damaged = [](auto& read) {
        return !read && read.error().kind == journal::StoreError::Kind::corrupt;
    };
    // Damage spoils all that is read with it: what stands before it is found by halving, and delivered first.
    for (auto bad = *end; damaged(all) && line_.empty() && bad - scanned_ > 1;) {
        auto middle = scanned_ + (bad - scanned_) / 2;
        auto part = read_on(middle);
        if (damaged(part))
            bad = middle;
        else if (!part || !*part)
            all = std::move(part);
    }
    if (!line_.empty()) return true;
    cursor_ = scanned_;
    if (!all) {
        blocker_ = damaged(all) ? Blocker::unreadable : Blocker::none;
        fail(all.error().error.text(), {}, false, now);
    } else if (!*all) {
        std::lock_guard lock(mutex_);
        news_ = true;  // there is more to pass
    } else {
        nothing_waits(now);
    }
    return false;
}

// Puts into the line what is wanted of the events behind scanned_. True: there are no more up to `end`.
journal::StoreResult<bool> SinkRunner::read_on(journal::Seq end) {
    journal::Filter filter;
    filter.after = scanned_;
    filter.up_to = end;
    filter.types = config_.selection.types;
    auto everything = config_.selection.everything();
    std::size_t looked = 0, bytes = 0;
    bool all = true;
    auto read = reader_->query(filter, [&](const event::Event& event) {
        scanned_ = event.seq;
        if (everything || config_.selection.takes(event)) {
            auto& lent = line_.emplace_back();
            lent.event = event;
            auto& prefix = prefixes_.of(event.seq);
            lent.id = fmt::format("{}{}", prefix, event.seq);
            sink::append_payload(lent.payload, event, prefix, config_.shape);
            bytes += lent.payload.size();
        }
        all = line_.size() < config_.batch && ++looked < scanned_a_turn && bytes < line_bytes;
        return all;
    });
    if (!read) return tl::unexpected(read.error());
    if (all) scanned_ = end;
    return all;
}

// How many events the rate allows right now.
std::size_t SinkRunner::allowance(Now now) {
    if (config_.max_rate == 0) return config_.batch;
    auto rate = static_cast<double>(config_.max_rate);
    if (tokens_at_ != Steady{})
        tokens_ += rate * std::chrono::duration<double>(now.steady - tokens_at_).count();
    tokens_at_ = now.steady;
    tokens_ = std::min(tokens_, std::max(1.0, std::min(rate, static_cast<double>(config_.batch))));
    if (tokens_ >= 1) return static_cast<std::size_t>(tokens_);
    not_before_ =
        now.steady +
        std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>((1 - tokens_) / rate)) +
        1ms;
    return 0;
}

sink::Outcome SinkRunner::deliver(std::span<const sink::Item> items, const std::stop_token& stop) {
    auto until = link::read_clocks().steady + config_.timeout;
    sink::Outcome outcome;
    try {
        outcome = sink_->deliver(items, {.until = until, .stop = stop});
    } catch (const std::exception& error) {  // a client library's; the sink must not take the gateway with it
        outcome = sink::Outcome::kept(items.size(), error.what());
    }
    if (outcome.fates.size() != items.size())
        outcome = sink::Outcome::kept(items.size(), "the sink did not say what became of each event");
    return outcome;
}

void SinkRunner::offer_line(const std::stop_token& stop) {
    auto allowed = std::min({allowance(link::read_clocks()), config_.batch, line_.size()});
    if (allowed == 0) return;
    std::vector<sink::Item> items;
    items.reserve(allowed);
    for (std::size_t i = 0; i < allowed; ++i)
        items.push_back({&line_[i].event, line_[i].id, line_[i].payload});
    if (failpoint("mark_before_delivery")) {
        delivery_.cursor = line_[allowed - 1].event.seq;
        store_(std::exchange(delivery_, {.sink = config_.name}));
    }
    auto outcome = deliver(items, stop);
    auto now = link::read_clocks();
    if (config_.max_rate != 0) tokens_ -= static_cast<double>(allowed);
    die_at("sink_delivered");  // delivered, and nobody knows
    if (failpoint("kept_is_accepted"))
        std::ranges::replace(outcome.fates, sink::Fate::kept, sink::Fate::accepted);

    std::uint64_t accepted = 0, bytes = 0, rejected = 0, kept = 0;
    auto reason = outcome.reasons.begin();
    std::string refusal;
    std::vector<bool> settled(allowed);
    for (std::size_t i = 0; i < allowed; ++i) {
        auto& lent = line_[i];
        while (reason != outcome.reasons.end() && reason->item < i)
            ++reason;
        switch (outcome.fates[i]) {
            case sink::Fate::accepted:
                ++accepted;
                bytes += lent.payload.size();
                settled[i] = true;
                break;
            case sink::Fate::rejected: {
                auto why =
                    reason != outcome.reasons.end() && reason->item == i ? reason->text : "no reason given";
                if (++lent.tries >= config_.tries) {
                    bury(lent, why, now.wall);
                    ++rejected;
                    settled[i] = true;
                } else {
                    ++kept;
                    refusal = fmt::format("refused ({} of {} tries): {}", lent.tries, config_.tries,
                                          printable(why));
                }
                break;
            }
            case sink::Fate::kept:
                ++kept;
                break;
        }
    }
    std::size_t at = 0;
    std::erase_if(line_, [&](const Lent&) {
        auto place = at++;
        return place < allowed && settled[place];
    });
    cursor_ = line_.empty() ? scanned_ : line_.front().event.seq - 1;
    {
        std::lock_guard lock(mutex_);
        status_.delivered += accepted;
        status_.bytes += bytes;
        status_.rejected += rejected;
        status_.retried += kept;
        if (accepted != 0) status_.last_delivery = now.wall;
    }
    if (kept != 0 && outcome.trouble.empty()) outcome.trouble = refusal;
    settle_trouble(outcome, Blocker::line, accepted + rejected != 0, now);
}

// Dead letters are no part of the line: what is kept of them is offered again, and holds up no event.
void SinkRunner::offer_letters(const std::stop_token& stop) {
    std::vector<journal::DeadLetter> found;
    std::vector<Lent> lent;
    auto now = link::read_clocks();
    auto allowed = std::min({allowance(now), config_.batch, letters_a_turn});
    if (allowed == 0) return;
    while (!letters_.empty() && lent.size() < allowed) {
        auto seq = letters_.front();
        letters_.pop_front();
        std::optional<journal::DeadLetter> letter;
        auto read = reader_->dead_letters(config_.name, seq - 1, [&](const journal::DeadLetter& each) {
            if (each.seq == seq) letter = each;
            return false;
        });
        if (!letter) {
            if (!read) log::warn("sink", "{}: {}", config_.name, read.error().error.text());
            continue;
        }
        auto event = event::parse_event(letter->event);
        if (!event) {
            log::warn("sink", "{}: the dead letter of event {} cannot be read: {}", config_.name, seq,
                      event.error().text());
            continue;
        }
        auto& each = lent.emplace_back();
        each.event = std::move(*event);
        auto& prefix = prefixes_.of(seq);
        each.id = fmt::format("{}{}", prefix, seq);
        sink::append_payload(each.payload, each.event, prefix, config_.shape);
        found.push_back(std::move(*letter));
    }
    if (lent.empty()) return;
    std::vector<sink::Item> items;
    for (auto& each : lent)
        items.push_back({&each.event, each.id, each.payload});
    auto outcome = deliver(items, stop);
    now = link::read_clocks();
    if (config_.max_rate != 0) tokens_ -= static_cast<double>(items.size());
    std::uint64_t accepted = 0, bytes = 0, rejected = 0;
    std::vector<journal::Seq> kept;
    auto reason = outcome.reasons.begin();
    for (std::size_t i = 0; i < items.size(); ++i) {
        while (reason != outcome.reasons.end() && reason->item < i)
            ++reason;
        if (outcome.fates[i] == sink::Fate::accepted) {
            ++accepted;
            bytes += lent[i].payload.size();
            delivery_.letters_gone.push_back(found[i].seq);
        } else if (outcome.fates[i] == sink::Fate::rejected) {
            ++rejected;
            lent[i].tries = found[i].tries + 1;
            bury(lent[i],
                 reason != outcome.reasons.end() && reason->item == i ? reason->text : "no reason given",
                 now.wall);
        } else {
            kept.push_back(found[i].seq);
        }
    }
    letters_.insert(letters_.begin(), kept.begin(), kept.end());
    if (!kept.empty()) letters_at_ = now.steady + config_.retry_max;
    {
        std::lock_guard lock(mutex_);
        status_.delivered += accepted;
        status_.bytes += bytes;
        status_.rejected += rejected;
        status_.retried += kept.size();
        if (accepted != 0) status_.last_delivery = now.wall;
    }
    settle_trouble(outcome, Blocker::letter, accepted + rejected != 0, now);
    leave_progress(now, true);
}

void SinkRunner::bury(const Lent& lent, std::string reason, Wall now) {
    if (failpoint("refused_is_forgotten")) return;
    journal::DeadLetter letter;
    letter.sink = config_.name;
    letter.seq = lent.event.seq;
    letter.time = now;
    letter.tries = std::max<std::uint64_t>(lent.tries, 1);
    letter.reason = printable(reason.substr(0, longest_reason));
    event::append_json(letter.event, lent.event, prefixes_.of(lent.event.seq));
    ++unsaid_rejects_;
    auto steady = link::read_clocks().steady;
    if (steady >= rejects_said_) {
        log::warn("sink", "{}: {} refused; the last, {}: {}", config_.name,
                  unsaid_rejects_ == 1 ? "1 event" : fmt::format("{} events", unsaid_rejects_), lent.id,
                  letter.reason);
        unsaid_rejects_ = 0;
        rejects_said_ = steady + say_refused_every;
    }
    delivery_.letters.push_back(std::move(letter));
}

}  // namespace gantry::gateway
