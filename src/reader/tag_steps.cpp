#include "reader/tag_steps.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace gantry {

using Status = JobResult::Status;
using What = TagStep::What;

std::optional<event::TagId> id_after_write(const event::TagId& tag, std::uint32_t word, ByteView data) {
    auto words = data.size() / 2;
    auto pc_at = word <= 1 && word + words > 1 ? std::optional((1 - word) * 2) : std::nullopt;
    std::size_t size = pc_at ? std::size_t{data[*pc_at]} >> 3 << 1 : tag.size;
    event::TagId after;
    if (size > event::TagId::max_size) return {};
    after.size = static_cast<std::uint8_t>(size);
    for (std::size_t i = 0; i < size; ++i) {
        auto at = 4 + i;  // in the bank
        if (at >= 2 * std::size_t{word} && at < 2 * std::size_t{word} + data.size())
            after.data[i] = data[at - 2 * std::size_t{word}];
        else if (i < tag.size)
            after.data[i] = tag.data[i];
        else
            return {};
    }
    return after;
}

std::uint32_t password_after_write(std::uint32_t password, std::uint32_t word, ByteView data) {
    static constexpr std::size_t first = 4, size = 4;  // bytes in the bank
    for (std::size_t i = 0; i < size; ++i) {
        auto at = first + i, from = 2 * std::size_t{word};
        auto shift = 8 * (size - 1 - i);
        if (at >= from && at < from + data.size())
            password = (password & ~(0xFFU << shift)) | std::uint32_t{data[at - from]} << shift;
    }
    return password;
}

// Words of a bank of a Gen2 tag; other kinds have neither an id nor a password that can be written so.
static bool writes_to(const Job& job, Bank bank) {
    auto* write = std::get_if<WriteTag>(&job);
    return write != nullptr && write->bank == bank && write->access.technology == event::Technology::epc_gen2;
}

const TagAccess* TagSteps::access_of(const Job& job) {
    return std::visit(
        [](auto& each) -> const TagAccess* {
            if constexpr (requires { each.access; })
                return &each.access;
            else
                return nullptr;
        },
        job);
}

TagSteps::TagSteps(const Job& job, bool again, Limits limits)
    : job_(job), limits_(limits), now_{access_of(job)->tag, access_of(job)->password} {
    auto* read = as<ReadTag>();
    auto* write = as<WriteTag>();
    if (now_.id.size == 0) {
        end(Status::failed, "no tag is named; name one by its id");
        return;
    }
    if (read != nullptr && read->length == 0) {
        end(Status::failed, "a length of 0 reads nothing");
        return;
    }
    if (write != nullptr && (write->data.empty() || write->data.size() % limits_.unit != 0)) {
        end(Status::failed,
            fmt::format("{} bytes are no whole units of this tag's memory; give a multiple of {} bytes",
                        write->data.size(), limits_.unit));
        return;
    }
    // A lock is the same when it is repeated, and reading changes nothing.
    bool look = again && read == nullptr && as<LockTag>() == nullptr;
    if (auto* program = as<ProgramTag>(); look && program != nullptr) look = !(program->new_id == now_.id);
    if (look)
        enter_look();
    else
        enter_act();
}

std::optional<TagStep> TagSteps::next() const {
    if (stage_ == Stage::over) return {};
    auto step = steps_.front();
    step.password = now_.password;
    return step;
}

void TagSteps::end(Status status, std::string text) {
    stage_ = Stage::over;
    steps_.clear();
    result_.status = status;
    result_.text = std::move(text);
}

std::optional<event::TagId> TagSteps::next_id() const {
    if (auto* program = as<ProgramTag>()) return program->new_id;
    auto* write = as<WriteTag>();
    return writes_to(job_, Bank::epc) ? id_after_write(now_.id, write->offset, write->data) : now_.id;
}

std::optional<TagSteps::Face> TagSteps::next_face() const {
    auto id = next_id();
    if (!id) return {};
    auto* write = as<WriteTag>();
    return Face{.id = *id,
                .password = writes_to(job_, Bank::reserved)
                                ? password_after_write(now_.password, write->offset, write->data)
                                : now_.password};
}

// --- stages ------------------------------------------------------------------------------------------------

