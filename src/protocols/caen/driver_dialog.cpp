#include "protocols/caen/driver_dialog.hpp"

#include <fmt/format.h>

namespace gantry::caen {

Request& Request::number(Attribute attribute, std::uint64_t value) {
    append_number(pairs, attribute, value);
    return *this;
}

Request& Request::text(Attribute attribute, std::string_view value) {
    append_text(pairs, attribute, value);
    return *this;
}

Request& Request::bytes(Attribute attribute, ByteView value) {
    append_bytes(pairs, attribute, value);
    return *this;
}

std::string_view Request::name() const {
    auto* row = find_command(command);
    return row != nullptr ? row->name : "an unknown command";
}

std::string Reply::words() const {
    if (silent) return "no answer";
    if (parsed.fault) return "an answer that cannot be read: " + parsed.fault->text();
    if (!parsed.result) return "an answer without a result code";
    return describe(*parsed.result);
}

void ReaderState::learn(const Request& request, const Reply& reply) {
    if (reply.silent && request.is(Command::set_protocol)) protocol.reset();  // it may have done it
    if (!reply.ok()) return;
    if (request.is(Command::get_protocol)) {
        if (auto value = reply.parsed.number(Attribute::protocol)) protocol = *value;
    } else if (request.is(Command::set_protocol)) {
        AvpReader pairs(request.pairs);
        while (auto pair = pairs.next())
            if (auto value = pair->number(); value && pair->is(Attribute::protocol)) protocol = *value;
    }
}

}  // namespace gantry::caen
