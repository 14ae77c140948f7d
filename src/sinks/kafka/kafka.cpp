#include "sinks/kafka/kafka.hpp"

#include <algorithm>
#include <numeric>

#include <fmt/format.h>

#include "base/bytes.hpp"
#include "base/log.hpp"
#include "base/text.hpp"
#include "sinks/kafka/verdict.hpp"

namespace gantry::sinks::kafka {

using std::chrono::steady_clock;

namespace {

constexpr auto slice = 50ms;  // librdkafka's calls know no stop token, so none of them waits longer

bool is_over(const sink::Patience& patience) {
    return patience.over(steady_clock::now());
}

std::string key_of(const event::Event& event, Key key) {
    if (key == Key::tag && event.tag.size != 0) return to_hex(event.tag.view());
    return event.reader;
}

Message message_of(const sink::Item& item, std::string_view key) {
    bool cloud_event = item.payload.starts_with(R"({"specversion":)");
    return {.key = key,
            .value = item.payload,
            .id = item.id,
            .type = event::to_text(item.event->type),
            .schema = "1",
            .content_type = cloud_event ? "application/cloudevents+json" : "application/json"};
}

std::string reason_of(const Report& report) {
    return fmt::format("{} ({})", report.text, report.error);
}

}  // namespace

Retirement::~Retirement() {
    if (thread_.joinable()) thread_.join();
}

void Retirement::begin(std::unique_ptr<Producer> producer) {
    if (thread_.joinable()) thread_.join();
    under_way_ = true;
    thread_ = std::thread([this, producer = std::move(producer)]() mutable {
        producer.reset();
        std::lock_guard lock(mutex_);
        under_way_ = false;
        changed_.notify_all();
    });
}

bool Retirement::wait(const sink::Patience& patience) {
    std::unique_lock lock(mutex_);
    return changed_.wait_until(lock, patience.stop, patience.until, [&] { return !under_way_; });
}

// What is known of a batch on its way.
struct KafkaSink::Delivery {
    std::span<const sink::Item> batch;
    const sink::Patience& patience;
    sink::Outcome outcome;
    std::vector<Report> reports = {};        // not looked at yet
    std::vector<std::size_t> suspects = {};  // a broker refused what they were sent with
    std::string error = {}, suspicion = {};  // the last of each

