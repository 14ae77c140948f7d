#include "protocols/caen/device.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace gantry::caen {

static constexpr std::size_t max_input = 128 * 1024;   // two of the longest messages, and a little
static constexpr std::size_t max_output = 256 * 1024;  // waiting for a host that does not read
static constexpr auto upgrade_starts = 500ms;          // after the answer to FirmwareUpgrade

CaenDevice::CaenDevice(const DeviceOptions& options, Air& air)
    : serial_(options.settings.boolean("serial_line")),
      boot_(options.settings.duration("boot")),
      byte_gap_(options.settings.duration("byte_gap")),
      memory_(options, air),
      notifier_(options, memory_),
      faults_(options.seed) {}

// --- the link ----------------------------------------------------------------------------------------------

void CaenDevice::power_on(Now now) {
    booted_at_ = now.steady;
    memory_.restart(now);
}

void CaenDevice::start(Now now) {
    connected_ = true;
    hang_up_ = !serial_ && now.steady < booted_at_;
    faults_.link_up();
    drop_input();
    ++total_.connects;
    if (std::exchange(reboot_waits_, false)) restart_at_ = now.steady + reboot_after;
}

void CaenDevice::link_lost(Now) {
    connected_ = hang_up_ = false;
    faults_.link_lost();
    end_inventory();
    drop_input();
    drop_output();
}

bool CaenDevice::wants_input() const {
    return framer_.pending() < max_input && output().size() + faults_.late() < max_output;
}

void CaenDevice::say(ByteView bytes, Now now) {
    if (connected_ && !silent_) faults_.say(bytes, now, out());
}

// --- requests ----------------------------------------------------------------------------------------------

void CaenDevice::received(ByteView bytes, Now now) {
    if (!connected_ || hang_up_) return;
    // On a serial line nobody is there yet while it starts.
    if (silent_ || faults_.deaf() || now.steady < booted_at_) {
        total_.ignored_bytes += bytes.size();
        return;
    }
    if (streaming()) {  // then nothing but the raw abort byte counts (section 8)
        auto abort = std::ranges::find(bytes, abort_byte);
        total_.ignored_bytes += static_cast<std::size_t>(abort - bytes.begin());
        if (abort == bytes.end()) return;
        abort_stream(now);
        bytes = bytes.subspan(static_cast<std::size_t>(abort - bytes.begin()) + 1);
    }
    framer_.add(bytes);
    take_requests(now);
}

void CaenDevice::take_requests(Now now) {
    while (!hang_up_ &&
           (!inventory_ || streaming())) {  // during an inventory that answers once, the rest waits
        auto item = framer_.next();
        if (!item) break;
        switch (item->what) {
            case Framer::What::message:
                if (streaming())
                    total_.ignored_bytes += item->bytes.size();
                else
                    on_request(item->bytes, now);
                break;
            case Framer::What::abort:
                abort_stream(now);
                break;
            case Framer::What::stream_head:  // no request has an undefined length
                framer_.stream_over();
                total_.ignored_bytes += item->bytes.size();
                break;
            case Framer::What::avp:
            case Framer::What::out_of_band:
                total_.ignored_bytes += item->bytes.size();
                break;
        }
    }
    if (streaming()) drop_input();
    // The gap between a request's bytes must stay below a time that is not published (section 1).
    give_up_at_.reset();
    if (framer_.pending() > 0 && !inventory_) give_up_at_ = now.steady + byte_gap_;
}

void CaenDevice::drop_input() {
    total_.ignored_bytes += framer_.pending();
    framer_.reset();
    give_up_at_.reset();
}

