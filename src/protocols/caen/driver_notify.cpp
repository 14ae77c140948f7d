#include "protocols/caen/driver_notify.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace gantry::caen {

static constexpr std::uint64_t max_astray = 64 * 1024;
static constexpr std::uint8_t event_lost = 4, event_purged = 5;
static constexpr std::int64_t no_event = 2;  // EventMode: every read is notified (section 9)
static constexpr std::size_t kept_of_a_frame = 256;
static constexpr std::chrono::minutes between_same_faults{1};

static Request with_source(Command command, const Source& source, Attribute attribute,
                           std::string_view name) {
    Request request(command);
    request.text(Attribute::source_name, source.name).text(attribute, name);
    return request;
}
static Request in_channel(Command command, std::string_view trigger) {
    Request request(command);
    request.text(Attribute::channel_name, channel).text(Attribute::trigger_name, trigger);
    return request;
}

NotifyTask::NotifyTask(const DriverOptions& options, const ReaderState& reader, bool only_remove) {
    remove(reader);
    if (!only_remove) make(options, reader);
}

// In the reverse order of making. What is not there is refused, and that is fine.
void NotifyTask::remove(const ReaderState& reader) {
    auto add = [&](Request request) { steps_.push_back({.request = std::move(request), .must = false}); };
    for (auto& source : reader.sources)
        add(with_source(Command::remove_read_trigger, source, Attribute::trigger_name, read_trigger));
    add(in_channel(Command::remove_notify_trigger, notify_trigger));
    for (auto& source : reader.sources)
        add(with_source(Command::remove_source_from_channel, source, Attribute::channel_name, channel));
    add(Request(Command::deallocate_channel).text(Attribute::channel_name, channel));
    for (auto trigger : {read_trigger, notify_trigger})
        add(Request(Command::deallocate_trigger).text(Attribute::trigger_name, trigger));
}

// How a period is written in TriggerType is not published; a plain number of ms is what the maker's demo
// passes to its own library.
void NotifyTask::add_trigger(std::string_view name, std::chrono::microseconds period) {
    Request request(Command::allocate_trigger);
    request.text(Attribute::trigger_name, name);
    request.text(Attribute::trigger_type,
                 fmt::format("{}", std::chrono::ceil<std::chrono::milliseconds>(period).count()));
    steps_.push_back({.request = std::move(request), .other_type = name, .period = period});
}

void NotifyTask::make(const DriverOptions& options, const ReaderState& reader) {
    auto& settings = options.settings;
    auto add = [&](Request request) { steps_.push_back({.request = std::move(request)}); };
    // In the other modes a tag that stays is told once, and presence would take it for gone.
    add(Request(Command::set_event_mode).number(Attribute::event_mode, no_event));
    // The order of the maker's demo.
    add_trigger(notify_trigger, settings.duration("notify_period"));
    add_trigger(read_trigger, settings.duration("notify_read"));
    add(Request(Command::allocate_channel)
            .text(Attribute::channel_name, channel)
            .text(Attribute::channel_address, options.notify_at));
    for (auto& source : reader.sources)
        add(with_source(Command::add_source_to_channel, source, Attribute::channel_name, channel));
    add(in_channel(Command::add_notify_trigger, notify_trigger));
    for (auto& source : reader.sources)
        add(with_source(Command::add_read_trigger, source, Attribute::trigger_name, read_trigger));
}

std::optional<Request> NotifyTask::next(Now) {
    if (steps_.empty()) return {};
    return steps_.front().request;
}

void NotifyTask::answered(const Reply& reply, Now) {
    auto step = std::move(steps_.front());
    steps_.pop_front();
    if (reply.ok() || !step.must) return;
    if (!step.other_type.empty() && !reply.silent && !reply.lacks()) {
        Request request(Command::allocate_trigger);
        request.text(Attribute::trigger_name, step.other_type);
        request.text(
            Attribute::trigger_type,
            fmt::format("TIMED:{}", std::chrono::ceil<std::chrono::milliseconds>(step.period).count()));
        steps_.push_front({.request = std::move(request)});
        return;
    }
    refused_ = fmt::format("{} answered {}", step.request.name(), reply.words());
    steps_.clear();
}

// --- the reader's link -------------------------------------------------------------------------------------

void Notifications::start(Now now) {
    started_ = now.steady;
    framer_ = Framer(to_host_head, true);
    counted_ = {};
    astray_ = 0;
    connected_ = true;
    finished_ = false;
}

