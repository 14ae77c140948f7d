#pragma once
#include <array>
#include <functional>
#include <optional>

#include "protocols/harting/driver_dialog.hpp"
#include "protocols/harting/frame.hpp"
#include "protocols/harting/records.hpp"
#include "protocols/harting/repeats.hpp"

namespace gantry::harting {

// What the records of the reader's buffer become, the same for Read Buffer and notifications: observations,
// input events, overflow.
class BufferReports {
public:
    using Counter = std::function<void(gantry::Count which, std::uint64_t by)>;
    BufferReports(Reports& reports, Counter count) : reports_(reports), count_(std::move(count)) {}

    void know(const Known& known) { repeats_.know(known.mark, known.mark_unreadable); }

    struct Taken {
        std::size_t sets = 0;
        bool new_ones = false;  // a report was made, and its ticket must be committed before the answer
        Ticket ticket = 0;
        bool readable = true;  // false: the frame makes no sense
    };
    // The data of a [0x22] reply that carries data. Makes one report of its own.
    Taken take(std::uint8_t status, ByteView data, ByteView frame, Bank block_bank, Now now);
    // The reader has forgotten the sets that were taken last.
    void cleared() { repeats_.cleared(); }
    void answered() { repeats_.answered(); }
    void link_lost() { repeats_.link_lost(); }
    void overflow(std::uint8_t status, Now now);
    void flags(ByteView flags_a_b, Now now);  // of [0x6E]: antennas and the radio
    void malformed(std::string text, ByteView frame, Now now);

private:
    void take_inputs(std::span<const InputEvent> events, Now now);

    Reports& reports_;
    Counter count_;
    Repeats repeats_;
    OncePerMinute malformed_;
    std::vector<InputEvent> inputs_;
    std::array<std::optional<bool>, 8> input_states_{};
    bool overflowed_ = false;
    std::uint16_t flags_ = 0;
    Bytes scratch_;
};

// The end of the link that the reader dials: a notification is a [0x22] reply, answered with Clear Data
// Buffer when it is on disk; a keepalive is a [0x6E] reply, never answered (section 8).
class Notifications final : public SideParty {
public:
    static constexpr std::uint64_t max_astray = 64 * 1024;
    static constexpr unsigned max_trouble = 8;
    // Less than the 5 s after which readers repeat (section 8).
    static constexpr std::chrono::seconds crossing{3};

    Notifications(BufferReports& buffer, Reports& reports, BufferReports::Counter count)
        : buffer_(buffer), reports_(reports), count_(std::move(count)) {}

    // `silence`: without a message for so long the link is dead; 0: it may be silent for ever.
    void configure(bool acknowledge, std::uint8_t com_address, std::chrono::microseconds silence) {
        acknowledge_ = acknowledge;
        com_address_ = com_address;
        silence_ = silence;
    }
    void set_block_bank(Bank bank) { block_bank_ = bank; }
    void committed(Ticket ticket, Now now);  // of Reports: may put acknowledgements into the output

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool wants_input() const override { return !finished_ && !(held_ && heard_) && !reports_.full(); }
    bool finished() const override { return finished_; }
    void link_lost(Now now) override;

    // Nothing is taken while held: who is at the other end is not known yet.
    void hold(bool held) { held_ = held; }
    void go_on(Now now) { take_frames(now); }
    bool heard() const { return heard_; }  // a good frame came over this link
    std::string stranger() const;          // what came instead, for people; empty: nothing
    bool connected() const { return connected_; }
    bool connected_since(Steady time) const { return connected_ || last_heard_ >= time; }
    const std::string& finish_reason() const { return finish_reason_; }
    const std::string& reader() const { return reader_; }  // what keepalives say of it

private:
    void take_frames(Now now);
    void on_frame(const Frame& frame, Now now);
    void on_keepalive(const Frame& frame, Now now);
    void acknowledge(Now now);
    void finish(std::string reason);
    void count_tally();

    BufferReports& buffer_;
    Reports& reports_;
    BufferReports::Counter count_;
    bool acknowledge_ = true;
    std::uint8_t com_address_ = any_address;
    std::chrono::microseconds silence_{};
    Bank block_bank_ = Bank::user;
    Framer framer_{wire::Direction::to_host};
    Framer::Tally counted_;
    // The acknowledgement waits until this is on disk. Never more than one: whatever the reader sent last is
    // taken for acknowledged, so a second one could be for what is not here yet.
    std::optional<Ticket> waiting_;
    std::optional<Steady> acknowledged_at_;  // over this link
    bool connected_ = false, finished_ = false, held_ = false, heard_ = false;
    std::string finish_reason_, reader_;
    Bytes first_bytes_;
    Steady started_{}, last_heard_{};
    unsigned trouble_ = 0;
};

}  // namespace gantry::harting
