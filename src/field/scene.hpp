#pragma once
#include <memory>
#include <vector>

#include "field/scenario.hpp"
#include "reader/air.hpp"

namespace gantry::field {

// A scenario that happens: tags in one space, seen by all of its readers at once. Deterministic: the same
// scenario and the same questions give the same answers, however time is sliced. Time is an argument;
// thread-safe.
class Scene {
public:
    // It begins at `start`; with a `speed` of 10 ten of its seconds pass in one of the caller's.
    Scene(const Scenario& scenario, Steady start, double speed = 1);
    ~Scene();

    const Scenario& scenario() const;
    Air& air(std::size_t reader);  // as the scenario counts them; lives as long as the scene
    Air* air(std::string_view reader);
    std::size_t tags() const;

    // What a picture shows of a tag.
    struct TagView {
        event::TagId id;
        std::uint32_t group = 0;
        std::optional<Vec> place;  // nothing: it is not there
        bool powered = false;      // some antenna gives it what it needs
    };
    std::vector<TagView> look(Steady at) const;  // in the order of the scenario

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace gantry::field
