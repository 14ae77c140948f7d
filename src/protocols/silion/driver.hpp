#pragma once
#include <array>
#include <optional>
#include <string>

#include "protocols/silion/commands.hpp"
#include "protocols/silion/framer.hpp"
#include "protocols/silion/repeats.hpp"
#include "reader/driver.hpp"
#include "reader/plugin.hpp"

namespace gantry::silion {

// FaultNotice::code of what the driver itself has to say; a reader's own numbers are above 0.
inline constexpr std::int64_t fault_over = 0;
inline constexpr std::int64_t fault_malformed = -1;
inline constexpr std::int64_t fault_restarted = -2;

// Our end of one connection that a reader dialled, or of a serial line that we opened. One driver serves one
// connection.
class SilionDriver final : public Driver {
public:
    // More open tickets than this never are: then no more input is wanted.
    static constexpr std::size_t max_open_tickets = 16;
    static constexpr unsigned max_trouble = 3;                  // resynchronisations and bad CRCs of late
    static constexpr std::uint64_t max_skipped = 64 * 1024;     // bytes without a frame
    static constexpr std::uint64_t max_skipped_unknown = 4096;  // before the first frame

    // On a serial line, after the start of a frame: so long a silence and the rest will not come. Gen 1
    // writes without pauses at 9600 baud; adapters and their hosts hold bytes back for some tens of
    // milliseconds.
    static constexpr std::chrono::milliseconds character_gap{1000};

    explicit SilionDriver(const Settings& settings, LinkKind link = LinkKind::listen);

    void start(Now now) override;
    void received(ByteView bytes, Now now) override;
    void time_passed(Now now) override;
    std::optional<Steady> deadline() const override;
    bool wants_input() const override { return !finished_ && !holding() && !stalled(); }
    bool finished() const override { return finished_; }

    void admitted(const Known& known, Now now) override;
    void committed(Ticket ticket, Now now) override;
    void run(const JobOrder& order, const Job& job, Now now) override;
    void cancel(JobId id, Now now) override;
    void link_lost(Now now) override;
    bool stalled() const override { return issued_ - committed_ >= max_open_tickets; }
    std::string_view finish_reason() const override { return finish_reason_; }

private:
    bool holding() const { return identified_ && !admitted_; }  // until the host has decided
    bool silence_counts() const { return identified_ && admitted_ && !stalled(); }
    Steady silent_at() const;
    void finish(std::string reason);
    void acknowledge(std::size_t times);

    void take_frames(Now now);
    bool identify(const Frame& frame);
    void on_frame(const Frame& frame, Now now);
    void on_tags(const Frame& frame, Now now);
    void on_inputs(const Frame& frame, Now now);
    void on_heartbeat(const Frame& frame, Now now);
    void on_status(const Frame& frame, std::string_view words, Now now);
    void check_stream();
    void watch_gap(Now now);

    Report& report(Now now);
    void notice(Notice notice, Now now) { report(now).notices.push_back(std::move(notice)); }
    void flush();

    const bool on_line_;  // who this is is known by the line, not by a name
    const std::chrono::microseconds heartbeat_, identify_within_;
    Framer framer_;
    Repeats repeats_;
    Commands commands_;
    Bytes first_bytes_;  // what an unidentified peer said, for the reason

    bool identified_ = false, admitted_ = false, finished_ = false;
    std::string finish_reason_;
    std::string name_;
    Now held_{};  // when the bytes came that wait for admitted()
    Steady started_{}, last_heard_{};
    std::optional<Steady> gap_at_;  // half a frame is given up then
    Framer::Tally counted_;
    bool reader_uses_crc_ = false;

    std::optional<Report> open_;  // grows while one piece of input is taken
    Ticket issued_ = 0, committed_ = 0;

    std::uint32_t status_ = 0;  // last reported
    std::string status_words_;
    std::array<std::optional<bool>, 256> inputs_;
    std::optional<std::uint32_t> heartbeat_count_;
    Described described_;
};

}  // namespace gantry::silion
