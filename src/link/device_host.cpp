#include "link/device_host.hpp"

#include "base/log.hpp"
#include "link/dial_outs.hpp"
#include "link/pty.hpp"

namespace gantry::link {

namespace {

constexpr auto dial_timeout = 10s;
constexpr auto shortest_pause = 50ms;  // between tries of a device that does not wait by itself
constexpr auto shortest_timer = 1ms;
constexpr auto unplugged = 500ms;  // a line that its device has ended is away for so long

// Who gives the device its links.
struct Place {
    std::optional<Endpoint> listen = {};
    std::string pty = {};  // the link's path; empty: none
    std::uint32_t baud = 0;
};

class Host final : public DeviceHost {
public:
    Host(Loop& loop, std::unique_ptr<Device> device, Endpoint target,
         std::function<void(const LinkNews&)> news = {})
        : loop_(loop), device_(std::move(device)), target_(std::move(target)), news_(std::move(news)) {}

    ~Host() override {
        loop_.run_and_wait([this] { power_off(); });
        // If the loop has ended, all of it is inert already.
    }

    Result<void> begin(const Place& place) {
        Result<void> result;
        place_ = place;
        loop_.run_and_wait([&] {
            timer_.emplace(loop_);
            channels_.emplace(loop_, [this] { channel_turned(); });
            result = open();
            if (!result) return;
            device_->power_on(read_clocks());
            if (pty_ && pty_->opened()) connect_line({});  // or it cannot be told
            changed();
        });
        return result;
    }

    Endpoint local() const override { return listener_ ? listener_->local() : Endpoint{}; }
    bool connected() const override { return connected_.load(std::memory_order_relaxed); }

    void with_device(const std::function<void(Device&, Now)>& work) override {
        loop_.run_and_wait([&] {
            work(*device_, read_clocks());
            changed();
        });
    }

    void cut() override {
        loop_.run_and_wait([this] {
            if (link_) link_->close("cut");
        });
    }

private:
    void power_off() {
        timer_.reset();
        dial_.reset();
        listener_.reset();
        channels_.reset();
        connected_ = false;
        link_.reset();  // without a word: `closed` would plan the next try
        pty_.reset();
    }

    Result<void> open() {
        if (place_.listen) {
            auto opened =
                Listener::open(loop_, *place_.listen, [this](Socket socket) { take(std::move(socket)); });
            if (!opened) return tl::unexpected(opened.error());
            listener_ = std::move(*opened);
        } else if (!place_.pty.empty()) {
            auto opened = Pty::open(loop_, place_.pty, place_.baud, [this] { line_used(); });
            if (!opened) return tl::unexpected(opened.error());
            pty_ = std::move(*opened);
        }
        return {};
    }

    // Something was done with the device outside its link's turns.
    void changed() {
        if (link_) return link_->wake();  // and its turn looks at the channels
        look_at_channels();
        plan();
    }

    void channel_turned() {
        if (looking_) return;  // a turn that the device's own has brought about
        changed();
    }

    void look_at_channels() {
        if (looking_) return;
        looking_ = true;
        channels_->look(device_->dial_outs());
        looking_ = false;
    }

    void take(Socket socket) {
        if (link_) link_->close("a newer connection");  // its link_lost comes before the new start
        Link::Callbacks callbacks;
        callbacks.after_turn = [this] { look_at_channels(); };
        callbacks.closed = [this](std::string_view reason) { lost(reason); };
        callbacks.peer_is = "the gateway";
        timer_->cancel();  // the link's own timer serves the device now
        link_ = Link::start(loop_, std::move(socket), *device_, std::move(callbacks));
        connected_ = !pty_ || pty_->opened();
        up_since_ = link_->last_input();  // which begins with the link
        if (news_) news_({LinkNews::Kind::up});
    }

    void lost(std::string_view reason) {
        log::debug("emulator", "link to {}: {}", link_->peer(), reason);
        connected_ = false;
        auto now = read_clocks();
        LinkNews news{LinkNews::Kind::down, reason, link_->last_input() != up_since_, device_->finished(),
                      std::chrono::floor<std::chrono::milliseconds>(now.steady - up_since_)};
        if (news_) news_(news);
        link_.reset();
        device_->link_lost(now);
        if (pty_) unplug(now);
        changed();
    }

