#include "protocols/dagprog/driver_jobs.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/dagprog/codec.hpp"

namespace gantry::dagprog {

using Status = JobResult::Status;

Status JobTask::status_of(const Reply& reply) {
    switch (reply.what) {
        case Reply::What::answered:
            return Status::done;
        case Reply::What::refused:
            return Status::failed;
        case Reply::What::silent:
            break;
    }
    return Status::timed_out;
}

std::string why_not_written(const UnitState& unit, std::uint32_t block) {
    if (!unit.proven) return std::string(not_proven);
    if (unit.kind() == Family::icode1 && block < icode1_system_blocks && !unit.rewrites_system_blocks)
        return fmt::format(
            "block {} of an ICODE1 tag holds its number, locks or functions, and cannot be "
            "undone; the reader's setting force_system_blocks = true allows it",
            block);
    return {};
}

namespace {

struct Parameter {
    Code code;
    ParameterRow row;
};
// SV keeps the first block, the block count and the power-up mode; the transmission mode only until the unit
// is switched off (section 6).
constexpr std::array all = {
    Parameter{Code::first_block,
              {.name = "FirstBlock",
               .unit = {},
               .help = "first block that is read with a tag; kept for good when it is set",
               .min = 0,
               .max = 15}},
    Parameter{Code::block_count,
              {.name = "BlockCountMinus1",
               .unit = {},
               .help = "how many blocks more are read with it; kept for good when it is set",
               .min = 0,
               .max = 15}},
    Parameter{Code::transmit,
              {.name = "TransmitMode",
               .unit = {},
               .help = "what is sent of a tag; until the unit is switched off",
               .enumeration = &transmit_modes}},
    Parameter{Code::power_up,
              {.name = "PowerUpMode",
               .unit = {},
               .help = "how it reads after power-up (ISO15693); kept for good when it is set",
               .enumeration = &power_up_modes}},
    Parameter{Code::version, {.name = "Version", .unit = {}, .help = "of its firmware", .writable = false}},
};

const Parameter* find_parameter(std::string_view name) {
    for (auto& each : all)
        if (alike(each.row.name, name)) return &each;
    return nullptr;
}

wire::Value value_in(const Parameter& parameter, const std::string& text) {
    auto number = parse_number({.name = "", .kind = Kind::decimal, .size = 5}, text);
    if (parameter.code == Code::version || !number) return wire::Value(text);
    auto* named = parameter.row.enumeration != nullptr ? parameter.row.enumeration->find(*number) : nullptr;
    if (named != nullptr) return wire::Value(std::string(named->name));
    return wire::Value(*number);
}

class GetTask final : public JobTask {
public:
    GetTask(const std::string& name, UnitState& unit) : unit_(unit), everything_(name.empty()) {
        for (auto& each : all)
            if (everything_ ? query(each.code).known_to(unit.kind()) : alike(each.row.name, name))
                wanted_.push_back(&each);
        if (wanted_.empty())
            end(Status::failed, fmt::format("there is no parameter \"{}\"", printable(name)));
        else if (!query(wanted_[0]->code).known_to(unit.kind()))
            end(Status::unsupported,
                fmt::format("units for {} have no {}", to_text(unit.kind()), wanted_[0]->row.name));
    }
    bool needs_rest() const override { return false; }
    std::optional<Request> next() override {
        if (over()) return {};
        return unit_.ask(wanted_[at_]->code);
    }
    void answered(const Reply& reply) override {
        auto& parameter = *wanted_[at_];
        if (!reply.ok() || reply.values.empty()) return end(reply);
        result_.values.push_back({std::string(parameter.row.name), value_in(parameter, reply.values[0])});
        if (++at_ == wanted_.size()) end(Status::done);
    }

private:
    UnitState& unit_;
    bool everything_;
    std::vector<const Parameter*> wanted_;
    std::size_t at_ = 0;
};

// SV before what it can keep, the value, and its echo.
class SetTask final : public JobTask {
public:
    SetTask(const SetParameter& job, UnitState& unit) : unit_(unit), parameter_(find_parameter(job.name)) {
        prepare(job);
    }
    std::optional<Request> next() override {
        if (over()) return {};
        return save_ ? unit_.ask(Code::save) : unit_.set(parameter_->code, value_);
    }
    void answered(const Reply& reply) override {
        if (!reply.ok()) return end(reply);
        if (save_) {
            save_ = false;
            unit_.save_pending = true;
            return;
        }
        unit_.save_pending = false;
        auto got = number_in(reply);
        if (parameter_->code != Code::power_up) {
            unit_.now.at(parameter_->code) = got;
            unit_.wanted.at(parameter_->code) = got;
        }
        if (got != value_) return end(Status::failed, fmt::format("the unit has {} now", got ? *got : 0));
        result_.values.push_back({std::string(parameter_->row.name), value_in(*parameter_, reply.values[0])});
        end(Status::done);
    }

private:
    void prepare(const SetParameter& job) {
        if (parameter_ == nullptr)
            return end(Status::failed, fmt::format("there is no parameter \"{}\"", printable(job.name)));
        if (!parameter_->row.writable)
            return end(Status::failed, fmt::format("{} cannot be set", parameter_->row.name));
        auto& row = setter(parameter_->code);
        if (!row.known_to(unit_.kind()))
            return end(Status::unsupported,
                       fmt::format("units for {} have no {}", to_text(unit_.kind()), parameter_->row.name));
        if (!unit_.proven) return end(Status::failed, std::string(not_proven));
        auto& part = row.parts[0];
        auto number = wire::as_number(wire::Value(job.value), part.enumeration);
        auto most = max_of(part, unit_.kind());
        bool named = part.enumeration == nullptr || (number && part.enumeration->find(*number) != nullptr);
        if (!number || *number < 0 || *number > most || !named)
            return end(Status::failed,
                       fmt::format("\"{}\" is no {} of this unit; it is {}", printable(job.value),
                                   parameter_->row.name, legal(part, most)));
        value_ = static_cast<std::uint32_t>(*number);
        save_ = parameter_->code != Code::transmit;
    }
    static std::string legal(const PartRow& part, std::int64_t most) {
        if (part.enumeration == nullptr) return fmt::format("a number from 0 to {}", most);
        std::vector<std::string_view> names;
        for (auto& row : part.enumeration->rows)
            if (row.value <= most) names.push_back(row.name);
        return fmt::format("one of {}", fmt::join(names, ", "));
    }

