#include "protocols/harting/driver_jobs.hpp"

#include <algorithm>
#include <deque>
#include <set>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/codec.hpp"
#include "protocols/harting/driver_tags.hpp"
#include "protocols/harting/frame.hpp"

namespace gantry::harting {

using JobStatus = JobResult::Status;

void JobTask::end(JobStatus status, std::string text) {
    over_ = true;
    result_.status = status;
    result_.text = std::move(text);
}

JobStatus refusal(const Reply& reply) {
    if (reply.silent) return JobStatus::timed_out;
    return reply.lacks() ? JobStatus::unsupported : JobStatus::failed;
}

std::string refusal_text(const Reply& reply) {
    return reply.silent ? "the reader did not answer: what it did is not known"
                        : fmt::format("the reader answered: {}", reply.words());
}

std::optional<Request> ModeTask::next(Now) {
    switch (stage_) {
        case Stage::read:
            return read_block(1);
        case Stage::write:
            return write_block(1, block_);
        case Stage::over:
            break;
    }
    return {};
}

void ModeTask::answered(const Reply& reply, Now) {
    bool reading = stage_ == Stage::read;
    stage_ = Stage::over;
    if (!reading) {
        if (reply.ok())
            reader_.interface = block_;
        else
            refused_ = reply.words();
        return;
    }
    auto block = reply.block();
    if (!block) {
        refused_ = reply.words();
        return;
    }
    block_ = *block;
    reader_.interface = block_;
    if (reader_.mode() == mode_) return;
    if (auto fine = set(config_row("CFG1.MODE"), wire::Value(static_cast<std::int64_t>(mode_)), block_);
        !fine) {
        refused_ = fine.error().text();
        return;
    }
    stage_ = Stage::write;
}

namespace {

// --- inputs and outputs ------------------------------------------------------------------------------------

class InputsTask final : public JobTask {
public:
    explicit InputsTask(const KnownReader& reader) : reader_(reader) {}
    std::optional<Request> next(Now) override {
        if (over()) return {};
        return Request(Command::get_input);
    }
    void answered(const Reply& reply, Now) override {
        if (!reply.ok() || reply.data.empty()) return end(refusal(reply), refusal_text(reply));
        wire::Value::List inputs;
        for (unsigned i = 0; i < std::min(reader_.inputs, 8U); ++i) {
            wire::Fields input;
            input.push_back({"input", wire::Value(i + 1)});
            input.push_back({"state", wire::Value((reply.data[0] >> i & 1) != 0)});
            inputs.emplace_back(std::move(input));
        }
        result_.values.push_back({"inputs", wire::Value(std::move(inputs))});
        end(JobStatus::done);
    }

private:
    const KnownReader& reader_;
};

// Outputs count on into the relays: with two outputs and a relay, output 3 is the relay.
class OutputsTask final : public JobTask {
public:
    OutputsTask(const std::vector<OutputChange>& changes, bool again, const KnownReader& reader) {
        prepare(changes, again, reader);
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        return request_;
    }
    void answered(const Reply& reply, Now) override {
        if (!reply.ok()) return end(refusal(reply), refusal_text(reply));
        end(JobStatus::done);
    }

private:
    void prepare(const std::vector<OutputChange>& changes, bool again, const KnownReader& reader) {
        if (changes.empty()) return end(JobStatus::failed, "no output is named; name one, as in 1=on");
        Bytes data{0x01, static_cast<std::uint8_t>(changes.size())};
        std::set<std::uint16_t> named;
        for (auto& change : changes) {
            auto lines = reader.outputs + reader.relays;
            if (change.output < 1 || change.output > lines)
                return end(
                    JobStatus::unsupported,
                    fmt::format("there is no output {}; the reader has {} outputs and {} relays, which "
                                "count on",
                                change.output, reader.outputs, reader.relays));
            if (!named.insert(change.output).second)
                return end(JobStatus::failed, fmt::format("output {} is named twice", change.output));
            if (again && change.for_ms != 0)
                return end(JobStatus::unknown,
                           "it was sent before the link broke; a timed output is not switched twice");
            // Units of 100 ms; 65535 is for good (section 3).
            constexpr std::uint32_t unit = 100, longest = 65534;
            auto time = change.for_ms == 0 ? 0xFFFF : std::max((change.for_ms + unit - 1) / unit, 1U);
            if (change.for_ms != 0 && time > longest)
                return end(JobStatus::failed, "the longest time is 1 h 49 min");
            bool relay = change.output > reader.outputs;
            auto number = relay ? change.output - reader.outputs : change.output;
            wire::Writer writer(data);
            writer.u8((relay ? 0x80U : 0U) | number);
            writer.u8(change.state ? 0x01 : 0x02);
            writer.u16(time);
        }
        request_ = Request(Command::set_output, std::move(data));
    }

