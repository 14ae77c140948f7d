#pragma once
#include <deque>
#include <functional>
#include <optional>

#include "protocols/silion/tables.hpp"
#include "reader/driver.hpp"

namespace gantry::silion {

// Jobs as remote commands. Answers carry no number, so one command of each kind is under way at a time and
// its answer is known by its code (docs/protocols/silion.md section 9); more jobs of the kind wait for their
// turn.
class Commands {
public:
    using Send = std::function<void(Code code, ByteView data)>;
    using Ended = std::function<void(JobId job, JobResult result)>;
    Commands(Send send, Ended ended) : send_(std::move(send)), ended_(std::move(ended)) {}

    void allow(Now now);  // the reader is known: send what waits
    void run(const JobOrder& order, const Job& job, Now now);
    void cancel(JobId id, Now now);
    // False: nothing of that code is under way.
    bool answered(Code code, std::uint32_t status, ByteView data, Now now);
    void time_passed(Now now);
    std::optional<Steady> deadline() const;
    void link_lost();

    // Until when a gen 1 reader may be silent because outputs are timed; it answers and reports after that.
    Steady silent_until() const { return silent_until_; }
    std::uint64_t timeouts() const { return timeouts_; }

private:
    struct Waiting {
        JobId id;
        Steady deadline;
        Bytes data;
        std::chrono::seconds patience;  // how long the answer may take
        std::chrono::seconds silence;   // of that, how long the reader may be silent
    };
    struct UnderWay {
        std::optional<JobId> id;  // nothing: given up, but its answer may still come
        Steady deadline;          // of the job
        Steady answer_due;
    };
    struct Slot {  // for one code
        Code code;
        std::optional<UnderWay> under_way = {};
        std::deque<Waiting> waiting = {};
    };
    void end(JobId job, JobResult::Status status, std::string text);
    Slot& slot(Code code);
    void next(Slot& slot, Now now);

    Send send_;
    Ended ended_;
    std::array<Slot, 3> slots_{Slot{.code = Code::get_inputs}, Slot{.code = Code::set_outputs},
                               Slot{.code = Code::restart}};
    bool allowed_ = false;
    Steady silent_until_{};
    std::uint64_t timeouts_ = 0;
};

}  // namespace gantry::silion