    // As if somebody had pulled it out: the program at the other end sees its end.
    void unplug(Now now) {
        pty_.reset();
        next_try_ = now.steady + unplugged;
    }

    void plug_in(Now now) {
        next_try_ = now.steady + unplugged;
        auto plugged = pty_ ? Result<void>{} : open();
        if (plugged && !pty_->opened()) return plan();  // until somebody opens it
        connect_line(plugged);
    }

    void connect_line(const Result<void>& plugged) {
        auto socket = plugged ? pty_->connect() : tl::unexpected(plugged.error());
        if (socket) return take(std::move(*socket));
        log::error("emulator", "{}", socket.error().text());
        pty_.reset();
        plan();
    }

    // A program has opened or closed the line. Also one that has gone again may have said something.
    void line_used() {
        if (!pty_) return;
        if (!link_) return connect_line({});
        connected_ = pty_->opened();
    }

    // Without a link: wait for what comes first, something the device does by itself or its next try.
    void plan() {
        if (link_) return;
        auto next = device_->deadline();
        if (auto dial = dial_time(); dial && (!next || *dial < *next)) next = dial;
        if (!next) return timer_->cancel();
        timer_->at(std::max(*next, not_before_), [this] { time_passed(); });
    }

    bool on_line() const { return !place_.pty.empty(); }

    std::optional<Steady> dial_time() const {
        if (listener_ || dial_ || pty_) return {};
        auto at = on_line() ? next_try_ : device_->dial_at();
        if (at) at = std::max(*at, next_try_);
        return at;
    }

    void time_passed() {
        auto now = read_clocks();
        if (auto due = device_->deadline(); due && *due <= now.steady) {
            device_->time_passed(now);
            not_before_ = now.steady + shortest_timer;
            look_at_channels();
        }
        if (auto due = dial_time(); due && *due <= now.steady) {
            if (on_line()) return plug_in(now);
            dial_ = Dial::start(loop_, target_, dial_timeout,
                                [this](Result<Socket> socket) { dialled(std::move(socket)); });
        }
        plan();
    }

    void dialled(Result<Socket> socket) {
        dial_.reset();
        auto now = read_clocks();
        next_try_ = now.steady + shortest_pause;
        if (socket) return take(std::move(*socket));
        log::debug("emulator", "{}", socket.error().text());
        if (news_) news_({LinkNews::Kind::not_reached, socket.error().what});
        device_->dial_failed(now);
        changed();
    }

    Loop& loop_;
    std::unique_ptr<Device> device_;
    Endpoint target_;
    Place place_;
    std::optional<Timer> timer_;
    std::unique_ptr<Listener> listener_;
    std::unique_ptr<Pty> pty_;
    std::optional<DialOuts> channels_;
    bool looking_ = false;
    std::unique_ptr<Dial> dial_;
    std::shared_ptr<Link> link_;
    Steady next_try_{}, not_before_{};
    Steady up_since_{};
    std::function<void(const LinkNews&)> news_;
    std::atomic<bool> connected_ = false;
};

}  // namespace

std::unique_ptr<DeviceHost> DeviceHost::dial(Loop& loop, std::unique_ptr<Device> device, Endpoint endpoint,
                                             std::function<void(const LinkNews&)> news) {
    auto host = std::make_unique<Host>(loop, std::move(device), std::move(endpoint), std::move(news));
    (void)host->begin({});  // only the other places can be refused
    return host;
}

Result<std::unique_ptr<DeviceHost>> DeviceHost::listen(Loop& loop, std::unique_ptr<Device> device,
                                                       const Endpoint& endpoint) {
    auto host = std::make_unique<Host>(loop, std::move(device), Endpoint{});
    Place place;
    place.listen = endpoint;
    if (auto begun = host->begin(place); !begun) return tl::unexpected(begun.error());
    return host;
}

Result<std::unique_ptr<DeviceHost>> DeviceHost::pty(Loop& loop, std::unique_ptr<Device> device,
                                                    const std::string& link, std::uint32_t baud) {
    auto host = std::make_unique<Host>(loop, std::move(device), Endpoint{});
    Place place;
    place.pty = link;
    place.baud = baud;
    if (auto begun = host->begin(place); !begun) return tl::unexpected(begun.error());
    return host;
}

}  // namespace gantry::link