void CaenDevice::on_request(ByteView message, Now now) {
    auto request = parse(message);
    ++total_.requests;
    const auto* row = request.command ? find_command(*request.command) : nullptr;
    if (row == nullptr || row->reserved || row->notification) {
        answer(request, ResultCode::invalid_command, now);
        return;
    }
    if (auto result = disturbed(*row)) {
        answer(request, *result, now);
        return;
    }
    auto checked = check_request(request, *row, memory_.model, memory_.any_order);
    if (checked.result != ResultCode::success) {
        answer(request, checked.result, now);
        return;
    }
    auto command = static_cast<Command>(row->code);
    if (command == Command::raw_read_ids || command == Command::inventory_tag) {
        begin_inventory(request, command, checked.arguments, now);
        return;
    }
    auto* handler = find_handler(command);
    if (handler == nullptr) {  // a test holds that no row with parameters comes here
        answer(request, ResultCode::unsupported, now);
        return;
    }
    Call call{.command = command,
              .arguments = checked.arguments,
              .memory = memory_,
              .notifier = notifier_,
              .now = now};
    auto result = handler(call);
    answer(request, result, now, call.answer);
    if (call.restart) restart_at_ = now.steady + upgrade_starts;
}

std::optional<ResultCode> CaenDevice::disturbed(const CommandRow& row) {
    if (auto forced = std::exchange(next_result_, std::nullopt)) return static_cast<ResultCode>(*forced);
    if (!busy_) return {};
    auto takes = [&](Attribute attribute) {
        return std::ranges::find(row.in, attribute, &Param::attribute) != row.in.end();
    };
    if (takes(Attribute::channel_name)) return ResultCode::channel_busy;
    if (takes(Attribute::trigger_name)) return ResultCode::trigger_busy;
    return ResultCode::unknown_error;
}

// The message id comes back whatever it was, the command first, the result last; a failure has nothing
// between them (sections 2 and 3).
void CaenDevice::answer(const Parsed& request, ResultCode result, Now now, ByteView pairs) {
    if (result != ResultCode::success) ++total_.refused;
    Bytes message;
    Builder builder(message, to_host_head, request.header.id);
    if (request.command) builder.command(*request.command);
    if (result == ResultCode::success) message.insert(message.end(), pairs.begin(), pairs.end());
    builder.result(result);
    if (builder.finish()) say(message, now);
}

// --- inventories -------------------------------------------------------------------------------------------

void CaenDevice::begin_inventory(const Parsed& request, Command command, const Arguments& arguments,
                                 Now now) {
    auto wanted = Inventory::order_of(request, command, arguments, memory_);
    if (wanted.result != ResultCode::success) {
        answer(request, wanted.result, now);
        return;
    }
    Bytes head;
    inventory_.emplace(wanted.order, memory_, now, head);
    say(head, now);
}

void CaenDevice::end_inventory() {
    if (!inventory_) return;
    total_.tags += inventory_->tags();
    total_.lost += inventory_->lost();
    inventory_.reset();
}

void CaenDevice::abort_stream(Now now) {
    if (!streaming()) return;  // nothing to abort
    Bytes last;
    inventory_->abort(last);
    say(last, now);
    end_inventory();
}

// --- time --------------------------------------------------------------------------------------------------

std::optional<Steady> CaenDevice::deadline() const {
    auto due = restart_at_;
    auto sooner = [&](const std::optional<Steady>& at) {
        if (at && (!due || *at < *due)) due = at;
    };
    sooner(give_up_at_);
    sooner(faults_.deadline());
    if (inventory_) sooner(inventory_->deadline());
    sooner(notifier_.deadline());
    return due;
}

void CaenDevice::time_passed(Now now) {
    if (restart_at_ && now.steady >= *restart_at_) reboot(now);
    if (give_up_at_ && now.steady >= *give_up_at_) drop_input();
    faults_.time_passed(now, out());
    notifier_.time_passed(now);
    while (inventory_) {
        Bytes heard;
        inventory_->time_passed(
            now, !silent_ && !faults_.deaf() && output().size() + faults_.late() < max_output, heard);
        say(heard, now);
        if (!inventory_->over()) return;
        end_inventory();
        take_requests(now);  // what waited for it
    }
}

void CaenDevice::reboot(Now now) {
    ++total_.restarts;
    restart_at_.reset();
    end_inventory();
    notifier_.restart();
    faults_.forget();
    drop_input();
    booted_at_ = now.steady + boot_;
    memory_.restart(now + boot_);
    hang_up_ = connected_ && !serial_;
}

}  // namespace gantry::caen