    std::optional<Request> request_;
};

class RestartTask final : public JobTask {
public:
    explicit RestartTask(bool again) {
        if (again) end(JobStatus::done, {});  // the link broke over it
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        if (system_) return Request(Command::system_reset, {0x00});
        return Request(Command::rf_controller_reset);
    }
    void answered(const Reply& reply, Now) override {
        // In EE-Init mode it takes only [0x64] (manual, section 7).
        if (!system_ && (reply.is(Status::eeprom_failure) || reply.lacks())) {
            system_ = true;
            return;
        }
        if (!reply.ok()) return end(refusal(reply), refusal_text(reply));
        end(JobStatus::done);
    }

private:
    bool system_ = false;
};

// --- parameters --------------------------------------------------------------------------------------------

class GetParameterTask final : public JobTask {
public:
    explicit GetParameterTask(const GetParameter& job) : all_(job.name.empty()), eeprom_(job.permanent) {
        choose(job);
        queue_blocks();
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        return read_block(queue_[at_], eeprom_);
    }
    void answered(const Reply& reply, Now) override {
        auto number = queue_[at_];
        if (auto block = reply.block())
            std::ranges::copy(*block, bytes_.begin() + static_cast<std::ptrdiff_t>(number * block_size));
        else if (!all_ || reply.silent)
            return end(refusal(reply), refusal_text(reply));
        else
            missing_.insert(number);
        if (++at_ == queue_.size()) finish();
    }

private:
    void choose(const GetParameter& job) {
        if (all_) {
            for (auto& block : blocks())
                if (!block.reserved) rows_of(block.number);
        } else if (auto* row = find_config(job.name); row == nullptr) {
            end(JobStatus::failed, fmt::format("there is no parameter \"{}\"", printable(job.name)));
        } else if (row->secret) {
            end(JobStatus::failed, fmt::format("{} is a secret: it can be set, and is not shown", row->name));
        } else {
            wanted_.push_back(row);
        }
    }
    void rows_of(std::uint8_t block) {
        for (auto& parameter : parameter_rows())
            if (auto* row = find_config(parameter.name); row->block == block && !row->secret)
                wanted_.push_back(row);
    }
    void queue_blocks() {
        std::set<std::uint8_t> needed;
        for (auto* row : wanted_)
            for (std::size_t i = 0; i < blocks_of(*row); ++i)
                needed.insert(static_cast<std::uint8_t>(row->block + i));
        queue_.assign(needed.begin(), needed.end());
    }
    // Of all parameters those that the reader refuses are left out.
    void finish() {
        for (auto* row : wanted_) {
            bool there = true;
            for (std::size_t i = 0; i < blocks_of(*row); ++i)
                there = there && !missing_.contains(static_cast<std::uint8_t>(row->block + i));
            if (there)
                result_.values.push_back(
                    {std::string(row->name), get(*row, std::span(bytes_).subspan(row->block * block_size))});
        }
        if (result_.values.empty()) return end(JobStatus::failed, "the reader gave none of its parameters");
        end(JobStatus::done);
    }