void TagSteps::plan_read(Bank bank, std::uint32_t offset, std::uint32_t length) {
    while (length > 0) {
        auto piece = std::min(length, limits_.read);
        steps_.push_back({.what = What::read,
                          .tag = now_.id,
                          .bank = bank,
                          .offset = offset,
                          .length = piece,
                          .data = {}});
        offset += piece;
        length -= piece;
    }
}

// Each piece addresses the tag by the id that the pieces before it have left.
void TagSteps::plan_write(const WriteTag& job) {
    bool id_changes = writes_to(job, Bank::epc);
    auto tag = now_.id;
    auto offset = job.offset;
    for (ByteView left(job.data); !left.empty();) {
        auto size = std::min<std::size_t>(left.size(), std::size_t{limits_.write} * limits_.unit);
        auto piece = left.first(size);
        auto units = static_cast<std::uint32_t>(size / limits_.unit);
        steps_.push_back({.what = What::write,
                          .tag = tag,
                          .bank = job.bank,
                          .offset = offset,
                          .length = units,
                          .data = Bytes(piece.begin(), piece.end())});
        if (id_changes) tag = id_after_write(tag, offset, piece).value_or(tag);
        offset += units;
        left = left.subspan(size);
    }
}

void TagSteps::look_back() {
    steps_.clear();
    gathered_.clear();
    now_ = faces_[face_];
    if (auto* write = as<WriteTag>())
        plan_read(write->bank, write->offset, static_cast<std::uint32_t>(write->data.size() / limits_.unit));
    else
        steps_.push_back(
            {.what = What::look, .tag = now_.id, .bank = Bank::epc, .offset = 0, .length = 0, .data = {}});
}

void TagSteps::enter_look() {
    stage_ = Stage::look;
    faces_.clear();
    if (auto next = next_face(); next && !(*next == now_)) faces_.push_back(*next);
    faces_.push_back(now_);
    face_ = 0;
    tries_ = 0;
    look_back();
}

void TagSteps::enter_act() {
    stage_ = Stage::act;
    steps_.clear();
    gathered_.clear();
    tries_ = 0;
    written_ = 0;
    if (auto* read = as<ReadTag>()) return plan_read(read->bank, read->offset, read->length);
    if (auto* write = as<WriteTag>()) return plan_write(*write);
    auto what = as<LockTag>() != nullptr ? What::lock : as<KillTag>() != nullptr ? What::kill : What::program;
    steps_.push_back(
        {.what = what, .tag = now_.id, .bank = Bank::user, .offset = 0, .length = 0, .data = {}});
}

void TagSteps::enter_verify() {
    auto next = next_face();
    if (!next) {
        result_.values.push_back(
            {"note", wire::Value(std::string("not read back: the tag's new id cannot be told"))});
        return end(Status::done);
    }
    stage_ = Stage::verify;
    faces_ = {*next};
    face_ = 0;
    tries_ = 0;
    look_back();
}

// --- answers -----------------------------------------------------------------------------------------------

void TagSteps::answered(const TagAnswer& answer) {
    if (stage_ == Stage::over) return;
    auto& step = steps_.front();
    bool changes = step.what != What::look && step.what != What::read;
    // Nobody there and a refusal leave the tag as it was; anything else may have changed it.
    if (changes && (answer.what == TagAnswer::What::done || answer.what == TagAnswer::What::trouble))
        touched_ = true;
    switch (answer.what) {
        case TagAnswer::What::done:
            if (step.what == What::read) {
                if (answer.data.size() != std::size_t{step.length} * limits_.unit) {
                    auto text = fmt::format("the reader gave {} bytes instead of {}", answer.data.size(),
                                            step.length * limits_.unit);
                    return stage_ == Stage::act ? end(Status::failed, std::move(text)) : cannot_be_seen(text);
                }
                gathered_.insert(gathered_.end(), answer.data.begin(), answer.data.end());
            }
            if (step.what == What::write) {
                written_ += step.data.size();
                if (writes_to(job_, Bank::reserved))
                    now_.password = password_after_write(now_.password, step.offset, step.data);
            }
            tries_ = 0;
            steps_.pop_front();
            if (steps_.empty()) stage_done();
            return;
        case TagAnswer::What::no_tag:
            if (stage_ != Stage::act) return nobody_there(answer);
            break;
        case TagAnswer::What::trouble:
            if (changes) in_doubt_ = answer.text;
            break;
        case TagAnswer::What::refused:
        case TagAnswer::What::unsupported:
            tries_ = access().retries;  // it would say so again
            break;
    }
    // To a wrong password a tag may say anything: the other one is tried before that counts.
    if (stage_ == Stage::look && face_ + 1 < faces_.size() &&
        faces_[face_].password != faces_[face_ + 1].password) {
        tries_ = 0;
        ++face_;
        return look_back();
    }
    if (tries_++ < access().retries) return;
    if (stage_ != Stage::act) return cannot_be_seen(answer.text);
    act_failed(answer);
}

