#include "protocols/harting/driver_tags.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "protocols/harting/records.hpp"

namespace gantry::harting {

using JobStatus = JobResult::Status;
using What = TagStep::What;
using Said = TagAnswer::What;

namespace {
constexpr std::uint32_t epc_at_word = 2, pc_at_word = 1;

TagSteps::Limits limits_for(const KnownReader& reader) {
    // Section 6.4: (TX-BUF - 10) / (DB-SIZE + 1) blocks; writes are kept as small as clients make them.
    std::uint32_t most = reader.send_limit > 13 ? (reader.send_limit - 10U) / 3 : 32;
    return {.unit = 2, .read = std::clamp<std::uint32_t>(most, 1, 64), .write = 32};
}

std::string impossible(const Job& job) {
    if (auto* lock = std::get_if<LockTag>(&job); lock != nullptr && (lock->address || lock->mask == 0))
        return "Gen2 tags are locked by bank or password, not by address";
    if (auto* program = std::get_if<ProgramTag>(&job)) {
        if (program->new_id.size == 0 || program->new_id.size % 2 != 0)
            return "a Gen2 id has whole words: give 2, 4, ... bytes";
        if (program->numbering_system > 0x1FF) return "a numbering system has nine bits: 0 to 0x1FF";
    }
    if (auto* read = std::get_if<ReadTag>(&job);
        read != nullptr && read->offset + std::uint64_t{read->length} > 0x10000)
        return "the address is beyond what this make can name (word 65535)";
    if (auto* write = std::get_if<WriteTag>(&job);
        write != nullptr && write->offset + std::uint64_t{write->data.size() / 2} > 0x10000)
        return "the address is beyond what this make can name (word 65535)";
    return {};
}

// The TID that came with an observation.
ByteView tid_of(const Observation& seen, const Bytes& data) {
    auto from = ByteView(data).subspan(std::min<std::size_t>(seen.data_offset, data.size()));
    std::size_t size = seen.tid_size != 0 ? seen.tid_size : seen.data_bank == Bank::tid ? seen.data_size : 0;
    return from.first(std::min(size, from.size()));
}

Bytes big_endian(std::uint32_t value) {
    Bytes out;
    wire::Writer(out).u32(value);
    return out;
}
}  // namespace

TagTask::TagTask(const JobOrder& order, const Job& job, KnownReader& reader)
    : job_(job), reader_(reader), steps_(job, order.again, limits_for(reader)) {
    auto antenna = access().antenna;
    if (access().technology != event::Technology::epc_gen2)
        end(JobStatus::unsupported,
            fmt::format("this make has no commands for {} tags", event::to_text(access().technology)));
    else if (auto why = impossible(job_); !why.empty())
        end(JobStatus::failed, std::move(why));
    else if (antenna && (*antenna < 1 || *antenna > 4))
        end(JobStatus::failed, fmt::format("there is no antenna {}; there are 1 to 4", *antenna));
}

std::optional<Request> TagTask::next(Now) {
    if (over()) {
        // The antennas back to what the configuration says.
        if (!std::exchange(antenna_set_, false)) return {};
        asked_ = Asked::antenna_back;
        return Request(Command::rf_reset);
    }
    if (access().antenna && !antenna_set_) {
        asked_ = Asked::antenna;
        antenna_set_ = true;  // the reader may do it though its answer is lost
        return Request(Command::rf_output, {static_cast<std::uint8_t>(*access().antenna)});
    }
    auto step = steps_.next();
    if (!step) {
        auto& done = steps_.result();
        for (auto& value : done.values)
            result_.values.push_back(value);
        end(done.status, done.text);
        return next({});
    }
    return step_request(*step);
}

std::optional<Request> TagTask::step_request(const TagStep& step) {
    auto& tids = reader_.tids;
    bool by_tid = tids.value_or(!looked_);
    if (by_tid && !(uid_ && uid_of_ == step.tag)) {
        asked_ = Asked::scan;
        return Request(Command::inventory, {more_ ? inventory_more : std::uint8_t{0}});
    }
    asked_ = Asked::step;
    switch (step.what) {
        case What::look:
            return command({.command = Command::read_multiple_blocks,
                            .bank = static_cast<std::uint8_t>(Bank::epc),
                            .address = epc_at_word,
                            .count = static_cast<std::uint8_t>(step.tag.size / 2)},
                           step);
        case What::read:
            return command({.command = Command::read_multiple_blocks,
                            .bank = static_cast<std::uint8_t>(step.bank),
                            .address = static_cast<std::uint16_t>(step.offset),
                            .count = static_cast<std::uint8_t>(step.length)},
                           step);
        case What::write:
            return command({.command = Command::write_multiple_blocks,
                            .bank = static_cast<std::uint8_t>(step.bank),
                            .address = static_cast<std::uint16_t>(step.offset),
                            .count = static_cast<std::uint8_t>(step.data.size() / 2),
                            .data = step.data},
                           step);
        case What::lock: {
            auto& lock = std::get<LockTag>(job_);
            return command({.command = Command::lock, .data = lock_data(lock.mask, lock.action)}, step);
        }
        case What::kill: {
            TagCommand kill{.command = Command::kill,
                            .mode = addressed | uid_length,
                            .password = big_endian(std::get<KillTag>(job_).kill_password)};
            return command(std::move(kill), step);
        }
        case What::program: {
            auto& program = std::get<ProgramTag>(job_);
            auto id = program.new_id.view();
            Bytes data;
            wire::Writer writer(data);
            writer.u16(id.size() / 2 << 11 | program.numbering_system);
            writer.bytes(id);
            return command({.command = Command::write_multiple_blocks,
                            .bank = static_cast<std::uint8_t>(Bank::epc),
                            .address = pc_at_word,
                            .count = static_cast<std::uint8_t>(data.size() / 2),
                            .data = data},
                           step);
        }
    }
    return {};
}

Request TagTask::command(TagCommand command, const TagStep& step) const {
    auto id = step.tag.view();
    command.uid = uid_ && uid_of_ == step.tag ? *uid_ : Bytes(id.begin(), id.end());
    if (step.password != 0 && command.command != Command::kill) {
        command.password = big_endian(step.password);
        command.bank |= bank_password;
    }
    if (command.command == Command::lock && command.password.empty()) command.password = big_endian(0);
    Bytes data;
    append_tag_command(command, data);
    Request request(control_of(command.command), std::move(data));
    request.patience = Request::radio_patience;
    return request;
}

void TagTask::answered(const Reply& reply, Now) {
    if (reply.silent && asked_ != Asked::antenna_back)
        return end(JobStatus::timed_out, "the reader did not answer: what it did is not known");
    switch (std::exchange(asked_, Asked::nothing)) {
        case Asked::antenna:
            if (!reply.ok())
                end(JobStatus::failed, fmt::format("the antenna cannot be chosen: {}", reply.words()));
            return;
        case Asked::scan:
            return scanned(reply);
        case Asked::step:
            return step_answered(reply);
        case Asked::antenna_back:
            if (!reply.ok())
                result_.values.push_back(
                    {"note",
                     wire::Value(fmt::format("the antennas are not back as configured: {}", reply.words()))});
            return;
        case Asked::nothing:
            return;
    }
}

// Where inventories carry EPC and TID, the TID is what the reader calls the tag (section 6.2).
void TagTask::scanned(const Reply& reply) {
    auto step = steps_.next();
    if (!step) return;
    // Not a read: nobody asked for the tags around.
    std::vector<Observation> all;
    Bytes data;
    if (reply.carries_data()) walk_inventory(reply.data, 0, false, all, data);
    for (auto& seen : all) {
        if (!(seen.tag == step->tag)) continue;
        auto tid = tid_of(seen, data);
        reader_.tids = !tid.empty();
        uid_ = tid.empty() ? Bytes(seen.tag.view().begin(), seen.tag.view().end())
                           : Bytes(tid.begin(), tid.end());
        uid_of_ = step->tag;
    }
    bool found = uid_ && uid_of_ == step->tag;
    more_ = !found && reply.is(Status::more_data);
    // Nobody has seen yet how its inventories name tags: then by the EPC, as the reader comes.
    if (!found && !more_ && !reader_.tids) {
        looked_ = true;
        return;
    }
    if (!found && !more_)
        tell(Said::no_tag, reply.ok() || reply.is(Status::more_data) ? "it is not among the tags in the field"
                                                                     : reply.words());
}

void TagTask::step_answered(const Reply& reply) {
    auto step = steps_.next();
    if (!step) return;
    if (reply.ok()) {
        if (step->what != What::read && step->what != What::look) return tell(Said::done, {});
        // DB-N, DB-SIZE, then a security status before each block (section 6.4).
        Bytes data;
        wire::Reader in(reply.data);
        auto count = in.u8("DB-N");
        auto size = in.u8("DB-SIZE");
        for (unsigned i = 0; i < count && !in.fault(); ++i) {
            auto secured = in.u8("SEC-STATUS");
            auto block = in.bytes(size, "DB");
            if (secured != 0 && !in.fault())
                return tell(Said::refused, fmt::format("block {} is secured", i));
            data.insert(data.end(), block.begin(), block.end());
        }
        auto wanted = step->what == What::look ? std::size_t{step->tag.size} : 2 * std::size_t{step->length};
        if (in.fault() || data.size() != wanted)
            return tell(Said::trouble, fmt::format("the reader gave {} bytes, not {}", data.size(), wanted));
        if (step->what == What::look && !std::ranges::equal(data, step->tag.view()))
            return tell(Said::no_tag, "another tag answered");
        return tell(Said::done, {}, std::move(data));
    }
    auto words = reply.words();
    switch (static_cast<Status>(reply.status)) {
        case Status::no_transponder:
            return tell(Said::no_tag, words);
        case Status::write_error:
        case Status::data_false:
        case Status::rf_communication_error:
        case Status::rf_warning:
        case Status::busy:
            return tell(Said::trouble, words);
        case Status::tag_error: {
            constexpr std::uint8_t insufficient_power = 0x0B;
            bool power = !reply.data.empty() && reply.data.front() == insufficient_power;
            return tell(power ? Said::trouble : Said::refused, words);
        }
        case Status::unknown_command:
        case Status::command_not_available:
            return tell(Said::unsupported, words);
        default:
            return tell(Said::refused, words);
    }
}

void TagTask::tell(Said what, std::string text, Bytes data) {
    // After its id was written the tag is called by its new one: TIDs stay.
    steps_.answered({.what = what, .text = std::move(text), .data = std::move(data)});
}

}  // namespace gantry::harting
