#include "protocols/caen/driver_jobs.hpp"

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/caen/codec.hpp"
#include "protocols/caen/driver_tags.hpp"

namespace gantry::caen {

using Status = JobResult::Status;

std::optional<Steady> OutputTimers::next() const {
    std::optional<Steady> first;
    for (auto& [output, timer] : due)
        first = first ? std::min(*first, timer.at) : timer.at;
    return first;
}

void JobTask::end(Status status, std::string text) {
    over_ = true;
    result_.status = status;
    result_.text = std::move(text);
}

namespace {

Status refusal(const Reply& reply) {
    if (reply.silent) return Status::timed_out;
    return reply.lacks() ? Status::unsupported : Status::failed;
}

std::string refusal_text(const Reply& reply) {
    return reply.silent ? "the reader did not answer: what it did is not known"
                        : fmt::format("the reader answered: {}", reply.words());
}

// --- inputs and outputs ------------------------------------------------------------------------------------

// Inputs are the low bits of the register and outputs the bits above them (section 4, 0x69). A reader whose
// model is not known is taken to have four of each.
struct Lines {
    unsigned inputs = 4, outputs = 4;

    explicit Lines(const ReaderState& reader) {
        if (reader.model == nullptr) return;
        inputs = reader.model->inputs;
        outputs = reader.model->outputs;
    }
    std::uint32_t bit_of_output(std::uint16_t output) const { return 1U << (inputs + output - 1U); }
};

class InputsTask final : public JobTask {
public:
    explicit InputsTask(const ReaderState& reader) : reader_(reader) {}
    std::optional<Request> next(Now) override {
        if (over()) return {};
        if (!reader_.has(Command::get_io)) {
            end(Status::unsupported, fmt::format("{} has no inputs", reader_.model_name()));
            return {};
        }
        return Request(Command::get_io);
    }
    void answered(const Reply& reply, Now) override {
        auto lines = reply.parsed.number(Attribute::io_register);
        if (!reply.ok() || !lines) return end(refusal(reply), refusal_text(reply));
        wire::Value::List inputs;
        for (unsigned i = 0; i < Lines(reader_).inputs; ++i) {
            wire::Fields input;
            input.push_back({"input", wire::Value(i + 1)});
            input.push_back({"state", wire::Value((*lines >> i & 1) != 0)});
            inputs.emplace_back(std::move(input));
        }
        result_.values.push_back({"inputs", wire::Value(std::move(inputs))});
        end(Status::done);
    }

private:
    const ReaderState& reader_;
};

class OutputsTask final : public JobTask {
public:
    OutputsTask(std::vector<OutputChange> changes, bool again, const JobContext& context)
        : changes_(std::move(changes)), context_(context) {
        auto fault = refuse(again);
        if (!fault.text.empty()) end(fault.status, std::move(fault.text));
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        if (!register_) return Request(Command::get_io);
        auto lines = *register_;
        for (auto& change : changes_) {
            auto bit = Lines(context_.reader).bit_of_output(change.output);
            lines = change.state ? lines | bit : lines & ~bit;
        }
        Request request(Command::set_io);
        request.number(Attribute::io_register, lines);
        return request;
    }
    void answered(const Reply& reply, Now now) override {
        auto lines = reply.parsed.number(Attribute::io_register);
        if (!reply.ok() || (!register_ && !lines)) return end(refusal(reply), refusal_text(reply));
        if (!register_) {
            register_ = *lines;
            return;
        }
        for (auto& change : changes_) {
            context_.outputs.due.erase(change.output);
            if (change.for_ms != 0)
                context_.outputs.due[change.output] = {
                    .at = now.steady + std::chrono::milliseconds{change.for_ms}, .state = !change.state};
        }
        end(Status::done);
    }

private:
    struct Fault {
        Status status = Status::failed;
        std::string text = {};
    };
    Fault refuse(bool again) const {
        if (!context_.reader.has(Command::set_io))
            return {Status::unsupported, fmt::format("{} has no outputs", context_.reader.model_name())};
        if (changes_.empty()) return {Status::failed, "no output is named; name one, as in 1=on"};
        std::set<std::uint16_t> named;
        for (auto& change : changes_) {
            auto outputs = Lines(context_.reader).outputs;
            if (change.output < 1 || change.output > outputs)
                return {Status::unsupported, fmt::format("there is no output {}; {} has {}", change.output,
                                                         context_.reader.model_name(), outputs)};
            if (!named.insert(change.output).second)
                return {Status::failed, fmt::format("output {} is named twice", change.output)};
            if (again && change.for_ms != 0)
                return {Status::unknown,
                        "it was sent before the link broke; a timed output is not switched twice"};
        }
        return {};
    }

