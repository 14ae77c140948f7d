#include <fmt/format.h>

#include "protocols/harting/driver.hpp"

namespace gantry::harting {

HartingListener::HartingListener(const DriverOptions& options)
    : keepalive_(options.settings.duration("keepalive")),
      buffer_(gather_, [this](Count which, std::uint64_t by) { count(which, by); }),
      channel_(buffer_, gather_, [this](Count which, std::uint64_t by) { count(which, by); }) {
    channel_.configure(options.settings.boolean("acknowledge"),
                       static_cast<std::uint8_t>(options.settings.number("com_address")), 3 * keepalive_);
    auto bank = parse_bank(options.settings.text("data_bank"));
    channel_.set_block_bank(bank.value_or(Bank::user));
}

void HartingListener::start(Now now) {
    started_ = now.steady;
    channel_.start(now);
    // Nothing goes to the host before it knows whose it is, and that is the address alone: the protocol has
    // no name. It is asked when the first good frame has come.
    channel_.hold(true);
}

void HartingListener::received(ByteView bytes, Now now) {
    channel_.received(bytes, now);
    after();
}

void HartingListener::after() {
    if (!identified_ && channel_.heard()) {
        identified_ = true;
        signals_.emplace_back(Identified{});
    }
    if (admitted_ && channel_.reader() != told_) {
        told_ = channel_.reader();
        signals_.emplace_back(Described{
            .model = {}, .firmware = {}, .detail = fmt::format("device {}; notifications only", told_)});
    }
    auto bytes = channel_.output();
    out().insert(out().end(), bytes.begin(), bytes.end());
    channel_.output_sent(bytes.size());
}

void HartingListener::admitted(const Known& known, Now now) {
    admitted_ = true;
    buffer_.know(known);
    channel_.hold(false);
    channel_.go_on(now);
    after();
}

void HartingListener::committed(Ticket ticket, Now now) {
    gather_.committed(ticket);
    channel_.committed(ticket, now);
    after();
}

void HartingListener::run(const JobOrder& order, const Job&, Now) {
    signals_.emplace_back(JobEnded{order.id, no_jobs_here()});
}

void HartingListener::time_passed(Now now) {
    if (!identified_ && now.steady >= started_ + identify_within && !finished_) {
        finished_ = true;
        finish_reason_ = channel_.stranger();
        if (finish_reason_.empty()) finish_reason_ = "it sent no notification and no keepalive message";
    }
    channel_.time_passed(now);
    after();
}

std::optional<Steady> HartingListener::deadline() const {
    if (finished()) return {};
    auto due = channel_.deadline();
    if (!identified_) due = due ? std::min(*due, started_ + identify_within) : started_ + identify_within;
    return due;
}

void HartingListener::link_lost(Now now) {
    channel_.link_lost(now);
    gather_.flush();
    if (!finished_) {
        finished_ = true;
        finish_reason_ = channel_.finish_reason().empty() ? channel_.stranger() : channel_.finish_reason();
    }
}

}  // namespace gantry::harting
