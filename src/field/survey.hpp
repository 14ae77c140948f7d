#pragma once
#include "field/scene.hpp"

namespace gantry::field {

// What the readers of a scene hear when nobody but this asks them: each looks through its antennas in turn,
// or through one all the time.
class Survey {
public:
    struct LastRead {
        std::size_t reader = 0;
        std::uint16_t antenna = 1;
        double rssi_dbm = 0;
        Steady at{};
    };
    struct TagReads {
        std::uint64_t reads = 0;
        std::optional<LastRead> last;
    };
    struct ReaderReads {
        std::uint64_t reads = 0;
        std::size_t tags = 0;  // different ones
        std::vector<std::uint64_t> by_antenna;
    };

    // `turned_db`: the power of all readers against their usual setting.
    Survey(Scene& scene, Steady start, double turned_db = 0);
    void run_to(Steady to);

    Steady start() const { return start_; }
    Steady now() const { return now_; }
    const std::vector<ReaderReads>& readers() const { return readers_; }
    const std::vector<TagReads>& tags() const { return tags_; }  // in the order of the scenario
    // Different tags of a group that any reader, or one, has read.
    std::size_t read_of(std::uint32_t group) const;

private:
    void hear(std::size_t reader, std::uint16_t antenna, Steady from, Steady to);

    Scene& scene_;
    Steady start_, now_;
    double turned_db_;
    std::vector<ReaderReads> readers_;
    std::vector<TagReads> tags_;
    std::vector<std::uint32_t> groups_;
    std::vector<std::vector<bool>> seen_;  // by reader and tag
    std::vector<std::pair<event::TagId, std::size_t>> by_id_;
    std::vector<AirSighting> heard_;
};

}  // namespace gantry::field
