#pragma once
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <map>
#include <memory>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/bytes.hpp"
#include "gateway/job_record.hpp"
#include "reader/plugin.hpp"
#include "testkit/peer.hpp"

// A make that the gateway dials and that speaks in lines of text, and the reader at the other end.
namespace gantry::gateway::test {

// What it is told: "hello NAME model=M notify=N reading=1 power=5", "job ID OP again=0", "cancel ID",
// "committed". What it says: "ok" (it is there), "tag HEX", "tid HEX HEX", "done ID", "failed ID", "bye",
// "drop".
class DingDriver final : public Driver {
public:
    explicit DingDriver(const DriverOptions& options) : options_(options), side_(*this) {}

    void start(Now /*now*/) override {
        say(fmt::format("hello {} model={} notify={} reading={} power={}", options_.name, options_.model,
                        options_.notify_at, int{known_.reading}, options_.settings.text("power_mw")));
    }
    void received(ByteView bytes, Now now) override { take(bytes, lines_, now); }
    void time_passed(Now /*now*/) override {}
    std::optional<Steady> deadline() const override { return {}; }
    bool finished() const override { return finished_; }
    void admitted(const Known& known, Now /*now*/) override { known_ = known; }
    void committed(Ticket /*ticket*/, Now /*now*/) override { say("committed"); }
    void run(const JobOrder& order, const Job& job, Now /*now*/) override {
        jobs_[order.id] = true;
        say(fmt::format("job {} {} again={}", order.id, op_name(job), int{order.again}));
    }
    void cancel(JobId id, Now /*now*/) override {
        say(fmt::format("cancel {}", id));
        end(id, JobResult::Status::cancelled, "cancelled");
    }
    void link_lost(Now /*now*/) override {
        for (auto& [id, running] : std::exchange(jobs_, {}))
            signals_.emplace_back(JobEnded{id, {JobResult::Status::unknown, "the link broke", {}}});
    }
    SideParty* notifications() override { return options_.notify_at.empty() ? nullptr : &side_; }
    bool stalled() const override { return false; }
    std::string_view finish_reason() const override { return finished_ ? "it said goodbye" : ""; }

private:
    class Side final : public SideParty {
    public:
        explicit Side(DingDriver& driver) : driver_(driver) {}
        void start(Now /*now*/) override { lines_.clear(); }
        void received(ByteView bytes, Now now) override { driver_.take(bytes, lines_, now); }
        void time_passed(Now /*now*/) override {}
        std::optional<Steady> deadline() const override { return {}; }
        bool finished() const override { return false; }
        void link_lost(Now /*now*/) override { driver_.say("side lost"); }

    private:
        DingDriver& driver_;
        std::string lines_;
    };

    void say(std::string_view line) {
        auto bytes = as_bytes(line);
        out().insert(out().end(), bytes.begin(), bytes.end());
        out().push_back('\n');
    }
    void end(JobId id, JobResult::Status status, std::string text) {
        if (jobs_.erase(id) == 0) return;
        JobEnded ended{id, {status, std::move(text), {}}};
        if (status == JobResult::Status::done) ended.result.values.push_back({"answer", 42});
        signals_.emplace_back(std::move(ended));
    }
    void take(ByteView bytes, std::string& lines, Now now) {
        lines += as_text(bytes);
        for (auto at = lines.find('\n'); at != std::string::npos; at = lines.find('\n')) {
            take_line(lines.substr(0, at), now);
            lines.erase(0, at + 1);
        }
    }
    void take_line(const std::string& line, Now now) {
        count(Count::frames);
        auto space = line.find(' ');
        auto word = line.substr(0, space);
        auto rest = space == std::string::npos ? std::string() : line.substr(space + 1);
        if (word == "ok") signals_.emplace_back(Described{"D1", "1.0", ""});
        if (word == "bye") finished_ = true;
        if (word == "drop") {  // it gives up, and what it was given was never sent
            finished_ = true;
            for (auto& [id, running] : std::exchange(jobs_, {}))
                signals_.emplace_back(JobEnded{id, {JobResult::Status::cancelled, "the link is ending", {}}});
        }
        if (word == "done") end(std::stoull(rest), JobResult::Status::done, "");
        if (word == "failed") end(std::stoull(rest), JobResult::Status::failed, "it will not");
        if (word != "tag" && word != "tid") return;
        Report report;
        report.ticket = ++tickets_;
        report.received = now;
        Observation seen;
        seen.tag = event::TagId(*from_hex(rest.substr(0, rest.find(' '))));
        seen.technology = event::Technology::epc_gen2;
        if (word == "tid") {
            auto data = rest.substr(rest.find(' ') + 1);
            report.data = *from_hex(data);
            seen.data_size = static_cast<std::uint16_t>(report.data.size());
            seen.data_bank = Bank::tid;
            if (auto user = data.find(' '); user != std::string::npos) {  // user data behind the TID
                seen.data_bank = Bank::user;
                seen.tid_size = static_cast<std::uint8_t>(user / 2);
            }
        }
        report.observations.push_back(seen);
        reports_.push_back(std::move(report));
    }