    std::vector<std::size_t> kept() const {
        std::vector<std::size_t> out;
        for (std::size_t i = 0; i < batch.size(); ++i)
            if (outcome.fates[i] == sink::Fate::kept) out.push_back(i);
        return out;
    }
};

KafkaSink::KafkaSink(Target target) : target_(std::move(target)), batch_bytes_(target_.max_message) {}
KafkaSink::~KafkaSink() = default;

bool KafkaSink::connected() const {
    return producer_ && asked_ && !producer_->away();
}

std::string KafkaSink::no_answer(const sink::Patience& patience) const {
    if (patience.stop.stop_requested()) return "the gateway ends";
    auto why = producer_ ? producer_->last_error() : std::string();
    return fmt::format("no answer from {} in time{}{}", target_.brokers, why.empty() ? "" : ": ",
                       printable(why));
}

std::string KafkaSink::connect(Manner manner, const sink::Patience& patience) {
    if (!target_.warning.empty() && !std::exchange(warned_, true)) log::warn("sink", "{}", target_.warning);
    std::vector<Report> none;
    if (producer_ && manner_ != manner) give_up(none);
    if (!retirement_.wait(patience)) return "the producer before has not ended yet";
    if (!producer_) {
        auto words = target_.words;
        words.emplace_back("batch.size", std::to_string(batch_bytes_));
        // Once a broker has refused a batch, what was sent behind it must not be taken.
        words.emplace_back("enable.gapless.guarantee", manner == Manner::in_order ? "true" : "false");
        auto made = Producer::make(words, target_.topic);
        if (!made) return printable(made.error().text());
        producer_ = std::move(*made);
        manner_ = manner;
        asked_ = false;
    }
    producer_->serve(0ms, none);
    asked_ = asked_ && !producer_->away();
    std::string trouble;
    while (!asked_) {
        constexpr auto longest = 500ms;  // so late is a stop obeyed here: an answer may take long
        auto now = steady_clock::now();
        if (patience.over(now) || producer_->unwelcome())
            return trouble.empty() ? no_answer(patience)
                                   : fmt::format("{}: {}", target_.brokers, printable(trouble));
        auto wait = std::min<std::chrono::milliseconds>(
            longest, std::chrono::ceil<std::chrono::milliseconds>(patience.until - now));
        auto said = producer_->ask(wait);
        asked_ = said.empty();
        // A question that was cut short tells less than the one before.
        if (trouble.empty() || said != Producer::timed_out()) trouble = std::move(said);
        if (!asked_) producer_->serve(slice, none);
    }
    return {};
}

void KafkaSink::take(Delivery& delivery) {
    for (auto& report : delivery.reports) {
        if (report.error.empty()) {
            delivery.outcome.fates[report.item] = sink::Fate::accepted;
        } else if (blames_the_message(report.error)) {
            delivery.suspects.push_back(report.item);
            delivery.suspicion = reason_of(report);
            if (report.error == "MSG_SIZE_TOO_LARGE" && delivery.suspects.size() == 2)
                batch_bytes_ = std::max<std::size_t>(batch_bytes_ / 2, 1000);
        } else if (!report.error.starts_with("_PURGE")) {
            delivery.error = reason_of(report);
        }
    }
    delivery.reports.clear();
}

// Hands all over and waits until all are reported, or patience is over.
void KafkaSink::send(std::span<const std::size_t> items, Delivery& delivery) {
    for (std::size_t i = 0; i < items.size();) {
        auto& item = delivery.batch[items[i]];
        auto key = key_of(*item.event, target_.key);
        Report refusal;
        auto put = producer_->put(message_of(item, key), items[i], refusal);
        if (put == Producer::Put::full) {
            if (is_over(delivery.patience)) break;
            producer_->serve(slice, delivery.reports);
            take(delivery);
            continue;
        }
        ++i;
        if (put != Producer::Put::refused) continue;
        if (!blames_the_message(refusal.error)) {
            delivery.error = reason_of(refusal);
            break;
        }
        delivery.outcome.reject(refusal.item, reason_of(refusal));
    }
    while (producer_->unreported() > 0 && !is_over(delivery.patience)) {
        producer_->serve(slice, delivery.reports);
        take(delivery);
    }
}

// Each must be reported before the next is sent, so the one that is to blame is known, and nothing overtakes.
void KafkaSink::send_alone(std::span<const std::size_t> items, Delivery& delivery) {
    for (auto item : items) {
        delivery.suspects.clear();
        send({&item, 1}, delivery);
        if (!delivery.suspects.empty())
            delivery.outcome.reject(item, delivery.suspicion);
        else if (delivery.outcome.fates[item] == sink::Fate::kept)
            break;
    }
    delivery.suspects.clear();
}

void KafkaSink::give_up(std::vector<Report>& reports) {
    producer_->give_up(reports);
    retirement_.begin(std::move(producer_));
}

sink::Outcome KafkaSink::deliver(std::span<const sink::Item> batch, const sink::Patience& patience) {
    Delivery delivery{batch, patience, sink::Outcome::kept(batch.size(), {})};
    auto& outcome = delivery.outcome;
    std::vector<std::size_t> left = delivery.kept();
    do {
        outcome.trouble = connect(Manner::in_order, patience);
        if (!outcome.trouble.empty() || batch.empty()) break;
        delivery.error.clear();
        send(left, delivery);
        left = delivery.kept();
        if (left.empty()) break;
        auto no_answer_text = no_answer(patience);
        give_up(delivery.reports);
        take(delivery);
        left = delivery.kept();
        if (delivery.suspects.empty()) {
            if (!left.empty())
                outcome.trouble = delivery.error.empty() ? no_answer_text : printable(delivery.error);
            break;
        }
        // All behind the suspects in their partitions is still here, so they go first.
        outcome.trouble = connect(Manner::one_by_one, patience);
        if (!outcome.trouble.empty()) break;
        delivery.error.clear();
        auto suspects = std::exchange(delivery.suspects, {});
        std::ranges::sort(suspects);
        send_alone(suspects, delivery);
        no_answer_text = no_answer(patience);
        give_up(delivery.reports);
        take(delivery);
        left = delivery.kept();
        bool settled = std::ranges::none_of(
            suspects, [&](std::size_t item) { return outcome.fates[item] == sink::Fate::kept; });
        if (!settled) outcome.trouble = delivery.error.empty() ? no_answer_text : printable(delivery.error);
    } while (!left.empty() && outcome.trouble.empty());
    std::ranges::sort(outcome.reasons, {}, &sink::Outcome::Reason::item);
    return outcome;
}

void KafkaSink::idle(const sink::Patience& /*patience*/) {
    std::vector<Report> none;
    if (producer_) producer_->serve(0ms, none);
}

}  // namespace gantry::sinks::kafka
