#pragma once
#include <deque>
#include <memory>

#include "field/gen2.hpp"
#include "field/world.hpp"

namespace gantry::field {

// A read as it happened in the scene.
struct SceneRead {
    std::uint32_t tag = 0;
    float rssi_dbm = 0;
    std::uint16_t phase = 0;
    SceneTime at{};
};

// How a reader inventories.
struct Rounds {
    double turned_db = 0;  // its power against its usual setting
    std::uint8_t session = 0, q = 4;
    LinkMode mode = LinkMode::balanced;
    bool anticollision = true;
};

// One antenna that inventories, round after round. Whoever asks about time that follows what was asked before
// hears the rounds go on; a gap is a carrier that was off, and what was under way is lost.
class Listening {
public:
    virtual ~Listening() = default;
    void hear(const Rounds& rounds, SceneTime from, SceneTime to, std::vector<SceneRead>& out);

protected:
    Listening(const World& world, std::size_t antenna) : world_(world), antenna_(antenna) {}
    const World& world() const { return world_; }
    std::size_t antenna() const { return antenna_; }
    const Rounds& rounds() const { return rounds_; }
    SceneTime now() const { return now_; }
    // The tags with power, as of the cell of time that now() is in. Positions and fading are looked at so
    // often, those of still tags more seldom.
    static constexpr SceneTime cell{20'000'000}, still_cell{200'000'000};
    const std::vector<Powered>& powered();
    std::uint64_t looks() const { return looks_; }  // how often powered() has looked anew
    void pass(SceneTime time) { now_ += time; }
    void pass_cell();
    void read(const Powered& tag, SceneTime at);

    virtual void step() = 0;                         // what the reader does next; takes some time
    virtual void switched_on() = 0;                  // the carrier was off until now
    virtual void lost(const SceneRead& /*read*/) {}  // it was under way when the carrier went off

private:
    const World& world_;
    std::size_t antenna_;
    Rounds rounds_;
    SceneTime now_{}, heard_from_{}, heard_to_ = SceneTime::min();
    std::deque<SceneRead> past_;
    std::int64_t cell_ = INT64_MIN, still_cell_ = INT64_MIN;
    std::uint64_t looks_ = 0;
    std::vector<Powered> powered_, still_;
};

// `flags`: of the session, for sessions 1 to 3.
std::unique_ptr<Listening> listen_gen2(const World& world, std::size_t antenna, SessionFlags* flags);
std::unique_ptr<Listening> listen_hf(const World& world, std::size_t antenna);

}  // namespace gantry::field
