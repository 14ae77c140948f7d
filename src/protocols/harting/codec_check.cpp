#include <algorithm>
#include <chrono>

#include <fmt/format.h>

#include "protocols/harting/codec.hpp"
#include "protocols/harting/tag_command.hpp"
#include "reader/bank.hpp"

// What a reader refuses although its bytes are in order: said before a person's request is sent.
namespace gantry::harting {

using wire::Errc;
using wire::Fault;
using wire::Fields;
using wire::Value;

namespace {

wire::Result<void> refuse(std::string_view field, std::string detail) {
    return tl::unexpected(Fault{Errc::bad_value, 0, field, std::move(detail)});
}

std::int64_t number(const Fields& fields, std::string_view name) {
    const auto* value = wire::find(fields, name);
    return value != nullptr ? wire::as_number(*value).value_or(0) : 0;
}

wire::Result<void> check_tag_command(const CommandRow& row, const TagCommand& command) {
    constexpr std::size_t password_size = 4;
    auto which = command.command;
    std::uint8_t address = command.mode & address_bits;
    if (address > selected) return refuse("MODE", "bits 2 to 0: 0 any tag, 1 addressed, 2 selected");
    if (command.is_addressed() && command.uid.empty()) return refuse("UID", "must not be empty");
    bool has_password =
        which == Command::kill || which == Command::lock || (command.bank & bank_password) != 0;
    if (has_password && command.password.size() != password_size)
        return refuse(which == Command::kill ? "KILL-PW" : "A-PW", "a password has four bytes");
    if (which == Command::lock) {
        if (command.data.size() != 3) return refuse("LOCK-DATA", "expected three bytes");
        if ((command.data[2] & 0x0F) != 0) return refuse("LOCK-DATA", "the last four bits must be 0");
        return {};
    }
    if (which == Command::kill) return {};
    if ((command.bank & ~(bank_password | bank_bits)) != 0)
        return refuse("BANK", "0 reserved, 1 epc, 2 tid, 3 user");
    if (command.count == 0)
        return refuse(which == Command::block_permalock || which == Command::read_permalock_status
                          ? "BLOCK-RANGE"
                          : "DB-N",
                      "must be at least 1");
    if (which == Command::write_multiple_blocks && command.size == 0)
        return refuse("DB-SIZE", "must be at least 1");
    if (which != Command::block_permalock && which != Command::read_permalock_status) return {};
    if ((command.mode & extended_address) == 0) return refuse("MODE", fmt::format("{} needs 0x20", row.name));
    if ((command.bank & bank_bits) != static_cast<std::uint8_t>(Bank::user))
        return refuse("BANK", "only user memory has sections");
    return {};
}

wire::Result<void> check_outputs(const Fields& fields) {
    constexpr std::int64_t number_bits = 0x0F;
    if (number(fields, "MODE") != 1) return refuse("MODE", "must be 1");
    const auto* list = wire::find(fields, "OUT-N");
    const auto* items = list != nullptr ? list->get<Value::List>() : nullptr;
    if (items == nullptr || items->empty()) return refuse("OUT-N", "name at least one output");
    for (auto& item : *items)
        if ((number(*item.get<Fields>(), "OUT-NR") & number_bits) == 0)
            return refuse("OUT-NR", "outputs count from 1");
    return {};
}

wire::Result<void> check_date(const Fields& fields) {
    using namespace std::chrono;
    auto part = [&](std::string_view name) { return static_cast<unsigned>(number(fields, name)); };
    year_month_day date{year{static_cast<int>(part("CENTURY") * 100 + part("YEAR"))}, month{part("MONTH")},
                        day{part("DAY")}};
    return date.ok() ? wire::Result<void>{} : refuse("DAY", "there is no such day");
}

}  // namespace

wire::Result<void> check_request(const CommandRow& row, const Fields& fields) {
    if (auto fine = wire::check(row.request.layout, fields); !fine) return fine;
    auto which = static_cast<Command>(row.control << 8 | row.sub);
    if (is_tag_command(which)) {
        Bytes data;
        if (auto done = encode_request(row, fields, data); !done) return done;
        auto command = parse_tag_command(row.control, data);
        return command ? check_tag_command(row, *command) : tl::unexpected(command.error());
    }
    switch (which) {
        case Command::inventory:
            if ((number(fields, "MODE") & ~(inventory_more | inventory_antennas)) != 0)
                return refuse("MODE", "only 0x80 and 0x10 have a meaning");
            return {};
        case Command::set_output:
            return check_outputs(fields);
        case Command::set_system_time_and_date:
            return check_date(fields);
        case Command::write_configuration:
            if ((number(fields, "CFG-ADR") & cfg_all) != 0) return refuse("CFG-ADR", "one block at a time");
            return {};
        default:
            return {};
    }
}

}  // namespace gantry::harting
