#pragma once
#include <unordered_map>

#include "protocols/caen/device_mask.hpp"
#include "protocols/caen/device_request.hpp"
#include "protocols/caen/device_state.hpp"

namespace gantry::caen {

// One RawReadIDs or InventoryTag under way (sections 7 and 8). It takes its time on one read point after the
// other; tags are told once for each stay on a read point.
class Inventory {
public:
    struct Order {
        std::uint16_t id = 0;  // of the message
        Command command{};
        std::size_t source = 0;
        std::uint16_t flags = 0;
        TagMask mask = {};
    };
    // Is the request legal? Then what it orders.
    struct Wanted {
        ResultCode result = ResultCode::success;
        Order order = {};
    };
    static Wanted order_of(const Parsed& request, Command command, const Arguments& arguments,
                           const ReaderMemory& memory);

    // The head of a framed stream goes to `out` at once.
    Inventory(const Order& order, const ReaderMemory& memory, Now now, Bytes& out);

    bool framed() const { return (order_.flags & flag_framed) != 0; }
    bool over() const { return over_; }
    std::optional<Steady> deadline() const {
        return over_ || waits_ ? std::nullopt : std::optional(slot_end_);
    }
    // `room`: false while the host does not read; what is heard then is lost.
    void time_passed(Now now, bool room, Bytes& out);
    void trigger(Now now);   // the key was pressed
    void abort(Bytes& out);  // of a framed stream
    std::uint64_t tags() const { return tags_; }
    std::uint64_t lost() const { return lost_; }

private:
    struct Read {
        event::TagId tag;
        event::Technology technology{};
        std::int16_t rssi = 0;
        Steady at{};
        std::optional<std::uint16_t> phase;
    };
    struct Point {
        unsigned number = 0;
        std::optional<Steady> heard_to = {};
        std::vector<Read> reads = {};
        std::unordered_map<event::TagId, std::size_t, event::TagIdHash> index = {};  // into reads
    };

    void begin_slot(Steady at);
    void listen(Point& point);
    void next_slot(Now now, Bytes& out);
    void stream(Point& point, bool room, Bytes& out);
    void append_tag(unsigned point, const Read& read, Bytes& out) const;
    void append_group(const Point& point, Bytes& out) const;
    void answer(Bytes& out);
    static std::uint16_t phase_of(unsigned point, const Read& read);
    Bytes tid_of(const AirAccess& access) const;
    std::uint32_t epc_word(const AirAccess& access, std::uint32_t word) const;

    const Order order_;
    const ReaderMemory& memory_;
    std::vector<Point> points_;
    std::size_t current_ = 0;
    std::uint32_t cycles_left_ = 0;
    bool endless_ = false, waits_ = false, over_ = false;
    Steady slot_start_{}, slot_end_{};
    std::uint64_t tags_ = 0, lost_ = 0;
};

}  // namespace gantry::caen
