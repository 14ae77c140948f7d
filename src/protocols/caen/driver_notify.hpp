#pragma once
#include <deque>
#include <functional>

#include "protocols/caen/driver_dialog.hpp"
#include "protocols/caen/walker.hpp"
#include "reader/plugin.hpp"

// Notifications (section 9): the reader reads by itself and sends what it saw over a link that it dials.
// Where the public facts end, everything is accepted on receipt.
namespace gantry::caen {

// The names of ours in the reader.
inline constexpr std::string_view channel = "gantry", read_trigger = "gantry-read",
                                  notify_trigger = "gantry-notify";

// Takes away what an earlier run left, then makes triggers and channel and joins them with the sources; or,
// `only_remove`, takes everything away. over() with a text in `refused`: it does not work with this reader.
class NotifyTask final : public Task {
public:
    NotifyTask(const DriverOptions& options, const ReaderState& reader, bool only_remove);
    std::optional<Request> next(Now now) override;
    void answered(const Reply& reply, Now now) override;
    const std::string& refused() const { return refused_; }

private:
    struct Step {
        Request request;
        bool must = true;                  // nothing works without it
        std::string_view other_type = {};  // another way to write the trigger's type
        std::chrono::microseconds period = {};
    };
    void remove(const ReaderState& reader);
    void make(const DriverOptions& options, const ReaderState& reader);
    void add_trigger(std::string_view name, std::chrono::microseconds period);

    std::deque<Step> steps_;
    std::string refused_;
};

// The end of the link that the reader dials.
class Notifications final : public SideParty {
public:
    using Count = std::function<void(gantry::Count which, std::uint64_t by)>;
    Notifications(Reports& reports, Count count) : reports_(reports), count_(std::move(count)) {}

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now) override {}
    std::optional<Steady> deadline() const override { return {}; }
    bool wants_input() const override { return !finished_ && !reports_.full(); }
    bool finished() const override { return finished_; }
    void link_lost(Now now) override;

    void set_technology(event::Technology technology) { walker_.set_technology(technology); }
    bool connected() const { return connected_; }
    bool killed() const { return killed_; }
    bool take_killed() { return std::exchange(killed_, false); }  // the reader ended the channel
    Steady started() const { return started_; }                   // the link that is there, or was

private:
    void on_message(ByteView message, Now now);
    void check_stream();
    void take_rest(Now now);
    void take_tags(ByteView pairs, ByteView message, Now now);
    void malformed(std::string text, ByteView message, Now now);

    Reports& reports_;
    Count count_;
    Framer framer_{to_host_head, true};
    TagWalker walker_;
    Framer::Tally counted_;
    std::uint64_t astray_ = 0;  // skipped bytes since the last message
    bool connected_ = false, finished_ = false, killed_ = false;
    Steady started_{};
    std::optional<Steady> fault_at_;
    std::uint64_t faults_unsaid_ = 0;
    std::vector<std::uint8_t> events_;
};

}  // namespace gantry::caen
