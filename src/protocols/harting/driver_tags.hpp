#pragma once
#include "protocols/harting/driver_jobs.hpp"
#include "protocols/harting/tag_command.hpp"
#include "reader/tag_steps.hpp"

namespace gantry::harting {

// A tag job in this make's commands: the antenna, where one is named; how the tag is addressed (its EPC, or
// its TID where the reader's inventories carry both); then step by step.
class TagTask final : public JobTask {
public:
    TagTask(const JobOrder& order, const Job& job, KnownReader& reader);
    std::optional<Request> next(Now now) override;
    void answered(const Reply& reply, Now now) override;
    bool needs_host_mode() const override { return true; }

private:
    enum class Asked : std::uint8_t { antenna, scan, step, antenna_back, nothing };

    const TagAccess& access() const { return *TagSteps::access_of(job_); }
    std::optional<Request> step_request(const TagStep& step);
    Request command(TagCommand command, const TagStep& step) const;
    void scanned(const Reply& reply);
    void step_answered(const Reply& reply);
    void tell(TagAnswer::What what, std::string text, Bytes data = {});

    const Job job_;
    KnownReader& reader_;
    TagSteps steps_;
    Asked asked_ = Asked::nothing;
    bool antenna_set_ = false;
    bool more_ = false;    // of the inventory that looks for it
    bool looked_ = false;  // how inventories name tags was asked once
    // How the reader calls the tag; found by an inventory where that is not its EPC.
    std::optional<Bytes> uid_;
    event::TagId uid_of_;
};

}  // namespace gantry::harting
