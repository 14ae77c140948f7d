#pragma once
#include <iostream>
#include <map>
#include <memory>
#include <set>

#include "device_support.hpp"
#include "link/memory_link.hpp"
#include "protocols/harting/codec.hpp"
#include "protocols/harting/driver_settings.hpp"
#include "protocols/harting/plugin.hpp"
#include "reader/driver.hpp"

// A driver and the virtual reader, joined in memory on virtual time, with a host around the driver that
// stores what is reported and can be killed. What both get wrong alike is not found here: the vectors and
// the programs of other people are for that.
namespace gantry::harting::driver_test {

using device_test::Bench;
using device_test::tag_1;
using device_test::tag_2;
using device_test::tag_3;
using testkit::hex;
using Given = std::vector<std::pair<std::string, std::string>>;
using JobStatus = JobResult::Status;

struct Plan {
    std::string device = {};  // settings of the virtual reader, "serial=true boot=1s"
    Given driver = {};
    std::string notify_at = {};
    LinkKind link = LinkKind::dial;
};

inline DriverOptions options_of(const Plan& plan) {
    auto settings = Settings::make(driver_settings, plan.driver);
    if (!settings) throw std::invalid_argument(settings.error().text());
    return {
        .settings = *settings, .name = "dock-1", .model = {}, .notify_at = plan.notify_at, .link = plan.link};
}

class Site : public Bench {
public:
    explicit Site(Plan plan) : Bench(plan.device), plan_(std::move(plan)) {
        device.power_on(now);
        run_for(3s);
    }
    // With a tag, and connected unless the reader dials.
    explicit Site(Plan plan, std::string_view tag) : Site(std::move(plan)) {
        places(tag);
        if (plan_.link != LinkKind::listen) connect();
    }

    void connect() {
        driver = plugin.make_driver(options_of(plan_));
        bool listens = plan_.link == LinkKind::listen;
        if (!listens) driver->admitted(known, now);
        tickets_ = 0;
        identified = false;
        link = std::make_unique<link::MemoryLink>(*driver, device, now);
        link->piece = piece;
        link->after_turn = [this] { collect(); };
        link->drop = [this](ByteView bytes, bool from_driver) {
            if (heard) heard(bytes, from_driver);
            return drop && drop(bytes, from_driver);
        };
        link->connect();
        collect();
        driver->deadline();
    }
    void disconnect() {
        lose_side();
        link->cut();
        driver->link_lost(now);
        collect();
        device.link_lost(now);
        link.reset();
    }
    // kill -9 of the gateway, and its next start.
    void kill() {
        driver->signals().clear();
        driver->reports().clear();
        if (side_) channel_->link_lost(now);
        side_.reset();
        link.reset();
        driver.reset();
        device.link_lost(now);
        stored_but_open_.clear();
        known.mark_from_disk = true;
    }
    void run_for(std::chrono::microseconds time) {
        auto end = now + time;
        while (now.steady < end.steady) {
            auto slice = std::min<std::chrono::microseconds>(
                10ms, std::chrono::ceil<std::chrono::microseconds>(end.steady - now.steady));
            if (link) {
                link->run_for(slice);
                now = link->now();
                if (driver->finished()) reasons.emplace_back(driver->finish_reason());
                if (driver->finished() || device.finished()) disconnect();
            } else {
                now = now + slice;
                for (auto due = device.deadline(); due && *due <= now.steady; due = device.deadline())
                    device.time_passed(now);
            }
            if (!link && redials && (plan_.link != LinkKind::listen || is_dialled())) connect();
            if (link) carry_notifications();
        }
    }
    bool is_dialled() const { return device.dial_at() && *device.dial_at() <= now.steady; }

    JobId begins(const Job& job, bool again = false, std::chrono::seconds within = 30s) {
        driver->run({.id = ++last_job_, .deadline = now.steady + within, .again = again}, job, now);
        return last_job_;
    }
    JobResult runs(const Job& job, bool again = false) {
        auto id = begins(job, again);
        for (int i = 0; i < 4000; ++i) {
            collect();
            for (auto& each : ended)
                if (each.job == id) return each.result;
            run_for(10ms);
        }
        ADD_FAILURE() << "the job never ends";
        return {};
    }
    void commit() {
        for (auto& mark : std::exchange(stored_but_open_, {}))
            known.mark = mark;
        if (driver && tickets_ > 0) driver->committed(tickets_, now);
        if (link) link->exchange();
        if (side_) side_->exchange();
        collect();
    }
    std::set<std::string> ids() const {
        std::set<std::string> found;
        for (auto& each : seen)
            found.insert(to_hex(each.tag.view()));
        return found;
    }
    // Reads by tag and time of the reader: how often each was reported.
    std::map<std::pair<std::string, std::int64_t>, int> reads() const {
        std::map<std::pair<std::string, std::int64_t>, int> all;
        for (auto& each : seen)
            ++all[{to_hex(each.tag.view()), each.reader_time_us}];
        return all;
    }
    std::string faults_text() const {
        std::string all;
        for (auto& each : faults)
            all += each.text + "\n";
        return all;
    }
    bool says(std::string_view text) const { return faults_text().find(text) != std::string::npos; }
    std::uint64_t count(Count which) const { return driver->counters()[static_cast<std::size_t>(which)]; }
    // Requests of the driver by name since the last call.
    std::vector<std::string> asked() {
        std::vector<std::string> names;
        for (ByteView left(said_by_driver_); !left.empty();) {
            auto look = look_at(left, wire::Direction::to_reader);
            if (look.what != Look::What::frame) break;
            auto* row = find_request(look.frame.control, look.frame.data);
            names.emplace_back(row != nullptr ? row->name : "?");
            left = left.subspan(look.size);
        }
        said_by_driver_.clear();
        return names;
    }
    void listens() {
        heard = [this](ByteView bytes, bool from_driver) {
            if (from_driver) said_by_driver_.insert(said_by_driver_.end(), bytes.begin(), bytes.end());
        };
    }

