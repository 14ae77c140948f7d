#include "stream_fuzz.hpp"

namespace {

// Nothing is there to be read; what matters is what the reader does with its commands.
class NoAir final : public gantry::Air {
public:
    void inventory(const gantry::Carrier&, gantry::Steady, gantry::Steady,
                   std::vector<gantry::AirSighting>&) override {}
    std::vector<std::uint16_t> antennas() const override { return {1}; }
};

void check_device(const std::uint8_t* data, std::size_t size) {
    using namespace gantry;
    using silion::fuzz::demand;
    static const auto settings = silion::fuzz::settings_of(silion::plugin.device_settings);
    silion::fuzz::Input input(data, size);
    NoAir air;
    silion::SilionDevice device({"silion", 1, settings}, air);
    Now now{Steady{} + std::chrono::hours{1}, Wall{}};
    device.power_on(now);
    device.start(now);
    for (auto piece : input.pieces()) {
        device.received(piece, now);
        if (auto dice = input.random.next(); dice % 8 == 0) {
            now = now + std::chrono::milliseconds{dice >> 8 & 0x1FFF};
            device.time_passed(now);
        }
        demand(device.output().size() <= 64 * input.bytes.size() + 65536);
        if (device.finished()) {
            device.link_lost(now);
            device.start(now);
        }
    }
    demand(!device.state().empty());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    gantry::silion::fuzz::check_stream(data, size, gantry::wire::Direction::to_reader);
    check_device(data, size);
    return 0;
}
