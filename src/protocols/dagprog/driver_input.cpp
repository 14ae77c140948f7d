// What the unit says, as it comes: tags, answers to what is under way, and what nobody asked for.
#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/dagprog/driver.hpp"

namespace gantry::dagprog {

using Status = JobResult::Status;

void DagprogDriver::received(ByteView bytes, Now now) {
    if (finished_) return;
    count(Count::bytes, bytes.size());
    framer_.give(bytes);
    take_lines(now);
    framer_.settle();
    check_stream();
    advance(now);
    flush(now);
}

void DagprogDriver::take_lines(Now now) {
    while (!finished_) {
        if (!gathers_tags()) {
            auto& to = report(now);
            auto before = walker_.lines();
            auto used = walker_.walk(framer_.front(), now.steady, to.observations, to.data);
            framer_.took(used, walker_.lines() - before);
            if (used > 0) {
                heard_ = now.steady;
                unanswered_ = 0;
            }
        }
        auto line = framer_.next();
        if (!line) break;
        on_line(*line, now);
    }
}

// While the walker is away, tag lines are the answer to what is under way.
bool DagprogDriver::gathers_tags() const {
    if (!under_way_) return false;
    auto until = under_way_->request.until;
    return until == Request::Until::serial || until == Request::Until::written ||
           until == Request::Until::detection;
}

void DagprogDriver::on_line(const Line& line, Now now) {
    heard_ = now.steady;
    unanswered_ = 0;
    skipped_at_line_ = framer_.tally().skipped;
    if (line.row == nullptr) {
        count(Count::unknown_code);
        auto text = fmt::format("the unit sent an unknown message: \"{}\"", printable(line.body));
        notice(fault_malformed, std::move(text), now, Bytes(line.body.begin(), line.body.end()));
        return;
    }
    if (line.row->code == Code::banner) return restarted(line, now);
    if (line.fault) {
        count(Count::malformed);
        notice(fault_malformed, fmt::format("a message that cannot be read: {}", line.fault->text()), now,
               Bytes(line.body.begin(), line.body.end()));
        return;
    }
    // What a register is now is known from every answer that tells it, also from a late one.
    auto code = line.row->code;
    if (code == Code::first_block || code == Code::block_count || code == Code::transmit)
        unit_.now.at(code) = static_cast<std::uint32_t>(line.number(0));
    if (belongs_to_request(line)) {
        if (under_way_->reply.ok() || under_way_->reply.what == Reply::What::refused)
            complete(now, under_way_->reply.what);
        return;
    }
    switch (code) {
        case Code::block_data:
        case Code::serial_number:
            return on_tag_line(line, now);
        case Code::error: {
            auto error = line.number(0);
            if (error == 1) count(Count::bad_checksum);
            auto* named = errors.find(error);
            notice(error,
                   named != nullptr && error == 1 ? "the CRC8 of a tag's block is wrong"
                   : named != nullptr ? "the unit says \"invalid tag\": more than one may be in the field"
                                      : fmt::format("the unit reports error {}", error),
                   now);
            return;
        }
        case Code::ready:
            if (phase_ == Phase::opening) begin_identifying(now);
            return;
        case Code::unknown_command:
            notice(fault_setting, "the unit did not understand something: \"??\"", now);
            return;
        default:
            return;  // an answer that nobody waits for any more
    }
}

void DagprogDriver::on_tag_line(const Line& line, Now now) {
    auto& to = report(now);
    if (line.row->code == Code::block_data) {
        std::array<std::uint8_t, block_size> data{};
        parse_hex(line.parts[1], data.data(), data.size());
        return walker_.block(static_cast<std::uint8_t>(line.number(0)), data.data(), now.steady,
                             to.observations, to.data);
    }
    auto serial = parse_serial(line.parts[0]).value_or(Serial{});
    if (serial.what == Serial::What::number)
        walker_.serial(serial.bytes, now.steady, to.observations, to.data);
    else if (doing_ == Doing::nothing || phase_ != Phase::ready)
        notice(fault_reading, fmt::format("the unit says: {}", to_text(serial.what)), now);
}

// Takes what the request under way waits for into its reply; `answered` or `refused` there ends it.
bool DagprogDriver::belongs_to_request(const Line& line) {
    if (!under_way_) return false;
    auto& [request, due, sent, echoed, reply] = *under_way_;
    auto code = line.row->code;
    if (code == Code::unknown_command) {
        if (request.until == Request::Until::time) return true;  // to an empty line: of no account
        reply.what = Reply::What::refused;
        return true;
    }
    if (code == Code::error && request.until == Request::Until::detection) {
        reply.error = line.number(0);
        return true;
    }
    if (code == request.code && request.until != Request::Until::time) {
        echoed = true;
        if (request.until != Request::Until::answer) return true;
        for (std::size_t i = 0; i < line.row->parts.size(); ++i)
            reply.values.emplace_back(line.parts[i]);
        reply.what = Reply::What::answered;
        return true;
    }
    if (!gathers_tags()) return false;
    if (code == Code::serial_number) {
        reply.serial = parse_serial(line.parts[0]);
        bool result = reply.serial->what != Serial::What::number;
        if (request.until == Request::Until::serial || (result && request.until == Request::Until::written))
            reply.what = Reply::What::answered;
        return true;
    }
    if (code == Code::block_data) {
        if (request.until == Request::Until::serial) return true;
        // Of a tag that was read the number comes first, where it comes at all (section 9.1, K12).
        bool has_number = reply.serial && reply.serial->what == Serial::What::number;
        bool wants_number = (unit_.now.transmit.value_or(0) & transmit_serial) != 0;
        if (request.until == Request::Until::detection && wants_number && !has_number) return true;
        Bytes data(block_size);
        parse_hex(line.parts[1], data.data(), data.size());
        reply.block = std::move(data);
        reply.what = Reply::What::answered;
        return true;
    }
    return false;
}

void DagprogDriver::restarted(const Line& line, Now now) {
    auto banner = line.parts[0].data() != nullptr ? printable(line.parts[0]) : std::string();
    bool was_known = phase_ != Phase::opening;
    unit_.banner = banner;
    if (was_known)
        notice(fault_restarted, fmt::format("the unit restarted: {}", banner.empty() ? "no version" : banner),
               now);
    if (job_) {
        JobResult result;
        result.status = job_sent_ ? Status::unknown : Status::cancelled;
        result.text = job_sent_ ? "the unit restarted before it was done" : "never sent: the unit restarted";
        end_job(job_->order.id, std::move(result));
    }
    under_way_.reset();
    task_.reset();
    job_task_.reset();
    identify_ = nullptr;
    doing_ = Doing::nothing;
    unit_.reading.reset();
    phase_ = Phase::opening;
    opened_ = now.steady;  // #6 says when it is ready
}

// Moves the tallies into the counters, and gives up on a line that makes no sense.
void DagprogDriver::check_stream() {
    auto& tally = framer_.tally();
    count(Count::frames, tally.lines - counted_.lines);
    count(Count::skipped_bytes, tally.skipped - counted_.skipped);
    count(Count::resyncs, tally.resyncs - counted_.resyncs);
    count(Count::bad_length, tally.too_long - counted_.too_long);
    counted_ = tally;
    auto& walked = walker_.tally();
    count(Count::reads, walked.reads - walked_.reads);
    count(Count::bad_checksum, walked.bad_crc - walked_.bad_crc);
    count(Count::malformed, walked.stray - walked_.stray);
    walked_ = walked;
    if (walker_.lines() != walked_lines_) skipped_at_line_ = tally.skipped;
    walked_lines_ = walker_.lines();
    if (tally.skipped - skipped_at_line_ > max_skipped)
        finish(fmt::format("{} bytes without a line of the protocol: is the baud rate right?",
                           tally.skipped - skipped_at_line_));
}

void DagprogDriver::set_up_walker() {
    TagWalker::Setup setup;
    setup.order = unit_.order;
    if (settings_.boolean("check_crc8")) setup.crc8 = unit_.crc8;
    if (unit_.family) setup.technology = technology(*unit_.family);
    // Before it is known what the unit sends, only its serial numbers are taken.
    if (phase_ == Phase::ready && !unit_.reads_by_asking) {
        auto transmit = unit_.now.transmit.value_or(transmit_data);
        setup.serials = (transmit & transmit_serial) != 0;
        setup.data = (transmit & transmit_data) != 0;
        setup.blocks = unit_.now.block_count.value_or(0) + 1;
    }
    if (!(setup == walker_.setup())) walker_.set_up(setup);
}

}  // namespace gantry::dagprog
