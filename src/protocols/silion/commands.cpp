#include "protocols/silion/commands.hpp"

#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "base/error.hpp"

namespace gantry::silion {

using Status = JobResult::Status;

static constexpr std::chrono::seconds usual_patience{5};
static constexpr std::uint16_t max_output = 5;     // gen 1 has four and refuses the fifth itself
static constexpr std::uint32_t max_seconds = 254;  // 255 means another thing to each generation

static Result<Bytes> outputs_data(const SetOutputs& job, std::chrono::seconds& longest) {
    if (job.changes.empty()) return fail("no output is named", "name one, as in 1=on");
    std::array<bool, max_output + 1> named{};
    Bytes data;
    data.push_back(static_cast<std::uint8_t>(std::min<std::size_t>(job.changes.size(), 255)));
    for (auto& change : job.changes) {
        if (change.output < 1 || change.output > max_output)
            return fail(fmt::format("there is no output {}", change.output),
                        fmt::format("readers of this make have outputs 1 to {}", max_output));
        if (std::exchange(named[change.output], true))
            return fail(fmt::format("output {} is named twice", change.output), "name each output once");
        if (change.for_ms % 1000 != 0 || change.for_ms / 1000 > max_seconds)
            return fail(fmt::format("output {} for {} ms", change.output, change.for_ms),
                        fmt::format("this make times outputs in whole seconds, 1 s to {} s, or not at all",
                                    max_seconds));
        auto seconds = change.for_ms / 1000;
        data.push_back(static_cast<std::uint8_t>(change.output));
        data.push_back(change.state ? 1 : 0);
        data.push_back(static_cast<std::uint8_t>(seconds));
        longest = std::max(longest, std::chrono::seconds{seconds});
    }
    return data;
}

Commands::Slot& Commands::slot(Code code) {
    return *std::ranges::find(slots_, code, &Slot::code);
}

void Commands::allow(Now now) {
    allowed_ = true;
    for (auto& slot : slots_)
        next(slot, now);
}

void Commands::run(const JobOrder& order, const Job& job, Now now) {
    // What may be sent again (never a timed output) does no more than it did: no need to look first.
    auto id = order.id;
    Code code = Code::get_inputs;
    Waiting waiting{
        .id = id, .deadline = order.deadline, .data = {}, .patience = usual_patience, .silence = {}};
    if (auto* set = std::get_if<SetOutputs>(&job)) {
        code = Code::set_outputs;
        auto data = outputs_data(*set, waiting.silence);
        if (!data) {
            end(id, Status::unsupported, data.error().text());
            return;
        }
        waiting.data = std::move(*data);
        // Gen 1 answers only when the longest timed output is over (section 9).
        waiting.patience += waiting.silence;
    } else if (std::holds_alternative<RestartReader>(job)) {
        code = Code::restart;
    } else if (!std::holds_alternative<GetInputs>(job)) {
        end(id, Status::unsupported, "this make has no such command");
        return;
    }
    slot(code).waiting.push_back(std::move(waiting));
    next(slot(code), now);
}

void Commands::next(Slot& slot, Now now) {
    if (!allowed_ || slot.under_way || slot.waiting.empty()) return;
    auto waiting = std::move(slot.waiting.front());
    slot.waiting.pop_front();
    slot.under_way = UnderWay{waiting.id, waiting.deadline, now.steady + waiting.patience};
    if (waiting.silence.count() > 0) silent_until_ = std::max(silent_until_, now.steady + waiting.patience);
    send_(slot.code, waiting.data);
}

void Commands::cancel(JobId id, Now) {
    for (auto& slot : slots_) {
        auto waiting = std::ranges::find(slot.waiting, id, &Waiting::id);
        if (waiting != slot.waiting.end()) {
            slot.waiting.erase(waiting);
            end(id, Status::cancelled, "cancelled before it was sent");
            return;
        }
        if (slot.under_way && slot.under_way->id == id) {
            slot.under_way->id.reset();
            end(id, Status::unknown, "cancelled after it was sent: the reader may have done it");
            return;
        }
    }
}

void Commands::end(JobId job, Status status, std::string text) {
    JobResult result;
    result.status = status;
    result.text = std::move(text);
    ended_(job, std::move(result));
}

static JobResult inputs_result(ByteView data) {
    wire::Fields fields;
    wire::Reader in(data);
    wire::decode(find_message(static_cast<std::uint8_t>(Code::get_inputs), wire::Direction::to_host)->layout,
                 in, fields);
    if (in.fault())
        return {.status = Status::failed,
                .text = fmt::format("the reader's answer cannot be read: {}", in.fault()->text()),
                .values = {}};
    wire::Value::List inputs;
    for (auto& item : *fields[0].value.get<wire::Value::List>()) {
        auto& record = *item.get<wire::Fields>();
        wire::Fields input;
        input.push_back({"input", record[0].value});
        input.push_back({"state", wire::Value(*record[1].value.get<std::int64_t>() != 0)});
        inputs.emplace_back(std::move(input));
    }
    JobResult result;
    result.values.push_back({"inputs", wire::Value(std::move(inputs))});
    return result;
}

bool Commands::answered(Code code, std::uint32_t status, ByteView data, Now now) {
    auto& of = slot(code);
    if (!of.under_way) return false;
    auto job = of.under_way->id;
    of.under_way.reset();
    if (job) {
        JobResult result;
        if (status != 0) {
            auto said = describe_status(status);
            result.status = Status::failed;
            result.text = fmt::format("the reader answered {}: {}", said.code, said.text);
        } else if (code == Code::get_inputs) {
            result = inputs_result(data);
        }
        ended_(*job, std::move(result));
    }
    next(of, now);
    return true;
}

void Commands::time_passed(Now now) {
    for (auto& slot : slots_) {
        if (auto& sent = slot.under_way) {
            if (sent->id && now.steady >= std::min(sent->deadline, sent->answer_due)) {
                ++timeouts_;
                end(*std::exchange(sent->id, {}), Status::timed_out,
                    "the reader did not answer: what it did is not known");
            }
            // A late answer belongs to the command that was given up, not to the next of its kind.
            if (now.steady >= sent->answer_due) sent.reset();
        }
        for (std::size_t i = 0; i < slot.waiting.size();) {
            if (now.steady < slot.waiting[i].deadline) {
                ++i;
                continue;
            }
            auto id = slot.waiting[i].id;
            slot.waiting.erase(slot.waiting.begin() + static_cast<std::ptrdiff_t>(i));
            end(id, Status::cancelled, "never sent: the reader was still busy with the command before it");
        }
        next(slot, now);
    }
}

std::optional<Steady> Commands::deadline() const {
    std::optional<Steady> due;
    auto sooner = [&](Steady at) { due = due ? std::min(*due, at) : at; };
    for (auto& slot : slots_) {
        if (slot.under_way) {
            sooner(slot.under_way->answer_due);
            if (slot.under_way->id) sooner(slot.under_way->deadline);
        }
        for (auto& waiting : slot.waiting)
            sooner(waiting.deadline);
    }
    return due;
}

void Commands::link_lost() {
    for (auto& slot : slots_) {
        if (slot.under_way && slot.under_way->id)
            end(*slot.under_way->id, Status::unknown, "the link broke before the reader answered");
        slot.under_way.reset();
        for (auto& waiting : std::exchange(slot.waiting, {}))
            end(waiting.id, Status::cancelled, "never sent: the link is gone");
    }
}

}  // namespace gantry::silion
