#pragma once
#include <memory>

#include "protocols/caen/device_channel.hpp"
#include "protocols/caen/device_state.hpp"

namespace gantry::caen {

// Triggers and channels: read triggers make sources read by themselves, notify triggers make channels send
// (section 9). All of it is RAM.
class Notifier {
public:
    Notifier(const DeviceOptions& options, ReaderMemory& memory);

    void restart();  // all triggers and channels are gone
    std::optional<Steady> deadline() const;
    void time_passed(Now now);
    std::vector<std::shared_ptr<DialOut>> dial_outs() const { return {channels_.begin(), channels_.end()}; }

    ResultCode allocate_trigger(std::string_view name, std::string_view type, Now now);
    ResultCode deallocate_trigger(std::string_view name);
    ResultCode allocate_channel(std::string_view name, std::string_view address, Now now);
    ResultCode deallocate_channel(std::string_view name, Now now);
    // What a command names, or why that does not exist.
    ResultCode find_trigger(std::string_view name) const;
    struct FoundChannel {
        ResultCode result = ResultCode::success;
        NotifyChannel* channel = nullptr;
    };
    FoundChannel find_channel(std::string_view name) const;
    std::vector<std::string>& read_triggers(std::size_t source) { return sources_[source].triggers; }

    std::vector<std::string> trigger_names() const;
    const std::vector<std::shared_ptr<NotifyChannel>>& channels() const { return channels_; }
    bool speaks() const;                         // over a channel that is connected
    Result<void> inject(const FaultCall& call);  // into the links of all channels
    void overflow();                             // the channels' memory is full: what waits there is lost
    std::uint64_t dropped() const;               // events, of all channels that ever were

private:
    struct Trigger {
        std::string name;
        std::chrono::milliseconds period{};
        Steady next{};
    };
    struct Source {
        std::vector<std::string> triggers;
        SourceEvents events;
    };
    void fire(const Trigger& trigger, Steady at, Now now);
    void read(std::size_t source, Steady at);
    void gone(const NotifyChannel& channel) { dropped_before_ += channel.dropped(); }

    ReaderMemory& memory_;
    const std::chrono::microseconds redial_;
    const std::size_t capacity_;
    std::uint64_t next_seed_;
    std::vector<Trigger> triggers_;
    std::vector<Source> sources_;
    std::vector<std::shared_ptr<NotifyChannel>> channels_;
    std::uint64_t dropped_before_ = 0;
    std::string slow_ = "off";  // also the links of channels that are still to come
    bool overflow_next_ = false;
};

}  // namespace gantry::caen