    Known known;
    std::unique_ptr<Driver> driver;
    std::unique_ptr<link::MemoryLink> link;
    std::size_t piece = 0;
    bool commits = true, redials = false, admits = true, identified = false, side_open = true;
    std::function<bool(ByteView, bool)> drop, drop_side;
    std::function<void(ByteView, bool)> heard;
    std::vector<Report> reports;
    std::vector<Observation> seen;
    std::vector<FaultNotice> faults;
    std::vector<InputNotice> inputs;
    unsigned overflows = 0, dialled = 0;
    std::vector<JobEnded> ended;
    std::vector<std::string> reasons;
    Described described;

    void lose_side() {
        if (!side_) return;
        side_->cut();
        driver->notifications()->link_lost(now);
        channel_->link_lost(now);
        side_.reset();
        collect();
    }

private:
    void collect() {
        if (!driver) return;
        for (auto& signal : std::exchange(driver->signals(), {})) {
            if (auto* job = std::get_if<JobEnded>(&signal)) ended.push_back(*job);
            if (auto* said = std::get_if<Described>(&signal)) described = *said;
            if (std::holds_alternative<Identified>(signal)) {
                identified = true;
                if (admits) driver->admitted(known, now);
            }
        }
        for (auto& report : std::exchange(driver->reports(), {})) {
            EXPECT_EQ(report.ticket, ++tickets_) << "tickets grow by one";
            for (auto& each : report.observations)
                seen.push_back(each);
            for (auto& notice : report.notices) {
                if (auto* fault = std::get_if<FaultNotice>(&notice)) faults.push_back(*fault);
                if (auto* input = std::get_if<InputNotice>(&notice)) inputs.push_back(*input);
                if (auto* overflow = std::get_if<OverflowNotice>(&notice)) {
                    ++overflows;
                    EXPECT_FALSE(overflow->count) << "the reader does not say how much it lost";
                }
            }
            if (report.mark) stored_but_open_.push_back(*report.mark);
            reports.push_back(std::move(report));
        }
        if (!commits || driver->finished()) return;
        for (auto& mark : std::exchange(stored_but_open_, {}))
            known.mark = mark;
        if (tickets_ > 0) driver->committed(tickets_, now);
    }
    // The reader's channel to the driver's second end.
    void carry_notifications() {
        auto* side = driver->notifications();
        if (side == nullptr || !side_open) return;
        auto wanted = device.dial_outs();
        if (!side_ && !wanted.empty() && wanted[0]->dial_at() && *wanted[0]->dial_at() <= now.steady) {
            channel_ = wanted[0];
            EXPECT_EQ(channel_->address(), plan_.notify_at);
            side_ = std::make_unique<link::MemoryLink>(*side, *channel_, now);
            side_->piece = piece;
            side_->drop = [this](ByteView bytes, bool from_driver) {
                return drop_side && drop_side(bytes, from_driver);
            };
            side_->connect();
            ++dialled;
        }
        if (!side_) return;
        side_->run_for(std::chrono::ceil<std::chrono::microseconds>(now.steady - side_->now().steady));
        collect();
        side_->exchange();
        if (side->finished() || channel_->finished()) lose_side();
    }

    const Plan plan_;
    Ticket tickets_ = 0;
    JobId last_job_ = 0;
    Bytes said_by_driver_;
    std::vector<Bytes> stored_but_open_;  // marks of reports that no commit has reached
    std::shared_ptr<DialOut> channel_;
    std::unique_ptr<link::MemoryLink> side_;
};

inline TagAccess access_to(std::string_view epc) {
    TagAccess access;
    access.tag = event::TagId(hex(epc));
    return access;
}
inline Execute command(std::string_view name, std::string_view data = "") {
    auto* row = find_command(name);
    auto bytes = hex(data);
    if (row->sub != 0) bytes.insert(bytes.begin(), row->sub);
    Bytes frame;
    append_request(frame, any_address, row->control, bytes);
    auto decoded = codec().decode(frame, wire::Direction::to_reader, true);
    return {*decoded.message};
}

}  // namespace gantry::harting::driver_test
