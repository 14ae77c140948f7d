// The commands about triggers and channels. To add what is there already changes nothing and is no error.
#include <algorithm>
#include <array>

#include "protocols/caen/device_call.hpp"
#include "protocols/caen/device_notify.hpp"

namespace gantry::caen {

// What a command names of source, trigger and channel, once all of it was found.
struct Named {
    ResultCode result = ResultCode::success;
    std::size_t source = 0;
    NotifyChannel* channel = nullptr;
    std::string trigger = {};
};
static Named named(const Call& call) {
    Named all;
    auto [result, source] = choose_source(call.arguments, call.memory);
    if (result != ResultCode::success) return {result};
    all.source = source;
    if (call.arguments.has(Attribute::channel_name)) {
        auto found = call.notifier.find_channel(call.arguments.text(Attribute::channel_name));
        if (found.result != ResultCode::success) return {found.result};
        all.channel = found.channel;
    }
    if (call.arguments.has(Attribute::trigger_name)) {
        all.trigger = call.arguments.text(Attribute::trigger_name);
        all.result = call.notifier.find_trigger(all.trigger);
    }
    return all;
}

static ResultCode allocate_trigger(Call& call) {
    return call.notifier.allocate_trigger(call.arguments.text(Attribute::trigger_name),
                                          call.arguments.text(Attribute::trigger_type), call.now);
}
static ResultCode deallocate_trigger(Call& call) {
    return call.notifier.deallocate_trigger(call.arguments.text(Attribute::trigger_name));
}
static ResultCode allocate_channel(Call& call) {
    return call.notifier.allocate_channel(call.arguments.text(Attribute::channel_name),
                                          call.arguments.text(Attribute::channel_address), call.now);
}
static ResultCode deallocate_channel(Call& call) {
    return call.notifier.deallocate_channel(call.arguments.text(Attribute::channel_name), call.now);
}

static bool contains(const std::vector<std::string>& names, std::string_view name) {
    return std::ranges::find(names, name) != names.end();
}
static ResultCode add_to(std::vector<std::string>& names, const std::string& name) {
    if (!contains(names, name)) names.push_back(name);
    return ResultCode::success;
}
static ResultCode remove_from(std::vector<std::string>& names, const std::string& name) {
    return std::erase(names, name) != 0 ? ResultCode::success : ResultCode::trigger_not_found;
}

static ResultCode add_read_trigger(Call& call) {
    auto all = named(call);
    if (all.result != ResultCode::success) return all.result;
    return add_to(call.notifier.read_triggers(all.source), all.trigger);
}
static ResultCode remove_read_trigger(Call& call) {
    auto all = named(call);
    if (all.result != ResultCode::success) return all.result;
    return remove_from(call.notifier.read_triggers(all.source), all.trigger);
}
static ResultCode add_notify_trigger(Call& call) {
    auto all = named(call);
    return all.result != ResultCode::success ? all.result : add_to(all.channel->triggers, all.trigger);
}
static ResultCode remove_notify_trigger(Call& call) {
    auto all = named(call);
    return all.result != ResultCode::success ? all.result : remove_from(all.channel->triggers, all.trigger);
}

static ResultCode add_source(Call& call) {
    auto all = named(call);
    if (all.result == ResultCode::success) all.channel->sources |= 1u << all.source;
    return all.result;
}
static ResultCode remove_source(Call& call) {
    auto all = named(call);
    if (all.result != ResultCode::success) return all.result;
    if ((all.channel->sources >> all.source & 1u) == 0) return ResultCode::source_not_in_channel;
    all.channel->sources &= ~(1u << all.source);
    return ResultCode::success;
}
static ResultCode check_source(Call& call) {
    auto all = named(call);
    if (all.result == ResultCode::success)
        append_number(call.answer, Attribute::boolean, all.channel->sources >> all.source & 1u);
    return all.result;
}

static void say_associated(Call& call, bool yes) {
    append_number(call.answer, Attribute::boolean, std::uint32_t{yes == call.memory.associated_is_one});
}
static ResultCode check_source_in_trigger(Call& call) {
    auto all = named(call);
    if (all.result == ResultCode::success)
        say_associated(call, contains(call.notifier.read_triggers(all.source), all.trigger));
    return all.result;
}
// CheckTriggerInChannel and CheckChannelInTrigger look identical (section 12, I6).
static ResultCode check_trigger_and_channel(Call& call) {
    auto all = named(call);
    if (all.result == ResultCode::success) say_associated(call, contains(all.channel->triggers, all.trigger));
    return all.result;
}

static ResultCode get_triggers(Call& call) {
    auto names = call.notifier.trigger_names();
    append_number(call.answer, Attribute::no_of_triggers, names.size());
    for (auto& name : names)
        append_text(call.answer, Attribute::trigger_name, name);
    return ResultCode::success;
}
static ResultCode get_channels(Call& call) {
    auto& channels = call.notifier.channels();
    append_number(call.answer, Attribute::no_of_channels, channels.size());
    for (auto& channel : channels)
        append_text(call.answer, Attribute::channel_name, channel->name());
    return ResultCode::success;
}

static constexpr std::array notify_rows = {
    HandlerRow{Command::allocate_trigger, allocate_trigger},
    HandlerRow{Command::deallocate_trigger, deallocate_trigger},
    HandlerRow{Command::allocate_channel, allocate_channel},
    HandlerRow{Command::deallocate_channel, deallocate_channel},
    HandlerRow{Command::add_read_trigger, add_read_trigger},
    HandlerRow{Command::remove_read_trigger, remove_read_trigger},
    HandlerRow{Command::add_notify_trigger, add_notify_trigger},
    HandlerRow{Command::remove_notify_trigger, remove_notify_trigger},
    HandlerRow{Command::add_source_to_channel, add_source},
    HandlerRow{Command::remove_source_from_channel, remove_source},
    HandlerRow{Command::check_source_in_channel, check_source},
    HandlerRow{Command::check_source_in_trigger, check_source_in_trigger},
    HandlerRow{Command::check_trigger_in_channel, check_trigger_and_channel},
    HandlerRow{Command::check_channel_in_trigger, check_trigger_and_channel},
    HandlerRow{Command::get_triggers, get_triggers},
    HandlerRow{Command::get_channels, get_channels},
};

std::span<const HandlerRow> notify_handlers() {
    return notify_rows;
}

}  // namespace gantry::caen
