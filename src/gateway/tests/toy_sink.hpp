#pragma once
#include <deque>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "sink/sink.hpp"

// A destination that exists only here: a box by url, which takes, refuses or keeps what the test says.
namespace gantry::gateway::test {

struct Box {
    std::mutex mutex;
    std::vector<std::string> ids, payloads;
    std::vector<std::size_t> batches;  // their sizes
    std::set<std::string> poison;      // refused for good
    std::set<std::string> riddles;     // kept, each time
    bool away = false;                 // keeps everything
    bool throws = false;
    std::size_t takes = SIZE_MAX;  // of each batch, the rest is kept
    std::optional<std::chrono::milliseconds> retry_after;
    std::size_t calls = 0, idles = 0;

    static Box& at(const std::string& url) {
        static std::mutex of_all;
        static std::map<std::string, Box> boxes;
        std::lock_guard lock(of_all);
        return boxes[url];
    }
    std::vector<std::string> taken() {
        std::lock_guard lock(mutex);
        return ids;
    }
    template <class Change>
    void with(Change change) {
        std::lock_guard lock(mutex);
        change(*this);
    }
};

class BoxSink final : public sink::Sink {
public:
    explicit BoxSink(const std::string& url) : box_(Box::at(url)) {}
    sink::Outcome deliver(std::span<const sink::Item> batch, const sink::Patience&) override {
        std::lock_guard lock(box_.mutex);
        ++box_.calls;
        box_.batches.push_back(batch.size());
        if (box_.throws) throw std::runtime_error("the client library gave up");
        if (box_.away) {
            auto outcome = sink::Outcome::kept(batch.size(), "nobody answers");
            outcome.retry_after = box_.retry_after;
            return outcome;
        }
        auto outcome = sink::Outcome::accepted(batch.size());
        for (std::size_t i = 0; i < batch.size(); ++i) {
            if (i >= box_.takes || box_.riddles.contains(std::string(batch[i].id))) {
                outcome.fates[i] = sink::Fate::kept;
                outcome.trouble = i >= box_.takes ? "the box is small" : "it is a riddle";
            } else if (box_.poison.contains(std::string(batch[i].id))) {
                outcome.reject(i, "it is poison");
            } else {
                box_.ids.emplace_back(batch[i].id);
                box_.payloads.emplace_back(batch[i].payload);
            }
        }
        return outcome;
    }
    void idle(const sink::Patience&) override {
        box_.with([](Box& box) { ++box.idles; });
    }
    bool connected() const override {
        std::lock_guard lock(box_.mutex);
        return !box_.away;
    }

private:
    Box& box_;
};

inline Result<std::unique_ptr<sink::Sink>> make_box(const sink::Options& options, sink::Host&) {
    if (options.settings.boolean("broken")) return fail("the box is broken", "get another");
    return std::make_unique<BoxSink>(options.url);
}

inline constexpr std::array<std::string_view, 2> box_schemes = {"box", "boxes"};
inline constexpr std::array<SettingRow, 4> box_settings = {
    SettingRow{"broken", SettingRow::Kind::boolean, "false", "It does not work."},
    SettingRow{"depth", SettingRow::Kind::number, "3", "How deep it is.", {}, 1, 10},
    SettingRow{"colour", SettingRow::Kind::text, "", "Its colour."},
    SettingRow{"password", SettingRow::Kind::text, "", "Of its lock.", {}, 1, 20, false, true}};
inline constexpr sink::Kind box{
    .name = "box",
    .title = "A box",
    .summary = "Takes what it is given.",
    .schemes = box_schemes,
    .settings = box_settings,
    .batch = 100,
    .idempotent = false,
    .sample_toml = "[[sink]]\nname = \"mine\"\ntype = \"box\"\nurl = \"box://here\"\n",
    .make = make_box};
inline constexpr std::array<SettingRow, 1> hole_settings = {
    SettingRow{"width", SettingRow::Kind::number, "1", "How wide it is.", {}, 1, 9}};
inline constexpr sink::Kind hole{
    .name = "hole",
    .title = "A hole",
    .summary = "Nothing comes back.",
    .schemes = {},
    .settings = hole_settings,
    .batch = 10,
    .idempotent = false,
    .sample_toml = "[[sink]]\nname = \"lost\"\ntype = \"hole\"\n",
    .make = [](const sink::Options&, sink::Host&) -> Result<std::unique_ptr<sink::Sink>> {
        return std::make_unique<BoxSink>("hole");
    }};
inline constexpr std::array<const sink::Kind*, 2> kinds = {&box, &hole};

}  // namespace gantry::gateway::test
