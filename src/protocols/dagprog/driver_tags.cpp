// Tag jobs. No command names a tag: the unit reads or writes whichever is there. So each step first sees who
// that is, and a write is believed only with the serial number of that tag in its answer.
#include <algorithm>
#include <deque>

#include <fmt/format.h>

#include "protocols/dagprog/driver_jobs.hpp"

namespace gantry::dagprog {

using Status = JobResult::Status;

namespace {

constexpr std::chrono::milliseconds detection_time{1500};

class TagTask final : public JobTask {
public:
    TagTask(const JobOrder& order, const Job& job, UnitState& unit)
        : unit_(unit), steps_(job, order.again, {.unit = block_size, .read = 1, .write = 1}) {
        refuse(job);
    }

    std::optional<Request> next() override {
        if (over()) return {};
        if (!step_ && !begin_step()) return {};
        if (queue_.empty()) plan();
        return queue_.front().request;
    }

    void answered(const Reply& reply) override {
        auto action = std::move(queue_.front());
        queue_.pop_front();
        switch (action.what) {
            case Doing::set:
                return on_set(action.request.code, action.value, reply);
            case Doing::serial:
                return on_serial(reply);
            case Doing::detect:
                detected_ = reply;
                return;
            case Doing::stop:
                if (!reply.ok()) return answer(trouble("stopping to read: " + reply.words()));
                unit_.reading.reset();
                return on_detected();
            case Doing::write:
                return on_written(reply);
        }
    }

private:
    enum class Doing : std::uint8_t { set, serial, detect, stop, write };
    struct Action {
        Doing what;
        Request request;
        std::uint32_t value = 0;  // that is set
    };
    // What a step does after the tag is known.
    enum class Stage : std::uint8_t { who, read, write, see };

    void refuse(const Job& job) {
        auto& access = *TagSteps::access_of(job);
        auto kind = unit_.kind();
        auto* read = std::get_if<ReadTag>(&job);
        auto* write = std::get_if<WriteTag>(&job);
        auto bank = read != nullptr ? read->bank : write->bank;
        std::uint64_t first = read != nullptr ? read->offset : write->offset;
        std::uint64_t count = read != nullptr ? read->length : (write->data.size() + 3) / block_size;
        if (bank != Bank::user)
            return end(Status::unsupported, "HF tags have one memory, which is called user");
        if (access.technology != technology(kind) && access.technology != event::Technology::unknown &&
            access.technology != event::Technology::epc_gen2)  // which is what a job says by default
            return end(Status::unsupported, fmt::format("this unit reads {} tags", to_text(kind)));
        if (access.password != 0) return end(Status::unsupported, "these tags know no password");
        if (count > 0 && first + count - 1 > last_block(kind))
            return end(Status::failed, fmt::format("blocks are 0 to {} with this unit", last_block(kind)));
        if (!unit_.proven) return end(Status::failed, std::string(not_proven));
        if (unit_.save_pending)
            return end(Status::failed,
                       "SaveNext was sent: the next setting is kept for good, so send that "
                       "one first");
        if (write == nullptr) return;
        for (std::uint64_t block = first; block < first + count; ++block)
            if (auto why = why_not_written(unit_, static_cast<std::uint32_t>(block)); !why.empty())
                return end(Status::failed, std::move(why));
    }

    bool begin_step() {
        step_ = steps_.next();
        if (!step_) {
            result_ = steps_.result();
            end(result_.status, result_.text);
            return false;
        }
        stage_ = Stage::who;
        serial_.reset();
        id_blocks_.clear();
        return true;
    }

    TagAnswer trouble(std::string text) {
        return {.what = TagAnswer::What::trouble, .text = std::move(text), .data = {}};
    }
    TagAnswer nobody(std::string text) {
        return {.what = TagAnswer::What::no_tag, .text = std::move(text), .data = {}};
    }
    void answer(const TagAnswer& with) {
        queue_.clear();
        step_.reset();
        steps_.answered(with);
    }

    // --- what to ask ---------------------------------------------------------------------------------------

    bool has_serial_command() const { return unit_.kind() == Family::icode1; }
    // Where tags are told apart by their data, those are what is compared.
    bool id_is_data() const { return !unit_.sends_serials() && !unit_.reads_by_asking; }

    void set(Code code, std::uint32_t value) {
        if (unit_.now.at(code) != value) queue_.push_back({Doing::set, unit_.set(code, value), value});
    }
    void detect(std::uint32_t block) {
        set(Code::block_count, 0);
        set(Code::first_block, block);
        set(Code::transmit, has_serial_command() ? transmit_data : transmit_data | transmit_serial);
        auto start = unit_.ask(Code::read_forever);
        start.until = Request::Until::detection;
        start.patience = detection_time;
        start.tries = 1;
        queue_.push_back({Doing::detect, std::move(start)});
        queue_.push_back({Doing::stop, unit_.ask(Code::stop)});
    }
    std::uint32_t id_block() const {
        return unit_.wanted.first_block.value_or(0) +
               static_cast<std::uint32_t>(id_blocks_.size() / block_size);
    }

    void plan() {
        switch (stage_) {
            case Stage::who: {
                if (has_serial_command() && !serial_) {
                    auto request = unit_.ask(Code::read_serial);
                    request.until = Request::Until::serial;
                    queue_.push_back({Doing::serial, std::move(request)});
                    return;
                }
                auto block = step_->what == TagStep::What::read ? step_->offset : 0;
                return detect(id_is_data() && !known_ ? id_block() : block);
            }
            case Stage::read:
            case Stage::see:
                return detect(step_->offset);
            case Stage::write:
                queue_.push_back({Doing::write, unit_.write(Code::write, step_->offset, step_->data)});
                return;
        }
    }