void TagSteps::cannot_be_seen(const std::string& why) {
    if (stage_ == Stage::look)
        return end(Status::unknown,
                   fmt::format(
                       "it was sent before the link broke, and whether it was done cannot be seen: {}", why));
    end(Status::unknown,
        fmt::format("{}, but it cannot be read back: {}", in_doubt_.empty() ? "written" : in_doubt_, why));
}

void TagSteps::stage_done() {
    auto* write = as<WriteTag>();
    bool same = write == nullptr || gathered_ == write->data;
    switch (stage_) {
        case Stage::look: {
            bool is_next = as<ProgramTag>() != nullptr && face_ == 0 && faces_.size() > 1;
            if (is_next || (write != nullptr && same)) {
                result_.values.push_back(
                    {"note", wire::Value(std::string("it was done before the link broke"))});
                return end(Status::done);
            }
            return enter_act();  // for a kill: the tag still answers
        }
        case Stage::act: {
            if (as<ReadTag>() != nullptr) result_.values.push_back({"data", wire::Value(gathered_)});
            auto* program = as<ProgramTag>();
            if ((write != nullptr && write->verify) || (program != nullptr && program->verify))
                return enter_verify();
            return end(Status::done);
        }
        case Stage::verify:
            if (same) return end(Status::done);
            if (rewrites_++ < access().retries) return enter_act();
            // The reserved bank holds passwords: they are nobody's to read in a job's text.
            return end(Status::failed, write->bank == Bank::reserved
                                           ? std::string("what was read back is not what was written")
                                           : fmt::format("read back {} after writing {}", to_hex(gathered_),
                                                         to_hex(write->data)));
        case Stage::over:
            return;
    }
}

// A stage that looks asks for each id that the tag may have before that counts as a try.
void TagSteps::nobody_there(const TagAnswer& answer) {
    if (++face_ == faces_.size()) {
        face_ = 0;
        if (tries_++ >= access().retries) {
            if (stage_ == Stage::look)
                return end(Status::unknown,
                           as<KillTag>() != nullptr
                               ? "it was sent before the link broke, and the tag no longer answers: "
                                 "it may have been killed"
                               : "it was sent before the link broke, and the tag does not answer now: "
                                 "whether it was done is not known");
            if (!in_doubt_.empty()) return end(Status::failed, in_doubt_);
            return end(Status::unknown,
                       fmt::format("done, but the tag does not answer afterwards: {}", answer.text));
        }
    }
    look_back();
}

void TagSteps::act_failed(const TagAnswer& answer) {
    auto text = answer.text;
    bool tried_again = answer.what == TagAnswer::What::no_tag || answer.what == TagAnswer::What::trouble;
    if (tried_again && tries_ > 1) text += fmt::format(", after {} tries", tries_);
    if (answer.what == TagAnswer::What::unsupported && !touched_)
        return end(Status::unsupported, std::move(text));
    text += in_part();
    if (in_doubt_.empty()) return end(Status::failed, std::move(text));
    if (answer.what == TagAnswer::What::no_tag && as<KillTag>() != nullptr)
        return end(Status::unknown,
                   fmt::format("the reader first said \"{}\", and now the tag no longer answers: it may "
                               "have been killed",
                               in_doubt_));
    // Its id or password may have changed though the reader said no: look with the new one.
    if (auto next = next_face(); next && !(*next == now_)) return enter_verify();
    end(Status::failed, std::move(text));
}

std::string TagSteps::in_part() const {
    auto* write = as<WriteTag>();
    if (write == nullptr || written_ == 0) return {};
    return fmt::format("; the first {} of {} bytes were written", written_, write->data.size());
}

}  // namespace gantry
