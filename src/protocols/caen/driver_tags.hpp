#pragma once
#include "protocols/caen/driver_jobs.hpp"
#include "reader/tag_steps.hpp"

namespace gantry::caen {

// A tag job in this make's commands: the source that sees the tag, the air protocol of the tag, then step by
// step, then the protocol back as it was.
class TagTask final : public JobTask {
public:
    TagTask(const JobOrder& order, const Job& job, const JobContext& context);
    std::optional<Request> next(Now now) override;
    void answered(const Reply& reply, Now now) override;

private:
    enum class Stage : std::uint8_t { protocol, switching, source, steps, back, over };
    // What is under way for one step; a step without a command of its own looks at the tags in the field.
    enum class Asked : std::uint8_t { step, scan, alone, program };

    const TagAccess& access() const { return *TagSteps::access_of(job_); }
    const std::string& source() const { return sources_[source_]; }
    void finish(JobResult::Status status, std::string text);
    void choose_sources();
    std::optional<Request> step_request();
    std::optional<Request> gen2_request(const TagStep& step);
    std::optional<Request> other_request(const TagStep& step);
    std::optional<Request> scan_request() const;
    Request addressed(Command command, const event::TagId& tag) const;
    Request addressed(const TagStep& step, Command command) const { return addressed(command, step.tag); }
    void step_answered(const Reply& reply);
    void scanned(const Reply& reply);
    void tell(TagAnswer answer);
    void tell(TagAnswer::What what, std::string text);

    const Job job_;
    const ReaderState& reader_;
    Reports& reports_;
    TagSteps steps_;
    Stage stage_ = Stage::protocol;
    Asked asked_ = Asked::step;
    std::vector<std::string> sources_;
    std::size_t source_ = 0;      // the one that is tried
    std::size_t tried_ = 0;       // sources where nobody answered to this step
    std::size_t checked_ = 0;     // sources asked for the antenna
    bool raw_scan_ = false;       // InventoryTag is refused
    bool plain_program_ = false;  // G2Write is refused: G2ProgramID, which cannot say which tag it means
    bool alone_ = false;          // the tag is the only one in front of this source
    std::optional<std::int64_t> before_;  // the reader's protocol, to be restored
};

}  // namespace gantry::caen
