#include "sinks/mqtt/delivery.hpp"

#include <algorithm>
#include <numeric>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::sinks::mqtt {

using sink::Fate;

// Of as many refusals that leave open whether it is the event, the last is believed.
static constexpr int most_doubts = 3;

Delivery::Delivery(std::span<const sink::Item> batch, const Grouping& grouping, Doubts& doubts)
    : batch_(batch),
      array_(grouping.array),
      doubts_(doubts),
      order_(batch.size()),
      fates_(batch.size(), Fate::kept) {
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    group(grouping);
}

void Delivery::group(const Grouping& grouping) {
    if (!grouping.array) {
        for (std::size_t at = 0; at < order_.size(); ++at)
            waiting_.push_back({at, 1});
        return;
    }
    std::unordered_map<std::string_view, std::size_t> readers;  // in the order in which they first appear
    for (auto& item : batch_)
        readers.try_emplace(item.event->reader, readers.size());
    auto reader = [&](std::size_t item) { return readers.at(batch_[item].event->reader); };
    std::ranges::stable_sort(order_, {}, reader);
    std::size_t bytes = 0;
    for (std::size_t at = 0; at < order_.size(); ++at) {
        auto size = batch_[order_[at]].payload.size() + 1;
        bool fits = !waiting_.empty() && waiting_.back().count < grouping.array_size &&
                    bytes + size < grouping.array_bytes && reader(order_[at]) == reader(order_[at - 1]);
        if (fits) {
            ++waiting_.back().count;
            bytes += size;
        } else {
            waiting_.push_back({at, 1});
            bytes = size;
        }
    }
}

std::size_t Delivery::events_in_flight() const {
    std::size_t events = 0;
    for (auto& [mid, piece] : in_flight_)
        events += piece.count;
    return events;
}

Delivery::Message Delivery::next(bool alone) {
    next_ = waiting_.front();
    waiting_.pop_front();
    if (alone && next_.count > 1) {
        waiting_.push_front({next_.first + 1, next_.count - 1});
        next_.count = 1;
    }
    auto& first = batch_[order_[next_.first]];
    if (!array_) return {first.event->reader, first.payload};
    payload_ = '[';
    for (std::size_t i = 0; i < next_.count; ++i) {
        if (i != 0) payload_ += ',';
        payload_ += batch_[order_[next_.first + i]].payload;
    }
    payload_ += ']';
    return {first.event->reader, payload_};
}

void Delivery::sent(int mid) {
    in_flight_[mid] = next_;
}

void Delivery::refused(std::string why) {
    reject(next_, std::move(why));
}

void Delivery::unsent() {
    waiting_.push_front(next_);
}

// Of several events one may be to blame: each half is tried by itself.
void Delivery::reject(Piece piece, std::string why) {
    if (piece.count > 1) {
        auto half = piece.count / 2;
        waiting_.push_front({piece.first + half, piece.count - half});
        waiting_.push_front({piece.first, half});
        return;
    }
    auto item = order_[piece.first];
    fates_[item] = Fate::rejected;
    rejected_[item] = std::move(why);
}

bool Delivery::settle(int mid, std::uint8_t code, std::string_view said) {
    auto found = in_flight_.find(mid);
    if (found == in_flight_.end()) return false;
    auto piece = found->second;
    in_flight_.erase(found);
    auto answer = reason_text(code, said);
    auto& first = batch_[order_[piece.first]];
    switch (puback_verdict(code)) {
        case Verdict::accepted:
            for (std::size_t i = 0; i < piece.count; ++i)
                fates_[order_[piece.first + i]] = Fate::accepted;
            accepted_ += piece.count;
            break;
        case Verdict::rejected:
            reject(piece, fmt::format("the broker refused it: {}", answer));
            break;
        case Verdict::kept:
            stop(fmt::format("the broker does not take {}: {}", printable(first.id), answer));
            break;
        case Verdict::doubtful:
            if (piece.count > 1) {
                reject(piece, answer);
                break;
            }
            doubted_[std::string(first.id)] = doubts_[std::string(first.id)] + 1;
            if (trouble_.empty())
                trouble_ = fmt::format("the broker does not take {}: {}", printable(first.id), answer);
            break;
    }
    return true;
}

void Delivery::stop(std::string trouble) {
    if (stopped_) return;
    stopped_ = true;
    trouble_ = std::move(trouble);
}

std::string_view Delivery::suspect() const {
    if (in_flight_.size() != 1 || in_flight_.begin()->second.count != 1) return {};
    return batch_[order_[in_flight_.begin()->second.first]].id;
}

void Delivery::reject_suspect(std::string why) {
    auto piece = in_flight_.begin()->second;
    in_flight_.clear();
    reject(piece, std::move(why));
}

sink::Outcome Delivery::outcome() {
    sink::Outcome out{.fates = std::move(fates_)};
    // It was not the broker, which took others meanwhile: then it is the event.
    for (std::size_t item = 0; item < batch_.size(); ++item) {
        auto doubt = doubted_.find(batch_[item].id);
        if (doubt == doubted_.end() || doubt->second < most_doubts || accepted_ == 0) continue;
        out.fates[item] = Fate::rejected;
        rejected_[item] = fmt::format("the broker refused it {} times and gave no reason", doubt->second);
        doubted_.erase(doubt);
    }
    doubts_ = std::move(doubted_);
    for (auto& [item, why] : rejected_)
        out.reasons.push_back({item, std::move(why)});
    if (std::ranges::find(out.fates, Fate::kept) != out.fates.end()) {
        out.trouble = std::move(trouble_);
        if (out.trouble.empty()) out.trouble = "not all was confirmed in time";
    }
    return out;
}

}  // namespace gantry::sinks::mqtt
