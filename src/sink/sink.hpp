#pragma once
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "event/event.hpp"
#include "reader/plugin.hpp"

// The contract of a destination. A sink holds nothing but a connection: events are lent to it from the
// journal by cursor, and the cursor moves only over events whose fate is known. Restart, crash and outage are
// one case.
namespace gantry::sink {

// One event as it is lent. The views live as long as the call.
struct Item {
    const event::Event* event = nullptr;
    std::string_view id;       // "site-7:184467", unique for ever: what a consumer drops doubles by
    std::string_view payload;  // one JSON object, in the shape that the section asks for
};

enum class Fate : std::uint8_t {
    kept,      // not delivered as far as we know: lent again, and nothing behind it before it
    accepted,  // the destination has confirmed it
    rejected,  // the destination will never take it: goes to the dead letters with the reason
};

// What became of a batch.
struct Outcome {
    std::vector<Fate> fates;  // one an item, in their order
    struct Reason {
        std::size_t item = 0;
        std::string text;  // of the destination: hostile, printable() before it is shown
    };
    std::vector<Reason> reasons = {};  // one a rejected item, rising
    std::string trouble = {};          // why items are kept; empty only if none is
    // The destination asked to be left alone so long.
    std::optional<std::chrono::milliseconds> retry_after = {};

    static Outcome accepted(std::size_t items) { return {.fates = std::vector(items, Fate::accepted)}; }
    static Outcome kept(std::size_t items, std::string why) {
        return {.fates = std::vector(items, Fate::kept), .trouble = std::move(why)};
    }
    void reject(std::size_t item, std::string why) {
        fates[item] = Fate::rejected;
        reasons.push_back({item, std::move(why)});
    }
};

// How long a call may take. Both are looked at while it waits for anything.
struct Patience {
    Steady until{};
    std::stop_token stop;  // the gateway ends: return what is known, the rest is kept

    bool over(Steady now) const { return stop.stop_requested() || now >= until; }
};

// What a reader is doing, for sinks that show it (MQTT's retained status).
struct ReaderState {
    std::string name, make;
    bool connected = false;
    std::string text;  // for people: "connected, last read 4 min ago"
    friend bool operator==(const ReaderState&, const ReaderState&) = default;
};

// What a sink may ask of the gateway. Any thread.
class Host {
public:
    virtual ~Host() = default;
    virtual std::vector<ReaderState> readers() = 0;
    // A request of the API that came in over the sink: "reader.start", "tag.read" and so on with a JSON
    // object; `answer` is called once, on any thread, with {"status":"ok","data":{…}} or
    // {"status":"error","error":"…"}. Only sinks whose section says `commands = true` may call it.
    virtual void request(std::string_view operation, std::string body,
                         std::function<void(std::string)> answer) = 0;
};

// All calls come on one thread of the sink's own, never two at once, so they may block; a sink that has
// threads of its client's keeps them to itself.
class Sink {
public:
    virtual ~Sink() = default;
    // Connects if there is no connection, hands the items over in their order, and returns when the fate of
    // each is known or patience is over. Items behind a kept one may be accepted already: they are not lent
    // again before a restart. An empty batch connects, or finds out that it cannot, and delivers nothing.
    virtual Outcome deliver(std::span<const Item> batch, const Patience& patience) = 0;
    // About once a second while nothing is to be delivered: keep-alives, status, requests.
    virtual void idle(const Patience& /*patience*/) {}
    // False: deliver() would have to connect first. For the status.
    virtual bool connected() const = 0;
};

// What a sink is made of.
struct Options {
    std::string name;        // of the section
    std::string gateway_id;  // "site-7"
    std::string url;         // as configured, its scheme one of the kind's; empty where the kind needs none
    Settings settings;       // the kind's own
    std::size_t batch = 0;   // the most items a call of deliver() gets
    bool commands = false;   // the section lets requests come in over the sink
};

// All that Gantry knows of a kind of destination. Each folder under sinks/ defines exactly one, `kind`.
struct Kind {
    std::string_view name;     // "mqtt"
    std::string_view title;    // "MQTT 5 and 3.1.1"
    std::string_view summary;  // one line for the table of sinks: what a confirmation means there
    std::span<const std::string_view> schemes;  // of its url; empty: it takes no url
    std::span<const SettingRow> settings;
    std::size_t batch = 1000;      // the default of the section's `batch`
    bool takes_requests = false;   // its sections may say `commands`
    bool idempotent = false;       // the destination itself drops ids that it has
    std::string_view sample_toml;  // what `gantry config example NAME` prints

    // Opens nothing yet. An error: the settings contradict each other, or a file they name cannot be used.
    Result<std::unique_ptr<Sink>> (*make)(const Options& options, Host& host);
};

}  // namespace gantry::sink
