// The part of the driver that reads tags: out of the reader's buffer, or by inventories of our own; and that
// looks whether the reader is still as we left it.
#include <algorithm>

#include <fmt/format.h>

#include "protocols/harting/driver.hpp"
#include "protocols/harting/records.hpp"

namespace gantry::harting {

static constexpr std::chrono::seconds pause_after_fault{1};
static constexpr std::uint8_t every_antenna = 0x0F;

Mode HartingDriver::wanted_mode() const {
    if (guest_) return left_.value_or(reader_.mode());
    if (!reading_) return Mode::host;
    switch (way_) {
        case Way::buffered:
            return Mode::buffered_read;
        case Way::notification:
            return Mode::notification;
        case Way::scan:
            return Mode::scan;
        case Way::keep:
            return reader_.mode();  // one that nobody knows
        case Way::host:
            break;
    }
    return Mode::host;
}

bool HartingDriver::read_next(Now now) {
    if (!reading_ || stalled() || clear_after_ || now.steady < poll_at_) return false;
    if (way_ == Way::buffered) {
        ask(Request(Command::read_buffer, {0, sets_at_once}), Purpose::read, now);
        return true;
    }
    if (way_ != Way::host) return false;
    auto mode = static_cast<std::uint8_t>(more_ ? inventory_more : 0);
    if (plain_inventory_)
        ask(Request(Command::inventory, {mode}), Purpose::inventory, now);
    else
        ask(Request(Command::inventory, {static_cast<std::uint8_t>(mode | inventory_antennas),
                                         reader_.antennas != 0 ? reader_.antennas : every_antenna}),
            Purpose::inventory, now);
    return true;
}

// A set that we cannot read is kept as a fault, and goes from the reader with it: else it would come for
// ever.
void HartingDriver::on_buffer(const Reply& reply, ByteView frame, Now now) {
    if (reply.silent) return;
    if (reply.is(Status::no_valid_data)) {
        buffer_empty_ = true;
        buffer_.overflow(reply.status, now);
        poll_at_ = now.steady + poll_;
        reading_fault_ = 0;
        return;
    }
    if (!reply.carries_data()) return reading_refused(reply, "Read Buffer", now);
    reading_fault_ = 0;
    buffer_empty_ = false;
    auto taken = buffer_.take(reply.status, reply.data, frame, reader_.block_bank(), now);
    last_sets_ = taken.sets;
    poll_at_ = read_at_ = now.steady;
    fill_looked_at_ = false;
    gather_.flush();
    // Also what is known may still be on its way to the disk.
    clear_after_ = gather_.last_issued();
}

void HartingDriver::on_cleared(const Reply& reply, Now now) {
    if (reply.silent) return;  // asked again; the reader forgets nothing that was not read since
    if (!reply.ok() && !reply.is(Status::no_valid_data)) {
        poll_at_ = now.steady + pause_after_fault;
        return reading_refused(reply, "Clear Data Buffer", now);
    }
    count(Count::acknowledged);
    buffer_.cleared();
    clear_after_.reset();
    buffer_empty_ = last_sets_ < sets_at_once;
    poll_at_ = buffer_empty_ ? now.steady + poll_ : now.steady;
}

void HartingDriver::on_inventory(const Reply& reply, ByteView frame, Now now) {
    more_ = false;
    poll_at_ = now.steady + poll_;
    if (reply.silent) return;
    if (reply.is(Status::parameter_range) && !plain_inventory_) {
        plain_inventory_ = true;  // an older relative: without antennas and strength
        poll_at_ = now.steady;
        return;
    }
    bool fine = reply.ok() || reply.is(Status::no_transponder) || reply.carries_data();
    if (!fine) return reading_refused(reply, "Inventory", now);
    reading_fault_ = 0;
    if (!reply.carries_data()) return;
    auto& report = gather_.open_for_tags(now);
    auto from = report.observations.size();
    auto walked = walk_inventory(reply.data, static_cast<std::size_t>(reply.data.data() - frame.data()),
                                 !plain_inventory_, report.observations, report.data);
    count(Count::reads, report.observations.size() - from);
    if (report.observations.size() > from) {
        auto& last = report.observations.back();
        reader_.tids = last.tid_size > 0 || (last.data_size > 0 && last.data_bank == Bank::tid);
    }
    if (walked.fault || walked.unusable > 0)
        buffer_.malformed(walked.fault ? fmt::format("an inventory cannot be read: {}", walked.fault->text())
                                       : fmt::format("{} tags have no id that can be used", walked.unusable),
                          frame, now);
    if (reply.is(Status::more_data)) {
        more_ = true;
        poll_at_ = now.steady;
    }
}

// A reader that has restarted is back in the mode of its EEPROM, or wants to be logged in again.
void HartingDriver::reading_refused(const Reply& reply, std::string_view what, Now now) {
    poll_at_ = now.steady + pause_after_fault;
    if (reply.is(Status::command_not_available))
        return set_up_again(fmt::format("{} is not available: the reader seems to have restarted, and is set "
                                        "up again",
                                        what),
                            now);
    if (reply.is(Status::login_request) || reply.is(Status::eeprom_failure))
        return set_up_again(fmt::format("{}: {}; the reader is set up again", what, reply.words()), now);
    if (reading_fault_ == reply.status) return;
    reading_fault_ = reply.status;
    fault(reply.status, fmt::format("{} failed: {}", what, reply.words()), now);
}

void HartingDriver::on_look(const Reply& reply, Now now) {
    if (reply.data.size() >= 2 && (reply.ok() || reply.carries_data()))
        buffer_.flags(reply.data.first(2), now);
    if (reply.is(Status::login_request))
        set_up_again("the reader wants a log-in again, and is set up again", now);
}

// In turn: the diagnostic flags, and what the set-up left in RAM, which is gone when the reader has
// restarted, also where no link broke over that. CFG1 every other time, for it has the way of reading.
void HartingDriver::look(Now now) {
    constexpr std::uint8_t interface_block = 1;
    if (++looks_ % 2 == 0) return ask(Request(Command::reader_diagnostic, {0x01}), Purpose::look, now);
    looked_at_ = interface_block;
    if (auto& set = reader_.set; looks_ % 4 == 3 && !set.empty())
        looked_at_ = std::next(set.begin(), static_cast<std::ptrdiff_t>(looks_ / 4 % set.size()))->first;
    ask(read_block(looked_at_), Purpose::look_set, now);
}

void HartingDriver::on_look_set(const Reply& reply, Now now) {
    auto block = reply.block();
    if (reply.is(Status::login_request) || reply.is(Status::eeprom_failure))
        return set_up_again(fmt::format("the reader answers {}, and is set up again", reply.words()), now);
    auto left = reader_.set.find(looked_at_);
    auto& wanted = left == reader_.set.end() ? reader_.interface : left->second;
    if (!block || *block == wanted) return;
    set_up_again("its settings have changed: it seems to have restarted, and is set up again", now);
}

}  // namespace gantry::harting