    std::vector<OutputChange> changes_;
    JobContext context_;
    std::optional<std::uint32_t> register_;
};

// --- parameters --------------------------------------------------------------------------------------------

Request get_request(const ParameterBinding& binding) {
    Request request(binding.get);
    if (!binding.source.empty()) {
        request.text(Attribute::source_name, binding.source);
        request.number(Attribute::config_parameter, static_cast<std::uint64_t>(binding.config_parameter));
    }
    return request;
}

std::optional<wire::Value> value_of(const ParameterBinding& binding, const Reply& reply) {
    auto& row = row_of(binding.answer);
    auto* pair = reply.parsed.find(binding.answer);
    if (!reply.ok() || pair == nullptr) return {};
    if (row.kind == Kind::text) return wire::Value(printable(pair->text()));
    auto number = pair->number();
    if (!number) return {};
    auto* named = row.enumeration != nullptr ? row.enumeration->find(std::int64_t{*number}) : nullptr;
    if (named != nullptr) return wire::Value(std::string(named->name));
    return wire::Value(*number);
}

class GetParameterTask final : public JobTask {
public:
    GetParameterTask(std::string_view name, const ReaderState& reader) : all_(name.empty()) {
        for (auto& binding : parameters())
            if (all_ && reader.has(binding.get) && has_source(reader, binding)) wanted_.push_back(&binding);
        if (all_) {
            if (wanted_.empty())
                end(Status::unsupported, fmt::format("{} has no parameters", reader.model_name()));
            return;
        }
        auto* binding = find_parameter(name);
        if (binding == nullptr)
            end(Status::failed, fmt::format("there is no parameter \"{}\"", printable(name)));
        else if (!reader.has(binding->get))
            end(Status::unsupported, fmt::format("{} has no {}", reader.model_name(), binding->name));
        else
            wanted_.push_back(binding);
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        return get_request(*wanted_[at_]);
    }
    bool may_pause() const override { return all_ && !over(); }  // dozens of commands
    void answered(const Reply& reply, Now) override {
        auto& binding = *wanted_[at_];
        if (auto value = value_of(binding, reply)) {
            result_.values.push_back({std::string(binding.name), std::move(*value)});
        } else if (!all_ || reply.silent) {
            end(refusal(reply), refusal_text(reply));
            return;
        }
        if (++at_ < wanted_.size()) return;
        // Of all parameters those that the reader refuses are left out.
        if (result_.values.empty())
            end(Status::failed, "the reader gave none of its parameters");
        else
            end(Status::done);
    }

private:
    static bool has_source(const ReaderState& reader, const ParameterBinding& binding) {
        return binding.source.empty() ||
               std::ranges::find(reader.sources, binding.source, &Source::name) != reader.sources.end();
    }

