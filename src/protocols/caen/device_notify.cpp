#include "protocols/caen/device_notify.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <unordered_set>
#include <utility>

#include "protocols/caen/device_call.hpp"

namespace gantry::caen {

// How many there may be is not published.
static constexpr std::size_t max_triggers = 16, max_channels = 8;
static constexpr std::uint32_t max_period_ms = 86'400'000;

Notifier::Notifier(const DeviceOptions& options, ReaderMemory& memory)
    : memory_(memory),
      redial_(options.settings.duration("redial")),
      capacity_(static_cast<std::size_t>(options.settings.number("channel_buffer"))),
      next_seed_(options.seed + 1),
      sources_(memory.model.sources) {}

void Notifier::restart() {
    for (auto& channel : channels_) {
        gone(*channel);
        channel->end();
    }
    channels_.clear();
    triggers_.clear();
    sources_ = std::vector<Source>(memory_.model.sources);
}

void Notifier::overflow() {
    overflow_next_ = channels_.empty();
    for (auto& channel : channels_)
        channel->overflow();
}

bool Notifier::speaks() const {
    return std::ranges::any_of(channels_, [](auto& channel) { return channel->connected(); });
}

Result<void> Notifier::inject(const FaultCall& call) {
    if (call.word == faults::slow.word) slow_ = call.value.empty() ? "on" : call.value;
    for (auto& channel : channels_)
        if (auto done = channel->inject(call); !done) return done;
    return {};
}

std::uint64_t Notifier::dropped() const {
    auto sum = dropped_before_;
    for (auto& channel : channels_)
        sum += channel->dropped();
    return sum;
}

// --- time --------------------------------------------------------------------------------------------------

std::optional<Steady> Notifier::deadline() const {
    std::optional<Steady> due;
    for (auto& trigger : triggers_)
        if (!due || trigger.next < *due) due = trigger.next;
    return due;
}

void Notifier::time_passed(Now now) {
    static constexpr auto late = 10s;  // triggers missed longer ago than this are not made up for
    for (;;) {
        auto next = std::ranges::min_element(triggers_, {}, &Trigger::next);
        if (next == triggers_.end() || next->next > now.steady) return;
        auto at = next->next;
        next->next = at + next->period;
        if (next->next + late < now.steady) next->next = now.steady + next->period;
        fire(*next, at, now);
    }
}

static bool contains(const std::vector<std::string>& names, std::string_view name) {
    return std::ranges::find(names, name) != names.end();
}

void Notifier::fire(const Trigger& trigger, Steady at, Now now) {
    for (std::size_t i = 0; i < sources_.size(); ++i)
        if (contains(sources_[i].triggers, trigger.name)) read(i, at);
    for (auto& channel : channels_)
        if (contains(channel->triggers, trigger.name)) channel->report(now);
}

// One read cycle.
void Notifier::read(std::size_t source, Steady at) {
    std::vector<AirSighting> heard;
    for (auto point : memory_.points_of(source))
        memory_.listen(point, source, {}, at - still_there, at, heard);
    std::unordered_set<event::TagId, event::TagIdHash> seen;
    std::vector<event::TagId> tags;
    for (auto& sighting : heard)
        if (seen.insert(sighting.tag).second) tags.push_back(sighting.tag);
    const auto& settings = memory_.ram.sources[source];
    SourceEvents::Rules rules{static_cast<EventMode>(memory_.ram.event_mode),
                              settings[Config::observed_threshold], settings[Config::lost_threshold]};
    std::vector<SourceEvents::Item> happened;
    sources_[source].events.cycle(tags, at, rules, happened);
    for (auto& channel : channels_)
        if ((channel->sources >> source & 1u) != 0)
            for (auto& item : happened)
                channel->add({memory_.time_at(at), item.tag, source, item.event});
}

// --- triggers and channels ---------------------------------------------------------------------------------

struct Period {
    ResultCode result = ResultCode::success;
    std::uint32_t ms = 0;
};
// The form is not published (section 9): a number of milliseconds, or one after "TIMED:".
static Period parse_period(std::string_view type) {
    static constexpr std::string_view prefix = "TIMED:";
    auto upper = [](char c) { return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c; };
    if (type.size() > prefix.size() && std::ranges::equal(type.substr(0, prefix.size()), prefix, {}, upper))
        type.remove_prefix(prefix.size());
    bool numeric = !type.empty() && (type[0] == '-' || (type[0] >= '0' && type[0] <= '9'));
    if (!numeric) return {ResultCode::bad_trigger};
    std::uint32_t ms = 0;
    auto [end, error] = std::from_chars(type.data(), type.data() + type.size(), ms);
    if (error != std::errc{} || end != type.data() + type.size() || ms == 0 || ms > max_period_ms)
        return {ResultCode::bad_timer_value};
    return {.ms = ms};
}

ResultCode Notifier::find_trigger(std::string_view name) const {
    if (name.empty()) return ResultCode::invalid_trigger_name;
    return std::ranges::find(triggers_, name, &Trigger::name) == triggers_.end()
               ? ResultCode::trigger_not_found
               : ResultCode::success;
}

Notifier::FoundChannel Notifier::find_channel(std::string_view name) const {
    if (name.empty()) return {ResultCode::invalid_channel_name};
    auto found = std::ranges::find(channels_, name, &NotifyChannel::name);
    if (found == channels_.end()) return {ResultCode::channel_not_found};
    return {ResultCode::success, found->get()};
}

ResultCode Notifier::allocate_trigger(std::string_view name, std::string_view type, Now now) {
    auto known = find_trigger(name);
    if (known == ResultCode::success) return ResultCode::trigger_name_exists;
    if (known != ResultCode::trigger_not_found) return known;
    auto period = parse_period(type);
    if (period.result != ResultCode::success) return period.result;
    if (triggers_.size() >= max_triggers) return ResultCode::too_many_triggers;
    std::chrono::milliseconds ms{period.ms};
    triggers_.push_back({std::string(name), ms, now.steady + ms});
    return ResultCode::success;
}

ResultCode Notifier::deallocate_trigger(std::string_view name) {
    auto known = find_trigger(name);
    if (known != ResultCode::success) return known;
    bool used =
        std::ranges::any_of(sources_, [&](auto& source) { return contains(source.triggers, name); }) ||
        std::ranges::any_of(channels_, [&](auto& each) { return contains(each->triggers, name); });
    if (used) return ResultCode::trigger_busy;
    std::erase_if(triggers_, [&](auto& trigger) { return trigger.name == name; });
    return ResultCode::success;
}

ResultCode Notifier::allocate_channel(std::string_view name, std::string_view address, Now now) {
    auto found = find_channel(name);
    if (found.result == ResultCode::success) return ResultCode::channel_name_exists;
    if (found.result != ResultCode::channel_not_found) return found.result;
    auto colon = address.rfind(':');
    if (!is_dotted_decimal(address.substr(0, colon))) return ResultCode::bad_address;
    auto digits = colon == std::string_view::npos ? std::string_view{} : address.substr(colon + 1);
    std::uint16_t number = 0;
    auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    if (error != std::errc{} || end != digits.data() + digits.size() || number == 0)
        return ResultCode::bad_port_address;
    if (std::ranges::any_of(channels_, [&](auto& each) { return each->address() == address; }))
        return ResultCode::address_in_use;
    if (channels_.size() >= max_channels) return ResultCode::too_many_channels;
    channels_.push_back(std::make_shared<NotifyChannel>(std::string(name), std::string(address), redial_,
                                                        capacity_, next_seed_++, now));
    auto& channel = *channels_.back();
    (void)channel.inject({faults::slow.word, slow_, now});  // it was understood before
    if (std::exchange(overflow_next_, false)) channel.overflow();
    return ResultCode::success;
}

ResultCode Notifier::deallocate_channel(std::string_view name, Now now) {
    auto found = find_channel(name);
    if (found.result != ResultCode::success) return found.result;
    if (!found.channel->triggers.empty()) return ResultCode::channel_busy;
    found.channel->kill(now);
    gone(*found.channel);
    std::erase_if(channels_, [&](auto& each) { return each.get() == found.channel; });
    return ResultCode::success;
}

std::vector<std::string> Notifier::trigger_names() const {
    std::vector<std::string> names;
    for (auto& trigger : triggers_)
        names.push_back(trigger.name);
    return names;
}

}  // namespace gantry::caen