    UnitState& unit_;
    const Parameter* parameter_;
    std::uint32_t value_ = 0;
    bool save_ = false;
};

// Any command by name. What it changes of the registers is what is wanted from then on.
class ExecuteTask final : public JobTask {
public:
    ExecuteTask(const Execute& job, bool again, UnitState& unit) : unit_(unit) {
        prepare(job.command, again);
    }

    bool needs_rest() const override {
        return row_ != nullptr && (row_->sets() || row_->code == Code::read_serial || is_mode());
    }
    std::optional<Request> next() override {
        if (over()) return {};
        return request_;
    }
    void answered(const Reply& reply) override {
        if (row_->answer == Answer::none) return end(Status::done);
        if (!reply.ok()) return end(reply);
        if (row_->answer == Answer::write) return on_written(reply);
        if (row_->answer == Answer::serial) return on_serial(reply);
        learn(reply);
        auto* answer = find_answer();
        for (std::size_t i = 0; i < answer->parts.size() && i < reply.values.size(); ++i)
            result_.values.push_back(
                {std::string(answer->parts[i].name), shown(answer->parts[i], reply.values[i])});
        end(Status::done);
    }

private:
    bool is_mode() const {
        return row_->code == Code::read_forever || row_->code == Code::read_checked ||
               row_->code == Code::read_once;
    }
    const MessageRow* find_answer() const {
        for (auto& each : messages())
            if (each.code == row_->code && each.direction == wire::Direction::to_host) return &each;
        return row_;
    }
    static wire::Value shown(const PartRow& part, const std::string& text) {
        auto number = parse_number(part, text);
        if (part.kind == Kind::text || !number) return wire::Value(text);
        auto* named = part.enumeration != nullptr ? part.enumeration->find(*number) : nullptr;
        if (named != nullptr) return wire::Value(std::string(named->name));
        return wire::Value(*number);
    }

    void prepare(const wire::Message& given, bool again) {
        static constexpr auto direction = wire::Direction::to_reader;
        auto message = given;
        if (wire::find(message.header, "stx") == nullptr && wire::find(message.fields, "stx") == nullptr)
            message.header.push_back({"stx", wire::Value(unit_.forms.stx)});
        if (wire::find(message.header, "separator") == nullptr &&
            wire::find(message.fields, "separator") == nullptr)
            message.header.push_back({"separator", wire::Value(std::string(to_text(unit_.forms.separator)))});
        Bytes bytes;
        if (auto fine = codec().check(message, direction); !fine)
            return end(Status::failed, fine.error().text());
        if (auto fine = codec().encode(message, direction, bytes); !fine)
            return end(Status::failed, fine.error().text());
        row_ = find_message(message.name, direction);
        if (!row_->known_to(unit_.kind()))
            return end(Status::unsupported,
                       fmt::format("units for {} have no {}", to_text(unit_.kind()), row_->name));
        bool looks = row_->parts.empty() && row_->code != Code::save;
        if (again && !looks)
            return end(Status::unknown, "it was sent before the link broke, and is not sent twice");
        if (row_->sets() && !unit_.proven) return end(Status::failed, std::string(not_proven));
        if (auto refusal = check_ranges(bytes); !refusal.empty()) return end(Status::failed, refusal);
        request_.line = std::move(bytes);
        request_.code = row_->code;
        if (row_->answer == Answer::none) request_.until = Request::Until::time;
        if (row_->answer == Answer::serial) request_.until = Request::Until::serial;
        if (row_->answer == Answer::write) {
            request_.until = Request::Until::written;
            request_.patience = write_time;
        }
    }
    std::string check_ranges(const Bytes& bytes) {
        if (!row_->sets()) return {};
        auto look = look_at(bytes, wire::Direction::to_reader);
        auto line = parse_line(look.body, wire::Direction::to_reader);
        for (std::size_t i = 0; i < row_->parts.size(); ++i) {
            auto most = max_of(row_->parts[i], unit_.kind());
            if (most >= 0 && line.number(i) > most)
                return fmt::format("{} is {} at most with this unit", row_->parts[i].name, most);
        }
        if (row_->answer != Answer::write) return {};
        block_ = static_cast<std::uint32_t>(line.number(0));
        data_ = from_hex(line.parts[1]).value_or(Bytes{});
        return why_not_written(unit_, block_);
    }