    bool all_;
    std::vector<const ParameterBinding*> wanted_;
    std::size_t at_ = 0;
};

class SetParameterTask final : public JobTask {
public:
    SetParameterTask(const SetParameter& job, bool again, const ReaderState& reader)
        : binding_(find_parameter(job.name)), look_(again) {
        prepare(job, reader);
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        if (look_) return get_request(*binding_);
        Request request = get_request(*binding_);
        request.command = static_cast<std::uint16_t>(binding_->set);
        if (number_)
            request.number(binding_->argument, static_cast<std::uint64_t>(*number_));
        else
            request.text(binding_->argument, text_);
        return request;
    }
    void answered(const Reply& reply, Now) override {
        if (look_) {
            look_ = false;
            auto value = value_of(*binding_, reply);
            if (value && *value == wanted()) finish("it was done before the link broke");
            return;
        }
        if (!reply.ok()) return end(refusal(reply), refusal_text(reply));
        finish();
    }

private:
    void prepare(const SetParameter& job, const ReaderState& reader) {
        if (binding_ == nullptr)
            return end(Status::failed, fmt::format("there is no parameter \"{}\"", printable(job.name)));
        if (binding_->set == binding_->get)
            return end(Status::failed, fmt::format("{} cannot be set", binding_->name));
        if (!reader.has(binding_->set))
            return end(Status::unsupported,
                       fmt::format("{} cannot set {}", reader.model_name(), binding_->name));
        auto& row = row_of(binding_->argument);
        if (row.kind == Kind::text) {
            if (job.value.size() >= row.size || !is_printable_ascii(job.value))
                return end(Status::failed, fmt::format("{} is a text of at most {} characters",
                                                       binding_->name, row.size - 1));
            text_ = job.value;
            return;
        }
        auto number = wire::as_number(wire::Value(job.value), row.enumeration);
        auto most = (std::uint64_t{1} << (8 * row.size)) - 1;
        if (!number || *number < 0 || static_cast<std::uint64_t>(*number) > most ||
            (row.min <= row.max && (*number < row.min || *number > row.max)))
            return end(Status::failed, expected(row, most, job.value));
        number_ = *number;
    }
    void finish(std::string note = {}) {
        result_.values.push_back({std::string(binding_->name), wanted()});
        if (!note.empty()) result_.values.push_back({"note", wire::Value(std::move(note))});
        end(Status::done);
    }
    wire::Value wanted() const {
        if (!number_) return wire::Value(text_);
        auto* names = row_of(binding_->argument).enumeration;
        auto* named = names != nullptr ? names->find(*number_) : nullptr;
        if (named != nullptr) return wire::Value(std::string(named->name));
        return wire::Value(*number_);
    }
    std::string expected(const AttributeRow& row, std::uint64_t most, std::string_view given) const {
        if (row.enumeration != nullptr) {
            std::vector<std::string_view> names;
            for (auto& each : row.enumeration->rows)
                names.push_back(each.name);
            return fmt::format("\"{}\" is no {}; it is one of: {}", printable(given), binding_->name,
                               fmt::join(names, ", "));
        }
        bool limited = row.min <= row.max;
        return fmt::format("\"{}\" is no {}; it is a number from {} to {}", printable(given), binding_->name,
                           limited ? row.min : 0, limited ? static_cast<std::uint64_t>(row.max) : most);
    }

    const ParameterBinding* binding_;
    bool look_;
    std::optional<std::int64_t> number_;
    std::string text_;
};

// --- any command -------------------------------------------------------------------------------------------

// Commands that only look: sent again after a broken link without harm.
bool only_looks(const CommandRow& row) {
    auto name = row.name;
    return name.starts_with("Get") || name.starts_with("Check") || name == "RawReadIDs" ||
           name == "InventoryTag" || name == "ReadTagData" || name == "G2Read" || name == "G2Query" ||
           name == "G2QueryAck";
}

class ExecuteTask final : public JobTask {
public:
    ExecuteTask(const Execute& job, bool again, const ReaderState& reader) : reader_(reader) {
        prepare(job.command, again);
    }
    std::optional<Request> next(Now) override {
        if (over()) return {};
        return request_;
    }
    void answered(const Reply& reply, Now) override {
        if (reply.silent) return end(refusal(reply), refusal_text(reply));
        auto decoded = codec().decode(reply.message, wire::Direction::to_host, true);
        if (!decoded.message)
            return end(Status::failed,
                       fmt::format("the reader's answer cannot be read: {}", decoded.message.error().text()));
        result_.values = std::move(decoded.message->fields);
        turn_status(reply);
        if (reply.ok())
            end(Status::done);
        else
            end(Status::failed, reply.words());
    }

private:
    void prepare(const wire::Message& message, bool again) {
        if (auto fine = codec().check(message, wire::Direction::to_reader); !fine)
            return end(Status::failed, fine.error().text());
        Bytes bytes;
        if (auto fine = codec().encode(message, wire::Direction::to_reader, bytes); !fine)
            return end(Status::failed, fine.error().text());
        auto parsed = parse(bytes);
        auto header = read_header(bytes);
        if (parsed.fault || !parsed.command || !header || header->undefined_length())
            return end(Status::unsupported,
                       fmt::format("{} is no command with an answer", printable(message.name)));
        if (*parsed.command == static_cast<std::uint16_t>(Command::inventory_tag) &&
            (parsed.number(Attribute::bitmask).value_or(0) & (flag_framed | flag_continuous)) != 0)
            return end(Status::unsupported,
                       "a framed stream is not a job: set mode = \"framed\" for this reader");
        auto* row = find_command(*parsed.command);
        if (again && (row == nullptr || !only_looks(*row)))
            return end(Status::unknown, "it was sent before the link broke, and is not sent twice");
        // The dialog puts its own header and the command in front.
        request_ =
            Request(*parsed.command, Bytes(bytes.begin() + header_size + avp_header_size + 2, bytes.end()));
        request_->patience = Request::first_inventory_patience;
    }