    bool all_, eeprom_;
    std::vector<const ConfigRow*> wanted_;
    std::vector<std::uint8_t> queue_;
    std::size_t at_ = 0;
    std::array<std::uint8_t, block_size * block_count> bytes_{};
    std::set<std::uint8_t> missing_;
};

// Reads the blocks, changes the parameter in them, and writes back those that changed. Some readers take what
// is written to EEPROM into RAM as well (section 3), all of the block: so RAM is read before and written
// after, and what else is at work there stays.
class SetParameterTask final : public JobTask {
public:
    SetParameterTask(const SetParameter& job, KnownReader& reader)
        : row_(find_config(job.name)), reader_(reader), permanent_(job.permanent), value_(job.value) {
        Bytes trial(row_ != nullptr ? block_size * blocks_of(*row_) : 0);
        if (row_ == nullptr) {
            end(JobStatus::failed, fmt::format("there is no parameter \"{}\"", printable(job.name)));
        } else if (auto fine = set(*row_, value_, trial); !fine) {
            end(JobStatus::failed, fine.error().text());
        } else {
            shown_ = get(*row_, trial);
            read(false);
            if (permanent_) read(true);
        }
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        auto& step = steps_.front();
        auto number = static_cast<std::uint8_t>(row_->block + step.index);
        if (!step.write) return read_block(number, step.eeprom);
        return write_block(number, block_of(step.eeprom ? stored_ : ram_, step.index), step.eeprom);
    }
    void answered(const Reply& reply, Now) override {
        auto step = steps_.front();
        steps_.pop_front();
        if (!step.write) {
            auto block = reply.block();
            if (!block) return end(refusal(reply), refusal_text(reply));
            auto& bytes = step.eeprom ? stored_ : ram_;
            bytes.insert(bytes.end(), block->begin(), block->end());
            if (steps_.empty()) plan();
        } else if (!reply.ok()) {
            return end(refusal(reply), refusal_text(reply));
        }
        if (steps_.empty() && !over()) finish();
    }

private:
    struct Step {
        bool eeprom = false, write = false;
        std::size_t index = 0;  // of the blocks of the row
    };

    static Block block_of(const Bytes& bytes, std::size_t index) {
        Block block;
        std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(index * block_size), block_size,
                    block.begin());
        return block;
    }
    void read(bool eeprom) {
        for (std::size_t i = 0; i < blocks_of(*row_); ++i)
            steps_.push_back({.eeprom = eeprom, .index = i});
    }
    // What is to be written, when all is read.
    void plan() {
        auto ram = ram_, stored = stored_;
        for (auto* bytes : {&ram_, &stored_})
            if (!bytes->empty())
                if (auto fine = set(*row_, value_, *bytes); !fine)
                    return end(JobStatus::failed, fine.error().text());
        for (std::size_t i = 0; i < blocks_of(*row_); ++i) {
            bool store = permanent_ && block_of(stored, i) != block_of(stored_, i);
            if (store) steps_.push_back({.eeprom = true, .write = true, .index = i});
            bool spoilt = store && block_of(stored_, i) != block_of(ram_, i);
            if (spoilt || block_of(ram, i) != block_of(ram_, i))
                steps_.push_back({.write = true, .index = i});
        }
    }
    void finish() {
        for (std::size_t i = 0; i < blocks_of(*row_); ++i)
            reader_.keep(static_cast<std::uint8_t>(row_->block + i), block_of(ram_, i));
        result_.values.push_back(
            {std::string(row_->name), row_->secret ? wire::Value(std::string("(set)")) : std::move(shown_)});
        if (row_->name == "CFG1.MODE")
            result_.values.push_back(
                {"note",
                 wire::Value(std::string("while a gateway has the reader, its section's mode holds"))});
        if (needs_reset(*row_))
            result_.values.push_back(
                {"note",
                 wire::Value(std::string(permanent_ ? "it takes effect after a restart of the reader"
                                                    : "it takes effect only from EEPROM and after a restart "
                                                      "of the reader: set it with --permanent"))});
        end(JobStatus::done);
    }

