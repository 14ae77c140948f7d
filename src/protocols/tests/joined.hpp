#pragma once
#include <algorithm>
#include <memory>

#include "field/field.hpp"
#include "protocols/registry.hpp"
#include "reader/faults.hpp"

// A driver and a virtual reader of any make, joined in memory on virtual time by one of the ways that the
// make has, as a gateway and a device host would join them: a link that ends comes back.
namespace gantry::protocols::test {

using Given = std::vector<std::pair<std::string, std::string>>;

struct Way {
    const Plugin* plugin = nullptr;
    const Scheme* scheme = nullptr;
    bool notify = false;  // tags come over a second link, which the reader dials

    std::string name() const { return std::string(scheme->name) + (notify ? " with notifications" : ""); }
    bool serial() const { return scheme->kind == LinkKind::serial; }
    bool is(std::string_view make) const { return plugin->name == make; }
};
inline std::vector<Way> ways() {
    std::vector<Way> all;
    for (auto* plugin : plugins())
        for (auto& scheme : plugin->schemes) {
            all.push_back({plugin, &scheme});
            if (plugin->notifies && scheme.kind == LinkKind::dial) all.push_back({plugin, &scheme, true});
        }
    return all;
}

struct JoinedOptions {
    Given driver = {}, device = {};
    std::vector<std::string> faults = {};  // from the start
    std::size_t piece = 0;                 // bytes that arrive together; 0: all
};

class Joined {
public:
    explicit Joined(const Way& way, JoinedOptions options = {}) : way_(way), options_(std::move(options)) {
        auto& plugin = *way.plugin;
        auto settings = device_settings();
        auto kind =
            plugin.device_tags != nullptr ? plugin.device_tags(settings) : event::Technology::epc_gen2;
        bool hf = kind == event::Technology::iso15693 || kind == event::Technology::icode1;
        auto& air = field_.add_reader("reader", hf ? 1 : 4);
        for (auto& tag : hf ? field::default_hf_tags(kind) : field::default_tags()) {
            auto placed = tag;
            placed.antenna = 1;
            // Its last byte is the CRC8 "i-code" of the others.
            if (hf) placed.tag.user = *from_hex("0012341F");
            if (hf) placed.tag.user.resize(112);
            field_.place(air, placed);
        }
        device = plugin.make_device({.name = "reader", .seed = 5, .settings = settings}, air);
        device->power_on(now);
        next_link_ = now.steady;
        for (auto& fault : options_.faults)
            refused = device->inject(fault, now) ? refused : fault;
    }

    template <class Condition>
    bool until(Condition condition, std::chrono::seconds most) {
        for (auto end = now.steady + most; !condition();) {
            if (now.steady >= end) return false;
            step();
        }
        return true;
    }
    void run_for(std::chrono::milliseconds time) {
        for (auto end = now.steady + time; now.steady < end;)
            step(end);
    }
    // Does it as the host does: what comes of it goes out at once.
    Result<void> inject(std::string_view command) {
        auto done = device->inject(command, now);
        pass();
        return done;
    }

    std::int64_t state(std::string_view name) const {
        auto fields = device->state();
        const auto* value = wire::find(fields, name);
        return value == nullptr ? -1 : wire::as_number(*value).value_or(-1);
    }
    // Of all drivers that ever were.
    std::uint64_t count(Count which) const {
        auto at = static_cast<std::size_t>(which);
        return counted_[at] + (driver ? driver->counters()[at] : 0);
    }
    // Signs for the driver that something was wrong with what it got.
    std::uint64_t trouble() const {
        std::uint64_t all = links;
        for (auto which : {Count::bad_checksum, Count::bad_length, Count::malformed, Count::unknown_code,
                           Count::skipped_bytes, Count::resyncs, Count::timeouts})
            all += count(which);
        return all;
    }

    std::unique_ptr<Device> device;
    std::unique_ptr<Driver> driver;
    Now now{Steady{} + 1h, Wall{} + std::chrono::hours(24 * 365 * 50)};
    std::string refused;                 // of the faults from the start
    std::uint64_t reads = 0, bytes = 0;  // that came from the device
    std::uint64_t links = 0;             // that have ended, the device's own beside it not counted
    std::uint64_t side_links = 0;        // the same of those
    bool lose_byte = false;              // one of the next that the device says
    std::vector<std::chrono::microseconds> clock_set;
    std::uint64_t overflows = 0;
    std::optional<std::chrono::microseconds> reader_ahead;  // of our time, in the last read that says

private:
    bool device_dials() const { return way_.scheme->kind == LinkKind::listen; }

    Settings device_settings() const {
        auto given = options_.device;
        if (device_dials() && !way_.plugin->dial_setting.empty())
            given.emplace_back(way_.plugin->dial_setting, "127.0.0.1:1");
        for (auto& row : way_.plugin->device_settings)
            if (way_.serial() && row.kind == SettingRow::Kind::boolean &&
                (row.name == "serial" || row.name == "serial_line"))
                given.emplace_back(row.name, "true");
        return *Settings::make(way_.plugin->device_settings, given);
    }