    // Manuals before revision 19 count the states of a read point the other way round (section 12, I3), and
    // the tables' names are the later ones.
    void turn_status(const Reply& reply) {
        if (reader_.model == nullptr || reader_.model->revision >= 19) return;
        auto status = reply.parsed.number(Attribute::read_point_status);
        auto* named = status ? read_point_states.find(2 - std::int64_t{*status}) : nullptr;
        if (named == nullptr) return;
        for (auto& field : result_.values)
            if (field.name == row_of(Attribute::read_point_status).name)
                field.value = wire::Value(std::string(named->name));
    }

    const ReaderState& reader_;
    std::optional<Request> request_;
};

class RefusedTask final : public JobTask {
public:
    explicit RefusedTask(std::string text) { end(Status::unsupported, std::move(text)); }
    std::optional<Request> next(Now) override { return {}; }
    void answered(const Reply&, Now) override {}
};

}  // namespace

// Its readers have one value of a parameter, and keep it or not as they see fit.
static bool wants_permanence(const Job& job) {
    if (auto* get = std::get_if<GetParameter>(&job)) return get->permanent;
    if (auto* set = std::get_if<SetParameter>(&job)) return set->permanent;
    return false;
}

std::unique_ptr<JobTask> make_job_task(const JobOrder& order, const Job& job, const JobContext& context) {
    if (wants_permanence(job))
        return std::make_unique<RefusedTask>(
            "this make's readers keep no parameter over a power-down at will");
    if (std::holds_alternative<GetInputs>(job)) return std::make_unique<InputsTask>(context.reader);
    if (auto* set = std::get_if<SetOutputs>(&job))
        return std::make_unique<OutputsTask>(set->changes, order.again, context);
    if (auto* get = std::get_if<GetParameter>(&job))
        return std::make_unique<GetParameterTask>(get->name, context.reader);
    if (auto* set = std::get_if<SetParameter>(&job))
        return std::make_unique<SetParameterTask>(*set, order.again, context.reader);
    if (auto* execute = std::get_if<Execute>(&job))
        return std::make_unique<ExecuteTask>(*execute, order.again, context.reader);
    if (TagSteps::access_of(job) != nullptr) return std::make_unique<TagTask>(order, job, context);
    return std::make_unique<RefusedTask>("readers of this make have no such command");
}

std::unique_ptr<JobTask> make_output_task(const JobContext& context, Steady now) {
    std::vector<OutputChange> changes;
    for (auto& [output, timer] : context.outputs.due)
        if (timer.at <= now) changes.push_back({.output = output, .state = timer.state});
    for (auto& change : changes)
        context.outputs.due.erase(change.output);
    return std::make_unique<OutputsTask>(std::move(changes), false, context);
}

}  // namespace gantry::caen