    void learn(const Reply& reply) {
        if (row_->code == Code::save) unit_.save_pending = true;
        if (is_mode()) unit_.reading = row_->code;
        if (row_->code == Code::stop) unit_.reading.reset();
        bool is_register = row_->code == Code::first_block || row_->code == Code::block_count ||
                           row_->code == Code::transmit;
        if (!row_->sets()) return;
        if (row_->code != Code::transmit) unit_.save_pending = false;
        if (!is_register) return;
        unit_.now.at(row_->code) = number_in(reply);
        unit_.wanted.at(row_->code) = number_in(reply);
    }

    void on_serial(const Reply& reply) {
        if (reply.serial->what != Serial::What::number)
            return end(Status::failed, std::string(to_text(reply.serial->what)));
        result_.values.push_back(
            {"SerialNumber", wire::Value(Bytes(reply.serial->bytes.begin(), reply.serial->bytes.end()))});
        end(Status::done);
    }
    void on_written(const Reply& reply) {
        if (reply.serial && reply.serial->what != Serial::What::number)
            return end(Status::failed, std::string(to_text(reply.serial->what)));
        if (!reply.block) return end(Status::unknown, "the unit did not say what it wrote");
        if (reply.serial)
            result_.values.push_back(
                {"SerialNumber", wire::Value(Bytes(reply.serial->bytes.begin(), reply.serial->bytes.end()))});
        result_.values.push_back({"Data", wire::Value(*reply.block)});
        auto expected = data_;
        expected.resize(row_->code == Code::write ? block_size : block_size - 1);
        if (!std::ranges::equal(expected, ByteView(*reply.block).first(expected.size())))
            return end(Status::failed, fmt::format("block {} holds {} now", block_, to_hex(*reply.block)));
        if (row_->code == Code::write_crc8) {
            unit_.finder.sample(*reply.block);
            if (unit_.crc8 != nullptr && !crc8_fits(*unit_.crc8, *reply.block))
                return end(Status::failed, fmt::format("written, but the unit's CRC8 of {} is not {}",
                                                       to_hex(*reply.block), unit_.crc8->name));
        }
        end(Status::done);
    }

    UnitState& unit_;
    const MessageRow* row_ = nullptr;
    Request request_;
    std::uint32_t block_ = 0;
    Bytes data_;
};

class RefusedTask final : public JobTask {
public:
    explicit RefusedTask(std::string text) { end(Status::unsupported, std::move(text)); }
    bool needs_rest() const override { return false; }
    std::optional<Request> next() override { return {}; }
    void answered(const Reply&) override {}
};

const std::vector<ParameterRow>& parameter_rows() {
    static const auto rows = [] {
        std::vector<ParameterRow> made;
        for (auto& each : all)
            made.push_back(each.row);
        return made;
    }();
    return rows;
}

}  // namespace

std::span<const ParameterRow> parameters() {
    return parameter_rows();
}

std::unique_ptr<JobTask> make_job_task(const JobOrder& order, const Job& job, UnitState& unit) {
    if (auto* get = std::get_if<GetParameter>(&job)) return std::make_unique<GetTask>(get->name, unit);
    if (auto* set = std::get_if<SetParameter>(&job)) return std::make_unique<SetTask>(*set, unit);
    if (auto* execute = std::get_if<Execute>(&job))
        return std::make_unique<ExecuteTask>(*execute, order.again, unit);
    if (std::holds_alternative<ReadTag>(job) || std::holds_alternative<WriteTag>(job))
        return make_tag_task(order, job, unit);
    if (TagSteps::access_of(job) != nullptr)
        return std::make_unique<RefusedTask>("this make can read and write tags; it has no command for this");
    return std::make_unique<RefusedTask>("this make has no such command");
}

}  // namespace gantry::dagprog
