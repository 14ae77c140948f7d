#include "field/motion.hpp"

#include "field/hash.hpp"

namespace gantry::field {

double length_of(const MotionSpec& motion) {
    double sum = 0;
    for (std::size_t i = 1; i < motion.path.size(); ++i)
        sum += length(motion.path[i] - motion.path[i - 1]);
    return sum;
}

Motion::Motion(const MotionSpec& spec, std::uint32_t number, std::uint64_t chance)
    : spec_(&spec), starts_(SceneTime(spec.starts) + number * SceneTime(spec.interval)) {
    auto pace = 1 + spec.spread * (2 * fraction(chance) - 1);
    lasts_ = SceneTime(static_cast<std::int64_t>(static_cast<double>(SceneTime(spec.lasts).count()) / pace));
}

static Vec along(const MotionSpec& spec, double way) {
    for (std::size_t i = 1; i < spec.path.size(); ++i) {
        auto step = spec.path[i] - spec.path[i - 1];
        auto size = length(step);
        if (way < size) return spec.path[i - 1] + step * (way / size);
        way -= size;
    }
    return spec.path.back();
}

std::optional<Whereabouts> Motion::at(SceneTime time) const {
    auto since = time - starts_;
    Whereabouts where;
    if (since.count() >= 0 && spec_->every) {
        SceneTime every(*spec_->every);
        where.pass = static_cast<std::uint64_t>(since / every);
        since %= every;
    }
    bool outside = since.count() < 0 || since >= lasts_;
    if (outside && !spec_->stays) return {};
    auto part = std::chrono::duration<double>(since) / std::chrono::duration<double>(lasts_);
    where.gone = length_of(*spec_) * std::min(std::max(part, 0.0), 1.0);
    where.offset = along(*spec_, where.gone);
    return where;
}

}  // namespace gantry::field
