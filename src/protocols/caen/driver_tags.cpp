#include "protocols/caen/driver_tags.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"

namespace gantry::caen {

using Status = JobResult::Status;
using What = TagStep::What;
using Said = TagAnswer::What;
using event::Technology;

// A pair with memory data holds at most 128 bytes (section 4, 0x4D).
static constexpr TagSteps::Limits gen2_limits{.unit = 2, .read = 64, .write = 64};
static constexpr TagSteps::Limits byte_limits{.unit = 1, .read = 128, .write = 128};
static constexpr std::uint32_t epc_at_byte = 4, pc_at_byte = 2;  // in the EPC bank (section 6)
static constexpr std::int64_t multiprotocol = 4, unspecified_protocol = 255;

static const TagSteps::Limits& limits_for(const Job& job) {
    return TagSteps::access_of(job)->technology == Technology::epc_gen2 ? gen2_limits : byte_limits;
}

// What cannot be said in this make's commands, whatever the reader: empty text when nothing is wrong.
static JobResult impossible(const Job& job) {
    auto no = [](Status status, std::string text) {
        return JobResult{.status = status, .text = std::move(text), .values = {}};
    };
    auto& access = *TagSteps::access_of(job);
    auto* lock = std::get_if<LockTag>(&job);
    auto* kill = std::get_if<KillTag>(&job);
    auto* program = std::get_if<ProgramTag>(&job);
    std::uint64_t offset = 0, length = 0;
    if (auto* read = std::get_if<ReadTag>(&job)) {
        offset = read->offset;
        length = read->length;
    } else if (auto* write = std::get_if<WriteTag>(&job)) {
        offset = write->offset;
        length = write->data.size() / limits_for(job).unit;
    } else if (lock != nullptr && lock->address) {
        offset = *lock->address;
    }
    if ((offset + length) * limits_for(job).unit > 0x10000)
        return no(Status::failed, "the address is beyond what this make can name (65535 bytes)");
    switch (access.technology) {
        case Technology::epc_gen2:
            if (lock != nullptr && (lock->address || lock->mask == 0))
                return no(Status::failed, "Gen2 tags are locked by bank or password, not by address");
            if (program != nullptr && (program->new_id.size == 0 || program->new_id.size % 2 != 0))
                return no(Status::failed, "a Gen2 id has whole words: give 2, 4, ... bytes");
            if (program != nullptr && program->numbering_system > 0x1FF)
                return no(Status::failed, "a numbering system has nine bits: 0 to 0x1FF");
            return {};
        case Technology::iso18000_6b:
            if (kill != nullptr || program != nullptr)
                return no(Status::unsupported, "ISO 18000-6B tags have a fixed id and no kill");
            if (lock != nullptr && !lock->address)
                return no(Status::failed, "ISO 18000-6B tags are locked byte by byte: give an address");
            return {};
        case Technology::epc_gen1:
            if (kill == nullptr && program == nullptr)
                return no(Status::unsupported, "EPC Gen1 tags can only be programmed and killed");
            if (access.password > 0xFFFF || (kill != nullptr && kill->kill_password > 0xFFFF))
                return no(Status::failed, "EPC Gen1 passwords have 16 bits");
            return {};
        case Technology::epc_1_19:
            if (program == nullptr)
                return no(Status::unsupported, "EPC 1.19 tags can only be programmed with this make");
            return {};
        default:
            return no(Status::unsupported, fmt::format("this make has no commands for {} tags",
                                                       event::to_text(access.technology)));
    }
}

TagTask::TagTask(const JobOrder& order, const Job& job, const JobContext& context)
    : job_(job),
      reader_(context.reader),
      reports_(context.reports),
      steps_(job, order.again, limits_for(job)) {
    auto fault = impossible(job_);
    if (!fault.text.empty()) finish(fault.status, std::move(fault.text));
    for (auto& each : reader_.sources)
        sources_.push_back(each.name);
}

void TagTask::finish(Status status, std::string text) {
    end(status, std::move(text));
    stage_ = before_ ? Stage::back : Stage::over;
}

std::optional<Request> TagTask::next(Now) {
    if (over() && stage_ != Stage::over) stage_ = before_ ? Stage::back : Stage::over;
    auto wanted = tag_type_of(access().technology);
    if (stage_ == Stage::protocol) {
        if (!reader_.protocol && reader_.has(Command::get_protocol)) return Request(Command::get_protocol);
        stage_ = Stage::switching;
    }
    if (stage_ == Stage::switching) {
        auto now = reader_.protocol.value_or(unspecified_protocol);
        if (now != wanted && now != multiprotocol && now != unspecified_protocol) {
            before_ = now;
            Request request(Command::set_protocol);
            request.number(Attribute::protocol, static_cast<std::uint64_t>(wanted));
            return request;
        }
        stage_ = Stage::source;
    }
    if (stage_ == Stage::source) {
        choose_sources();
        if (stage_ == Stage::source) {
            Request request(Command::check_read_point_in_source);
            request.text(Attribute::read_point_name, read_point_name(*access().antenna));
            request.text(Attribute::source_name, sources_[checked_]);
            return request;
        }
    }
    while (stage_ == Stage::steps)
        if (auto request = step_request()) return request;
    if (stage_ == Stage::back) {
        Request request(Command::set_protocol);
        request.number(Attribute::protocol, static_cast<std::uint64_t>(*before_));
        return request;
    }
    return {};
}

// The one that has the antenna: as composed by the settings, else as the reader says, else by its number
// (table 4.2: Source_n holds Ant_n). Leaves the stage when no question is left.
void TagTask::choose_sources() {
    auto antenna = access().antenna;
    if (!antenna || sources_.empty()) {
        stage_ = Stage::steps;
        if (sources_.empty()) finish(Status::failed, "no source of this reader is read");
        return;
    }
    auto name = read_point_name(*antenna);
    for (auto& each : reader_.sources)
        if (std::ranges::find(each.read_points, name) != each.read_points.end()) {
            sources_ = {each.name};
            stage_ = Stage::steps;
            return;
        }
    if (reader_.has(Command::check_read_point_in_source) && checked_ < sources_.size()) return;
    bool numbered = std::ranges::find(sources_, source_name(*antenna)) != sources_.end();
    if (!numbered || reader_.has(Command::check_read_point_in_source))
        return finish(Status::failed, fmt::format("no source that is read has the antenna {}", name));
    sources_ = {source_name(*antenna)};
    stage_ = Stage::steps;
}

void TagTask::answered(const Reply& reply, Now now) {
    switch (stage_) {
        case Stage::protocol:
            stage_ = Stage::switching;  // ReaderState::learn took it, if it came
            return;
        case Stage::switching:
            if (!reply.ok()) {
                if (!reply.silent) before_.reset();  // else it may have switched all the same
                return finish(
                    reply.silent ? Status::timed_out : Status::failed,
                    fmt::format("the reader does not take the tag's air protocol: {}", reply.words()));
            }
            stage_ = Stage::source;
            return;
        case Stage::source:
            if (reply.ok() && reply.parsed.number(Attribute::boolean).value_or(0) != 0) {
                sources_ = {sources_[checked_]};
                stage_ = Stage::steps;
            }
            ++checked_;
            return;
        case Stage::steps:
            if (over()) return;
            if (reply.silent)
                return finish(Status::timed_out, "the reader did not answer: what it did is not known");
            return asked_ == Asked::scan || asked_ == Asked::alone ? scanned(reply) : step_answered(reply);
        case Stage::back: {
            auto* was = protocols.find(*before_);
            auto name = was != nullptr ? std::string(was->name) : fmt::format("protocol {}", *before_);
            auto note = reply.ok() ? fmt::format("the reader left {} for this tag, and is back", name)
                                   : fmt::format("the reader did not go back to {}: {}", name, reply.words());
            if (!reply.ok()) reports_.notice(FaultNotice{fault_setting, note, {}}, now);
            result_.values.push_back({"note", wire::Value(std::move(note))});
            before_.reset();
            stage_ = Stage::over;
            return;
        }
        case Stage::over:
            return;
    }
}

// --- steps -------------------------------------------------------------------------------------------------

// Nothing: the step was answered without a command.
std::optional<Request> TagTask::step_request() {
    auto step = steps_.next();
    if (!step) {
        auto& done = steps_.result();
        for (auto& value : done.values)
            result_.values.push_back(value);
        finish(done.status, done.text);
        return {};
    }
    asked_ = Asked::step;
    auto request = access().technology == Technology::epc_gen2 ? gen2_request(*step) : other_request(*step);
    if (request && !reader_.has(static_cast<Command>(request->command))) {
        if (request->is(Command::g2_write) && step->what == What::program && !plain_program_) {
            plain_program_ = true;
            return step_request();
        }
        tell(Said::unsupported, fmt::format("{} has no {}", reader_.model_name(), request->name()));
        return {};
    }
    return request;
}

Request TagTask::addressed(Command command, const event::TagId& tag) const {
    Request request(command);
    request.text(Attribute::source_name, source());
    request.number(Attribute::tag_id_len, tag.size);
    request.bytes(Attribute::tag_id, tag.view());
    return request;
}

// Clients leave the password out when it is zero (section 6).
static void add_password(Request& request, std::uint32_t password) {
    if (password != 0) request.number(Attribute::g2_password, password);
}

static void add_memory(Request& request, Bank bank, std::uint32_t byte, std::size_t bytes) {
    request.number(Attribute::memory_bank, static_cast<std::uint64_t>(bank));
    request.number(Attribute::tag_address, byte);
    request.number(Attribute::length, bytes);
}

std::optional<Request> TagTask::gen2_request(const TagStep& step) {
    switch (step.what) {
        case What::look:
        case What::read: {
            bool look = step.what == What::look;
            auto request = addressed(step, Command::g2_read);
            add_memory(request, look ? Bank::epc : step.bank, look ? epc_at_byte : 2 * step.offset,
                       look ? std::size_t{step.tag.size} : 2 * std::size_t{step.length});
            add_password(request, step.password);
            return request;
        }
        case What::write: {
            auto request = addressed(step, Command::g2_write);
            add_memory(request, step.bank, 2 * step.offset, step.data.size());
            request.bytes(Attribute::tag_value, step.data);
            add_password(request, step.password);
            return request;
        }
        case What::lock: {
            auto& lock = std::get<LockTag>(job_);
            auto request = addressed(step, Command::g2_lock);
            request.number(Attribute::payload, (lock.mask & 0x3FFU) << 10 | (lock.action & 0x3FFU));
            add_password(request, step.password);
            return request;
        }
        case What::kill: {
            auto request = addressed(step, Command::g2_kill);
            request.number(Attribute::g2_password, std::get<KillTag>(job_).kill_password);
            return request;
        }
        case What::program: {
            auto& program = std::get<ProgramTag>(job_);
            auto id = program.new_id.view();
            if (plain_program_) {
                if (!alone_) {
                    asked_ = Asked::alone;
                    return scan_request();
                }
                asked_ = Asked::program;
                auto request = addressed(Command::g2_program_id, program.new_id);
                request.number(Attribute::g2_nsi, program.numbering_system);
                add_password(request, step.password);
                return request;
            }
            // G2ProgramID names no tag: whichever is there gets the id. PC and EPC are written to the tag
            // that is meant instead.
            Bytes data;
            wire::Writer writer(data);
            writer.u16(id.size() / 2 << 11 | program.numbering_system);
            writer.bytes(id);
            auto request = addressed(step, Command::g2_write);
            add_memory(request, Bank::epc, pc_at_byte, data.size());
            request.bytes(Attribute::tag_value, data);
            add_password(request, step.password);
            return request;
        }
    }
    return {};
}

std::optional<Request> TagTask::other_request(const TagStep& step) {
    switch (step.what) {
        case What::look:
            asked_ = Asked::scan;
            return scan_request();
        case What::read: {
            auto request = addressed(step, Command::read_tag_data);
            request.number(Attribute::tag_address, step.offset).number(Attribute::length, step.length);
            return request;
        }
        case What::write: {
            auto request = addressed(step, Command::write_tag_data);
            request.number(Attribute::tag_address, step.offset).number(Attribute::length, step.data.size());
            request.bytes(Attribute::tag_value, step.data);
            return request;
        }
        case What::lock: {
            auto request = addressed(step, Command::lock_tag);
            request.number(Attribute::tag_address, *std::get<LockTag>(job_).address);
            return request;
        }
        case What::kill: {
            auto request = addressed(step, Command::kill_tag);
            request.number(Attribute::epc_password, std::get<KillTag>(job_).kill_password);
            return request;
        }
        case What::program: {
            auto& to = std::get<ProgramTag>(job_).new_id;
            if (access().technology == Technology::epc_1_19) {
                Request request(Command::e119_program_id);
                request.text(Attribute::source_name, source());
                request.bytes(Attribute::tag_id, step.tag.view()).bytes(Attribute::tag_value, to.view());
                return request;
            }
            if (!alone_) {  // ProgramID names no tag either
                asked_ = Asked::alone;
                return scan_request();
            }
            asked_ = Asked::program;
            auto request = addressed(Command::program_id, to);
            request.number(Attribute::epc_password, access().password).number(Attribute::boolean, 0);
            return request;
        }
    }
    return {};
}

std::optional<Request> TagTask::scan_request() const {
    bool raw = raw_scan_ || !reader_.has(Command::inventory_tag);
    Request request(raw ? Command::raw_read_ids : Command::inventory_tag);
    request.text(Attribute::source_name, source());
    return request;
}

// --- answers -----------------------------------------------------------------------------------------------

// Result codes as TagSteps sees them (section 5).
static Said kind_of(std::uint16_t result) {
    switch (static_cast<ResultCode>(result)) {
        case ResultCode::success:
            return Said::done;
        case ResultCode::tag_not_present:
            return Said::no_tag;
        case ResultCode::unknown_error:
        case ResultCode::tag_write_error:
        case ResultCode::tag_read_error:
        case ResultCode::insufficient_power:
        case ResultCode::tag_error:
        case ResultCode::kill_error:
            return Said::trouble;
        case ResultCode::invalid_function:
        case ResultCode::invalid_command:
            return Said::unsupported;
        default:
            return Said::refused;
    }
}

void TagTask::step_answered(const Reply& reply) {
    auto step = steps_.next();
    if (!step) return;
    if (!reply.parsed.result) return tell(Said::trouble, reply.words());
    if (reply.lacks() && step->what == What::program && !plain_program_ &&
        access().technology == Technology::epc_gen2 && reader_.has(Command::g2_program_id)) {
        plain_program_ = true;
        return;
    }
    alone_ = false;  // looked at again before each try
    TagAnswer answer{.what = kind_of(*reply.parsed.result), .text = reply.words(), .data = {}};
    if (auto* value = reply.parsed.find(Attribute::tag_value); value != nullptr && step->what == What::read)
        answer.data.assign(value->value.begin(), value->value.end());
    tell(std::move(answer));
}

// Which tags are in front of the source.
void TagTask::scanned(const Reply& reply) {
    auto step = steps_.next();
    if (!step) return;
    if (reply.lacks() && !raw_scan_ && reader_.has(Command::raw_read_ids)) {
        raw_scan_ = true;
        return;
    }
    if (!reply.ok() && !reply.is(ResultCode::tag_not_present))
        return tell(reply.parsed.result ? kind_of(*reply.parsed.result) : Said::trouble, reply.words());
    std::vector<event::TagId> ids;
    for (auto& pair : reply.parsed.avps) {
        if (!pair.is(Attribute::tag_id) || pair.value.empty() || pair.value.size() > event::TagId::max_size)
            continue;
        event::TagId id(pair.value);
        if (std::ranges::find(ids, id) == ids.end()) ids.push_back(id);
    }
    if (std::ranges::find(ids, step->tag) == ids.end())
        return tell(Said::no_tag, describe(static_cast<std::uint16_t>(ResultCode::tag_not_present)));
    if (asked_ == Asked::scan) return tell(Said::done, {});
    if (ids.size() > 1)
        return tell(Said::refused,
                    fmt::format("{} tags are in front of {}, and this command cannot say which of them it "
                                "means; leave only the one",
                                ids.size(), source()));
    alone_ = true;
}

void TagTask::tell(Said what, std::string text) {
    tell(TagAnswer{.what = what, .text = std::move(text), .data = {}});
}

// Nobody answered: that is so only when every source was tried.
void TagTask::tell(TagAnswer answer) {
    if (answer.what == Said::no_tag && ++tried_ < sources_.size()) {
        source_ = (source_ + 1) % sources_.size();
        return;
    }
    tried_ = 0;
    steps_.answered(answer);
}

}  // namespace gantry::caen
