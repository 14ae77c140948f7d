#pragma once
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "reader/job.hpp"

namespace gantry {

// One thing that a reader can do to a tag with one command. Units as in TagAccess.
struct TagStep {
    enum class What : std::uint8_t { look, read, write, lock, kill, program };  // look: does this tag answer?
    What what = What::look;
    event::TagId tag;  // the one to address; may differ from the job's after its id was written
    Bank bank = Bank::user;
    std::uint32_t offset = 0, length = 0;
    Bytes data;                  // write
    std::uint32_t password = 0;  // to access the tag with; changes with a Gen2 tag's own

    friend bool operator==(const TagStep&, const TagStep&) = default;
};

struct TagAnswer {
    enum class What : std::uint8_t {
        done,
        no_tag,       // nobody answered
        trouble,      // something that may go well next time
        refused,      // the tag or the reader says no
        unsupported,  // this reader has no such command
    };
    What what = What::done;
    std::string text;  // what the reader said, unless done
    Bytes data;        // read
};

// A tag job as a row of steps, the same for every make: retries, pieces of what one command cannot carry,
// reading back what was written, and looking first after a broken link (JobOrder::again). Has no clock and
// sends nothing: take next(), do it, tell answered(), until next() is empty; then result() says how it went.
class TagSteps {
public:
    struct Limits {
        std::uint32_t unit = 2;               // bytes in a unit of the tag's memory
        std::uint32_t read = 64, write = 64;  // units that one command carries
    };

    static const TagAccess* access_of(const Job& job);  // nullptr: no tag job

    TagSteps(const Job& job, bool again, Limits limits);  // a tag job

    std::optional<TagStep> next() const;  // the same until answered()
    void answered(const TagAnswer& answer);
    const JobResult& result() const { return result_; }

private:
    enum class Stage : std::uint8_t { look, act, verify, over };

    // How the tag may answer: what a job writes can be its id, or the password that it asks for.
    struct Face {
        event::TagId id;
        std::uint32_t password = 0;
        friend bool operator==(const Face&, const Face&) = default;
    };

    const TagAccess& access() const { return *access_of(job_); }
    template <class T>
    const T* as() const {
        return std::get_if<T>(&job_);
    }
    std::optional<event::TagId> next_id() const;  // the tag's id when the job is done
    std::optional<Face> next_face() const;        // and all of it; nothing: it cannot be told
    void enter_look();
    void enter_act();
    void enter_verify();
    void plan_read(Bank bank, std::uint32_t offset, std::uint32_t length);
    void plan_write(const WriteTag& job);
    void look_back();  // steps that show whether the job was done, under faces_[face_]
    void stage_done();
    void nobody_there(const TagAnswer& answer);
    void act_failed(const TagAnswer& answer);
    void cannot_be_seen(const std::string& why);  // of a stage that looks
    std::string in_part() const;
    void end(JobResult::Status status, std::string text = {});

    const Job job_;
    const Limits limits_;
    Stage stage_ = Stage::over;
    std::deque<TagStep> steps_;  // of this stage
    Face now_;                   // as the tag answers now
    std::vector<Face> faces_;    // or may answer, in a stage that looks; the likeliest first
    std::size_t face_ = 0;
    Bytes gathered_;           // what the stage has read
    std::size_t written_ = 0;  // bytes of a write in several pieces
    unsigned tries_ = 0;       // of the step in front
    unsigned rewrites_ = 0;    // after reading back something else
    bool touched_ = false;
    std::string in_doubt_;  // what went wrong in a step that may have changed the tag all the same
    JobResult result_;
};

// The access password of a Gen2 tag after words were written to its reserved bank: words 2 and 3.
std::uint32_t password_after_write(std::uint32_t password, std::uint32_t word, ByteView data);

// The id that a Gen2 tag has after words were written to its EPC bank: word 0 is the CRC, 1 the PC, whose top
// five bits count the words of the EPC from 2. Nothing: it cannot be told.
std::optional<event::TagId> id_after_write(const event::TagId& tag, std::uint32_t word, ByteView data);

}  // namespace gantry