    // --- what came back ------------------------------------------------------------------------------------

    void on_set(Code code, std::uint32_t wanted, const Reply& reply) {
        auto got = number_in(reply);
        if (got) unit_.now.at(code) = got;
        if (got && got == wanted) return;
        auto why = got ? fmt::format("it took {} instead", *got) : reply.words();
        answer(trouble(fmt::format("setting {} to {}: {}", setter(code).parts[0].name, wanted, why)));
    }

    void on_serial(const Reply& reply) {
        if (!reply.ok()) return answer(trouble(fmt::format("asking who is there: {}", reply.words())));
        if (reply.serial->what != Serial::What::number) return answer(nobody("no tag in the field"));
        serial_ = reply.serial->bytes;
        who_is_there();
    }

    event::TagId id_of(std::array<std::uint8_t, 8> serial) const {
        put_in_order(serial, unit_.order, technology(unit_.kind()));
        return event::TagId(serial);
    }

    // The serial number of whoever is there is known: is it the tag of the job?
    void who_is_there() {
        auto there = id_of(*serial_);
        if (known_ ? there == *known_ : there == step_->tag) {
            known_ = there;
            stage_ = after_who();
            return;
        }
        if (known_ || !id_is_data())
            return answer(nobody(fmt::format("another tag is there, {}", to_hex(there.view()))));
        // Its data must tell; they are read next.
    }
    Stage after_who() const { return step_->what == TagStep::What::write ? Stage::write : Stage::read; }

    void on_detected() {
        auto reply = detected_;
        if (!reply.ok() || !reply.block)
            return answer(nobody(reply.error == 2
                                     ? std::string("the unit says \"invalid tag\": is there more "
                                                   "than one in the field?")
                                     : std::string("no tag was read")));
        if (reply.serial && reply.serial->what == Serial::What::number) {
            auto there = id_of(reply.serial->bytes);
            if (serial_ && !(id_of(*serial_) == there))
                return answer(nobody("the tag was changed meanwhile"));
            serial_ = reply.serial->bytes;
        }
        if (!serial_) return answer(nobody("no tag said its serial number"));
        if (stage_ == Stage::who) return on_who(*reply.block);
        if (known_ && !(id_of(*serial_) == *known_))
            return answer(nobody(fmt::format("another tag is there, {}", to_hex(id_of(*serial_).view()))));
        if (stage_ == Stage::see) {
            if (*reply.block == step_->data) return answer({.text = {}, .data = {}});
            return answer(trouble(in_doubt_));
        }
        answer({.text = {}, .data = *reply.block});
    }

    void on_who(const Bytes& block) {
        auto before = stage_;
        who_is_there();
        if (!step_) return;  // answered: somebody else
        if (stage_ == before) {
            id_blocks_.insert(id_blocks_.end(), block.begin(), block.end());
            if (id_blocks_.size() < step_->tag.size) return;  // the next block of the id
            if (!std::ranges::equal(ByteView(id_blocks_).first(step_->tag.size), step_->tag.view()))
                return answer(
                    nobody(fmt::format("another tag is there, its data are {}", to_hex(id_blocks_))));
            known_ = id_of(*serial_);
            stage_ = after_who();
            return;
        }
        // Reading: the block that came with its number is the one that is wanted.
        if (stage_ == Stage::read && step_->what == TagStep::What::read &&
            unit_.now.first_block == step_->offset)
            answer({.text = {}, .data = block});
        else if (step_->what == TagStep::What::look)
            answer({.text = {}, .data = {}});
    }

    void on_written(const Reply& reply) {
        if (reply.what == Reply::What::refused)
            return answer({.what = TagAnswer::What::refused, .text = reply.words(), .data = {}});
        if (reply.serial && reply.serial->what == Serial::What::no_tag)
            return answer(nobody("no tag in the field"));
        if (reply.serial && reply.serial->what == Serial::What::number &&
            !(id_of(reply.serial->bytes) == *known_))
            return answer({.what = TagAnswer::What::refused,
                           .text = fmt::format("another tag was written, {}: it had come into the field at "
                                               "that moment",
                                               to_hex(id_of(reply.serial->bytes).view())),
                           .data = {}});
        if (reply.ok() && reply.block && *reply.block == step_->data) return answer({.text = {}, .data = {}});
        // No write is repeated before it was seen what became of it (section 6).
        in_doubt_ = reply.serial ? std::string(to_text(reply.serial->what)) : reply.words();
        if (reply.block) in_doubt_ = fmt::format("the unit says it wrote {}", to_hex(*reply.block));
        if (in_doubt_.empty()) in_doubt_ = "the unit did not say what it wrote";
        stage_ = Stage::see;
    }

    UnitState& unit_;
    TagSteps steps_;
    std::optional<TagStep> step_;
    Stage stage_ = Stage::who;
    std::deque<Action> queue_;
    Reply detected_;
    std::optional<std::array<std::uint8_t, 8>> serial_;  // of whoever is there in this step
    std::optional<event::TagId> known_;  // the serial number of the job's tag, once it is known
    Bytes id_blocks_;                    // the data that tell it, while they are gathered
    std::string in_doubt_;
};

}  // namespace

std::unique_ptr<JobTask> make_tag_task(const JobOrder& order, const Job& job, UnitState& unit) {
    return std::make_unique<TagTask>(order, job, unit);
}

}  // namespace gantry::dagprog