    const ConfigRow* row_;
    KnownReader& reader_;
    bool permanent_;
    wire::Value value_, shown_;
    std::deque<Step> steps_;
    Bytes ram_, stored_;
};

// --- any command -------------------------------------------------------------------------------------------

// Commands that only look: sent again after a broken link without harm.
bool only_looks(const CommandRow* row) {
    if (row == nullptr) return false;
    auto name = row->name;
    return name.starts_with("Get") || name.starts_with("Read") || name == "ReaderDiagnostic" ||
           name == "Inventory";
}

class ExecuteTask final : public JobTask {
public:
    ExecuteTask(const Execute& job, bool again) { prepare(job, again); }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        return request_;
    }
    bool needs_host_mode() const override { return row_ != nullptr && row_->when == When::host_mode; }
    bool touches_buffer() const override { return row_ != nullptr && row_->when == When::buffer_mode; }
    void answered(const Reply& reply, Now) override {
        if (reply.silent) return end(refusal(reply), refusal_text(reply));
        if (row_ != nullptr)
            decode_reply(*row_, request_->data, reply.status, reply.data, result_.values);
        else if (!reply.data.empty())
            result_.values.push_back(
                {std::string(raw_data), wire::Value(Bytes(reply.data.begin(), reply.data.end()))});
        if (reply.ok() || reply.carries_data() ||
            (row_ != nullptr && row_->on_tags && reply.is(Status::no_transponder))) {
            if (!reply.ok())
                result_.values.insert(result_.values.begin(), {"STATUS", wire::Value(reply.words())});
            return end(reply.is(Status::tag_error) ? JobStatus::failed : JobStatus::done,
                       reply.is(Status::tag_error) ? reply.words() : std::string{});
        }
        end(JobStatus::failed, reply.words());
    }

private:
    void prepare(const Execute& job, bool again) {
        auto& message = job.command;
        if (auto fine = codec().check(message, wire::Direction::to_reader); !fine)
            return end(JobStatus::failed, fine.error().text());
        Bytes bytes;
        if (auto fine = codec().encode(message, wire::Direction::to_reader, bytes); !fine)
            return end(JobStatus::failed, fine.error().text());
        auto look = look_at(bytes, wire::Direction::to_reader);
        if (look.what != Look::What::frame)
            return end(JobStatus::unsupported, "only commands in the advanced frame can be sent");
        // The dialog puts its own frame around it.
        request_ = Request(look.frame.control, Bytes(look.frame.data.begin(), look.frame.data.end()));
        request_->patience = Request::radio_patience;
        row_ = request_->row();
        if (again && !only_looks(row_))
            return end(JobStatus::unknown, "it was sent before the link broke, and is not sent twice");
    }

    std::optional<Request> request_;
    const CommandRow* row_ = nullptr;
};

class RefusedTask final : public JobTask {
public:
    explicit RefusedTask(std::string text) { end(JobStatus::unsupported, std::move(text)); }
    std::optional<Request> next(Now) override { return {}; }
    void answered(const Reply&, Now) override {}
};

}  // namespace

JobResult no_jobs_here() {
    return {.status = JobStatus::unsupported,
            .text =
                "this reader only dials in with notifications, and takes no commands there; give it a "
                "[[reader]] section with harting://, and notify for the notifications",
            .values = {}};
}

std::unique_ptr<JobTask> make_job_task(const JobOrder& order, const Job& job, KnownReader& reader) {
    if (std::holds_alternative<GetInputs>(job)) return std::make_unique<InputsTask>(reader);
    if (auto* change = std::get_if<SetOutputs>(&job))
        return std::make_unique<OutputsTask>(change->changes, order.again, reader);
    if (std::holds_alternative<RestartReader>(job)) return std::make_unique<RestartTask>(order.again);
    if (auto* wanted = std::get_if<GetParameter>(&job)) return std::make_unique<GetParameterTask>(*wanted);
    if (auto* wanted = std::get_if<SetParameter>(&job))
        return std::make_unique<SetParameterTask>(*wanted, reader);
    if (auto* execute = std::get_if<Execute>(&job))
        return std::make_unique<ExecuteTask>(*execute, order.again);
    if (TagSteps::access_of(job) != nullptr) return std::make_unique<TagTask>(order, job, reader);
    return std::make_unique<RefusedTask>("readers of this make have no such command");
}

}  // namespace gantry::harting