void Notifications::link_lost(Now now) {
    if (!finished_) take_rest(now);
    connected_ = false;
    drop_output();
}

// A message that the link broke off: its whole tags were read, and nobody sends them again.
void Notifications::take_rest(Now now) {
    auto rest = framer_.rest();
    if (rest.empty()) return;
    auto header = read_header(rest);
    AvpReader pairs(header ? rest.subspan(header_size) : ByteView{});
    auto first = pairs.next();
    if (first && first->is(Attribute::command_name)) {
        // A tag ends with its event; where none is said, all whole pairs count.
        std::size_t events = 0, whole = pairs.offset() - header_size;
        while (auto pair = pairs.next()) {
            whole = pairs.offset() - header_size;
            if (pair->is(Attribute::event_type)) events = whole;
        }
        if (events > 0) whole = events;
        take_tags(rest.subspan(header_size, whole), rest, now);
    } else {
        count_(gantry::Count::skipped_bytes, rest.size());
    }
    framer_.reset();
    reports_.flush();
}

void Notifications::received(ByteView bytes, Now now) {
    if (finished_) return;
    count_(gantry::Count::bytes, bytes.size());
    framer_.add(bytes);
    while (!finished_) {
        auto item = framer_.next();
        check_stream();
        if (!item || finished_) break;
        if (item->what == Framer::What::message)
            on_message(item->bytes, now);
        else
            framer_.stream_over();  // no framed stream is spoken here
    }
    reports_.flush();
}

void Notifications::check_stream() {
    auto& tally = framer_.tally();
    count_(gantry::Count::frames, tally.messages - counted_.messages);
    count_(gantry::Count::skipped_bytes, tally.skipped_bytes - counted_.skipped_bytes);
    count_(gantry::Count::resyncs, tally.resyncs - counted_.resyncs);
    astray_ += tally.skipped_bytes - counted_.skipped_bytes;
    if (tally.messages != counted_.messages) astray_ = 0;
    counted_ = tally;
    if (astray_ > max_astray) finished_ = true;
}

// A first pair that can be a NotifyMessage, with more behind it, is a report, whatever its value; alone it is
// the end of the channel.
void Notifications::on_message(ByteView message, Now now) {
    auto pairs = message.subspan(header_size);
    AvpReader reader(pairs);
    auto first = reader.next();
    if (first && first->value.size() == 2 && reader.offset() == message.size()) {
        killed_ = finished_ = true;
        return;
    }
    if (!first || !first->is(Attribute::command_name)) {
        count_(gantry::Count::unknown_code, 1);
        return;
    }
    take_tags(pairs, message, now);
}

void Notifications::take_tags(ByteView pairs, ByteView message, Now now) {
    auto& report = reports_.open_for_tags(now);
    events_.clear();
    walker_.restart();
    auto from = report.observations.size();
    auto walked = walker_.walk(pairs, header_size, report.observations, report.data, &events_);
    // Lost and purged are the reader's own presence, not reads: it does not see the tag.
    std::size_t kept = from;
    for (std::size_t i = from; i < report.observations.size(); ++i) {
        auto event = i - from < events_.size() ? events_[i - from] : std::uint8_t{0};
        if (event == event_lost || event == event_purged) continue;
        report.observations[kept++] = report.observations[i];
    }
    count_(gantry::Count::departures, report.observations.size() - kept);
    report.observations.resize(kept);
    count_(gantry::Count::reads, kept - from);
    reports_.take_times(report, from);
    if (!walked.fault && walked.unusable == 0) return;
    count_(gantry::Count::malformed, 1);
    malformed(walked.fault ? fmt::format("malformed notification: {}", walked.fault->text())
                           : std::string("a tag with an empty or too long id"),
              message, now);
}

// What a reader does wrong it does in every message: once a minute is enough.
void Notifications::malformed(std::string text, ByteView message, Now now) {
    if (fault_at_ && now.steady < *fault_at_ + between_same_faults) {
        ++faults_unsaid_;
        return;
    }
    fault_at_ = now.steady;
    if (auto unsaid = std::exchange(faults_unsaid_, 0); unsaid > 0)
        text += fmt::format("; {} more messages were malformed since the last such fault", unsaid);
    auto some = message.first(std::min(message.size(), kept_of_a_frame));
    reports_.notice(FaultNotice{fault_malformed, std::move(text), Bytes(some.begin(), some.end())}, now);
}

}  // namespace gantry::caen