    DriverOptions options_;
    Side side_;
    Known known_;
    std::string lines_;
    std::map<JobId, bool> jobs_;
    Ticket tickets_ = 0;
    bool finished_ = false;
};

class DingCodec final : public wire::Codec {
public:
    wire::Decoded decode(ByteView input, wire::Direction /*direction*/, bool /*end*/) const override {
        return {input.size(), false, wire::Message{}};
    }
    wire::Result<void> encode(const wire::Message& /*message*/, wire::Direction /*direction*/,
                              Bytes& /*out*/) const override {
        return {};
    }
    wire::Result<void> check(const wire::Message& /*message*/, wire::Direction /*direction*/) const override {
        return {};
    }
    std::vector<std::string_view> names(wire::Direction /*direction*/) const override {
        return {"Ping", "SetPower", "Kill"};
    }
    std::vector<std::string_view> field_names(std::string_view /*message*/,
                                              wire::Direction /*direction*/) const override {
        return {};
    }
};
inline const wire::Codec& ding_codec() {
    static const DingCodec codec;
    return codec;
}

inline constexpr std::array<Scheme, 2> ding_schemes = {Scheme{"ding", LinkKind::dial, 1000},
                                                       Scheme{"ding+serial", LinkKind::serial}};
inline constexpr std::array<SettingRow, 1> ding_settings = {
    SettingRow{"power_mw", SettingRow::Kind::number, "100", "Power.", {}, 1, 2000}};
inline constexpr std::array<std::string_view, 2> ding_models = {"D1", "D2"};
inline constexpr std::array<wire::EnumRow, 2> ding_modes = {wire::EnumRow{0, "slow"},
                                                            wire::EnumRow{1, "fast"}};
inline constexpr wire::Enumeration ding_mode{"Mode", ding_modes};
inline constexpr std::array<ParameterRow, 3> ding_parameters = {
    ParameterRow{"Power", "mW", "Power.", true, 1, 2000}, ParameterRow{"Serial", "", "Its number.", false},
    ParameterRow{"Mode", "", "Its mode.", true, 0, -1, &ding_mode}};

inline constexpr std::array<std::string_view, 1> ding_final = {"Kill"};

inline constexpr Plugin ding{
    .name = "ding",
    .title = "Ding readers",
    .summary = "Dialled, and real enough to be.",
    .schemes = ding_schemes,
    .driver_settings = ding_settings,
    .device_settings = {},
    .device_dials = false,
    .notifies = true,
    .models = ding_models,
    .parameters = ding_parameters,
    .final_commands = ding_final,
    .sample_toml = "[[reader]]\nname = \"ding-1\"\naddress = \"ding://192.0.2.7\"\n",
    .codec = ding_codec,
    .make_driver = [](const DriverOptions& options) -> std::unique_ptr<Driver> {
        return std::make_unique<DingDriver>(options);
    },
    .make_device = nullptr,
    .antenna_name = [](std::uint16_t antenna) { return fmt::format("Ant{}", antenna); },
};
inline constexpr std::array<const Plugin*, 1> ding_makes = {&ding};

// A reader of that make: a port of its own that it listens at, as long as it is on.
class DingReader {
public:
    DingReader() {
        sockaddr_in address{};
        socklen_t size = sizeof address;
        EXPECT_EQ(::getsockname(held_, reinterpret_cast<sockaddr*>(&address), &size), 0);
        port_ = ntohs(address.sin_port);
        switch_on();
    }
    ~DingReader() {
        switch_off();
        ::close(held_);
    }
    DingReader(const DingReader&) = delete;
    DingReader& operator=(const DingReader&) = delete;

    std::uint16_t port() const { return port_; }
    void switch_off() {
        if (fd_ >= 0) ::close(fd_);
        fd_ = -1;
    }
    void switch_on() {
        fd_ = bound(port_);
        timeval patience{60, 0};
        ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
        EXPECT_EQ(::listen(fd_, 8), 0);
    }
    // Does a connection wait to be accepted?
    bool is_called() const {
        pollfd state{fd_, POLLIN, 0};
        return ::poll(&state, 1, 0) > 0;
    }
    // The gateway's next connection, when its driver has said hello.
    testkit::Peer accept() {
        auto peer = accept_silent();
        EXPECT_TRUE(peer.send("ok\n"));
        return peer;
    }
    testkit::Peer accept_silent() {
        testkit::Peer peer(::accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC));
        EXPECT_GE(peer.fd(), 0);
        hello = peer.until("\n");
        EXPECT_TRUE(hello.starts_with("hello ")) << hello;
        return peer;
    }
    std::string hello;

private:
    static int bound(std::uint16_t port) {
        int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        int yes = 1;
        ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(port);
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        EXPECT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
        return fd;
    }

    // Never listens: while the reader is off, who dials is refused, and no other program gets the port.
    int held_ = bound(0);
    int fd_ = -1;
    std::uint16_t port_ = 0;
};

}  // namespace gantry::gateway::test