    void begin_device() {
        device->start(now);
        device_up_ = true;
    }
    void begin() {
        DriverOptions options{.settings = *Settings::make(way_.plugin->driver_settings, options_.driver),
                              .link = way_.scheme->kind};
        if (!device_dials()) options.name = "reader";
        if (way_.notify) options.notify_at = "127.0.0.1:2";
        driver = way_.plugin->make_driver(options);
        next_link_.reset();
        if (!device_dials()) driver->admitted({}, now);
        if (!device_up_) begin_device();
        driver->start(now);
        drain();
    }

    void drain() {
        while (driver && (!driver->signals().empty() || !driver->reports().empty())) {
            for (auto& signal : std::exchange(driver->signals(), {}))
                if (std::holds_alternative<Identified>(signal)) driver->admitted({}, now);
            for (auto& report : std::exchange(driver->reports(), {})) {
                take(report);
                driver->committed(report.ticket, now);
            }
        }
    }
    void take(const Report& report) {
        for (auto& each : report.observations) {
            reads += each.reads;
            if (each.reader_time_us != 0)
                reader_ahead = std::chrono::microseconds(each.reader_time_us - to_us(now.wall));
        }
        for (auto& notice : report.notices) {
            if (const auto* clock = std::get_if<ClockNotice>(&notice)) clock_set.push_back(clock->by);
            overflows += std::holds_alternative<OverflowNotice>(notice) ? 1 : 0;
        }
    }

    bool carry(Party& from, Party* to, bool from_device) {
        Bytes said(from.output().begin(), from.output().end());
        if (said.empty() || (to != nullptr && !to->finished() && !to->wants_input())) return false;
        from.output_sent(said.size());
        if (from_device) bytes += said.size();
        if (from_device && said.size() > 4 && std::exchange(lose_byte, false))
            said.erase(said.begin() + static_cast<std::ptrdiff_t>(said.size() / 2));
        auto piece = options_.piece == 0 ? said.size() : options_.piece;
        for (ByteView left(said); !left.empty(); left = left.subspan(std::min(piece, left.size())))
            if (to != nullptr && !to->finished()) {
                to->received(left.first(std::min(piece, left.size())), now);
                drain();
            }
        return true;
    }

    // Bytes both ways until nobody has more to say.
    void pass() {
        for (int turns = 0; turns < 100; ++turns) {
            bool moved = carry(*device, driver.get(), true);
            drain();
            if (driver && device_up_) moved = carry(*driver, device.get(), false) || moved;
            if (channel_up_) {
                moved = carry(*channel_, driver->notifications(), true) || moved;
                moved = carry(*driver->notifications(), channel_.get(), false) || moved;
            }
            if (!moved) break;
        }
        look_for_side_end(false);
        look_for_end();
    }

    void look_for_end() {
        bool driver_ends_it = driver && driver->finished();
        bool device_ends_it = device_up_ && device->finished();
        if (!driver_ends_it && !device_ends_it) return;
        if (driver) {
            look_for_side_end(true);
            driver->link_lost(now);
            drain();
            for (std::size_t i = 0; i < counted_.size(); ++i)
                counted_[i] += driver->counters()[i];
            driver.reset();
            ++links;
            if (!device_dials()) next_link_ = now.steady + 500ms;
        }
        // A reader does not see that the program at the other end of its line has gone.
        if (way_.serial() && !device_ends_it) return;
        device_up_ = false;
        device->link_lost(now);
    }

    // The reader's second link.
    void look_for_channel() {
        auto wanted = device->dial_outs();
        if (channel_up_ || !driver || driver->notifications() == nullptr || wanted.empty()) return;
        if (auto at = wanted[0]->dial_at(); !at || *at > now.steady) return;
        channel_ = wanted[0];
        channel_up_ = true;
        driver->notifications()->start(now);
        channel_->start(now);
    }
    void look_for_side_end(bool at_once) {
        if (!channel_up_) return;
        auto* ours = driver->notifications();
        auto wanted = device->dial_outs();
        bool unwanted = std::ranges::find(wanted, channel_) == wanted.end();
        if (!at_once && !unwanted && !ours->finished() && !channel_->finished()) return;
        channel_up_ = false;
        ++side_links;
        ours->link_lost(now);
        channel_->link_lost(now);
        drain();
    }

    void step(Steady end = Steady::max()) {
        auto next = std::min(end, now.steady + 100ms);
        auto sooner = [&](std::optional<Steady> at) {
            if (at) next = std::min(next, *at);
        };
        sooner(device->deadline());
        if (driver) sooner(driver->deadline());
        if (!driver) sooner(device_dials() ? device->dial_at() : next_link_);
        if (channel_up_) sooner(channel_->deadline());
        if (channel_up_) sooner(driver->notifications()->deadline());
        auto passed = std::max<Steady::duration>(next - now.steady, 1ms);
        now = now + std::chrono::ceil<std::chrono::microseconds>(passed);
        device->time_passed(now);
        if (driver) driver->time_passed(now);
        if (channel_up_) channel_->time_passed(now);
        if (channel_up_) driver->notifications()->time_passed(now);
        drain();
        auto due = device_dials() ? device->dial_at() : next_link_;
        if (!driver && due && *due <= now.steady) begin();
        look_for_channel();
        pass();
    }

    const Way way_;
    const JoinedOptions options_;
    field::Field field_;
    bool device_up_ = false, channel_up_ = false;
    std::shared_ptr<DialOut> channel_;
    std::optional<Steady> next_link_;
    Counters counted_{};
};

}  // namespace gantry::protocols::test
