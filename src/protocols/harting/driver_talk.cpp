// The part of the driver that talks: one command and its answer, and what scan mode sends between them.
#include <algorithm>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/driver.hpp"

namespace gantry::harting {

static constexpr std::size_t kept_first_bytes = 32;

void HartingDriver::ask(Request request, Purpose purpose, Now now) {
    if (request.data.size() > max_frame - min_request)
        request.data.clear();  // the codec refuses such a job before
    append_request(out(), com_address_, request.control, request.data);
    if (purpose == Purpose::task && doing_ == Doing::job && running_) running_->sent = true;
    auto due = now.steady + request.patience;
    asked_ = Asked{std::move(request), due, purpose};
}

void HartingDriver::received(ByteView bytes, Now now) {
    if (finished_) return;
    count(Count::bytes, bytes.size());
    if (!ever_answered_ && first_bytes_.size() < kept_first_bytes) {
        auto some = bytes.first(std::min(bytes.size(), kept_first_bytes - first_bytes_.size()));
        first_bytes_.insert(first_bytes_.end(), some.begin(), some.end());
    }
    last_byte_ = now.steady;
    if (way_ == Way::scan && options_.link == LinkKind::serial) {
        take_scan(bytes, now);
    } else {
        framer_.add(bytes);
        take_frames(now);
    }
    gather_.flush();
}

std::string HartingDriver::stranger() const {
    if (ever_answered_ || first_bytes_.empty()) return {};
    return fmt::format("no HARTING reader: the connection began with \"{}\"",
                       printable(as_text(first_bytes_)));
}

void HartingDriver::take_frames(Now now) {
    while (!finished_) {
        auto frame = framer_.next();
        count_tally();
        if (framer_.astray() > max_astray || trouble_ >= max_trouble)
            return finish(ever_answered_ ? "its bytes make no sense" : stranger());
        if (!frame) break;
        on_frame(*frame, now);
        go_on(now);
    }
}

// Between the frames stands what scan mode sends. A frame begins with STX, which no text of it holds, and
// comes only after a command. The framer gets frames and nothing else: it would throw the text away.
void HartingDriver::take_scan(ByteView bytes, Now now) {
    while (!bytes.empty() && !finished_) {
        std::size_t size = 1;
        if (framer_.partial()) {
            auto rest = framer_.rest();
            auto look = look_at(rest, wire::Direction::to_host);
            if (look.what == Look::What::more) size = std::min(look.size - rest.size(), bytes.size());
        } else if (bytes.front() != stx || !asked_) {
            auto frame = asked_ ? std::ranges::find(bytes, stx) : bytes.end();
            auto text = bytes.first(static_cast<std::size_t>(frame - bytes.begin()));
            take_text(text, now);
            bytes = bytes.subspan(text.size());
            continue;
        }
        framer_.add(bytes.first(size));
        bytes = bytes.subspan(size);
        take_frames(now);
    }
}

void HartingDriver::take_text(ByteView text, Now now) {
    auto& report = gather_.open_for_tags(now);
    auto from = report.observations.size();
    auto taken = scan_.take(text, report.observations, report.data);
    count(Count::reads, report.observations.size() - from);
    if (taken.tags > 0) count(Count::frames, taken.tags);
    if (taken.unusable > 0 && set_up_)
        buffer_.malformed(fmt::format("{} pieces of scan output are no tags by CFG13", taken.unusable), text,
                          now);
}

void HartingDriver::count_tally() {
    auto& tally = framer_.tally();
    if (tally.frames > counted_.frames && trouble_ > 0) --trouble_;
    trouble_ += static_cast<unsigned>(tally.resyncs - counted_.resyncs);
    count(Count::frames, tally.frames - counted_.frames);
    count(Count::skipped_bytes, tally.skipped_bytes - counted_.skipped_bytes);
    count(Count::resyncs, tally.resyncs - counted_.resyncs);
    count(Count::bad_checksum, tally.bad_checksum - counted_.bad_checksum);
    count(Count::bad_length, tally.bad_length - counted_.bad_length);
    counted_ = tally;
}

void HartingDriver::on_frame(const Frame& frame, Now now) {
    bool ours = asked_ && frame.control == asked_->request.control &&
                (com_address_ == any_address || frame.address == com_address_);
    if (!ours) return count(Count::unknown_code);  // of a command that was given up, or of another reader
    ever_answered_ = true;
    first_bytes_.clear();
    timeouts_ = 0;
    answered(Reply{.silent = false, .status = frame.status, .data = frame.data}, frame.bytes, now);
}

void HartingDriver::answered(const Reply& reply, ByteView frame, Now now) {
    auto asked = std::move(*asked_);
    asked_.reset();
    switch (asked.purpose) {
        case Purpose::task:
            if (auto* task = current()) task->answered(reply, now);
            return;
        case Purpose::read:
            return on_buffer(reply, frame, now);
        case Purpose::clear:
            return on_cleared(reply, now);
        case Purpose::inventory:
            return on_inventory(reply, frame, now);
        case Purpose::look:
            return on_look(reply, now);
        case Purpose::look_set:
            return on_look_set(reply, now);
        case Purpose::look_fill:
            if (reply.ok() || reply.carries_data()) buffer_.overflow(reply.status, now);
            return;
        case Purpose::in_step:
            if (!reply.silent) out_of_step_ = false;
            return;
    }
}

// Its answer may still come, and answers do not say to which of two equal commands they belong: so a command
// of another kind is asked next, whose answer comes behind it.
void HartingDriver::timed_out(Now now) {
    count(Count::timeouts);
    framer_.drop();
    count_tally();
    out_of_step_ = true;
    if (++timeouts_ >= max_timeouts) {
        auto name = asked_->request.name();
        auto reason = stranger();
        if (reason.empty())
            reason = fmt::format("the reader left {} commands in a row without an answer, the last {}",
                                 max_timeouts, name);
        return finish(std::move(reason));
    }
    answered(Reply{.silent = true}, {}, now);
}

}  // namespace gantry::harting
