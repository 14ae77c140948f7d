#include "protocols/harting/tag_command.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "protocols/harting/shapes.hpp"

namespace gantry::harting {

using wire::Errc;
using wire::Fault;
using wire::Fields;
using wire::Value;

namespace {

constexpr std::size_t plain_uid = 8;  // without a length byte

// What follows the head of each command (sections 6 and 7).
struct Form {
    bool bank = false;          // with its access password
    bool block = false;         // DB-ADR and DB-N
    bool group = false;         // BLOCK-PTR and BLOCK-RANGE
    bool own_password = false;  // with its length
};
Form form_of(const TagCommand& command) {
    switch (command.command) {
        case Command::read_multiple_blocks:
        case Command::write_multiple_blocks:
            return {.bank = (command.mode & extended_address) != 0, .block = true};
        case Command::block_permalock:
        case Command::read_permalock_status:
            return {.bank = true, .group = true};
        default:
            return {.own_password = true};
    }
}

Bytes copy(ByteView bytes) {
    return {bytes.begin(), bytes.end()};
}

TagCommand parse(Command which, wire::Reader& in) {
    TagCommand command{.command = which};
    command.mode = in.u8("MODE");
    if (command.is_addressed()) {
        std::size_t size = (command.mode & uid_length) != 0 ? in.u8("UID-LNG") : plain_uid;
        command.uid = copy(in.bytes(size, "UID"));
    }
    auto form = form_of(command);
    if (which == Command::lock) {
        command.type = in.u8("TR-TYPE");
        command.data = copy(in.bytes(in.u8("LOCK-LNG"), "LOCK-DATA"));
    }
    if (form.bank) command.bank = in.u8("BANK");
    if (form.own_password || (form.bank && (command.bank & bank_password) != 0))
        command.password = copy(in.bytes(in.u8("A-PW-LNG"), "A-PW"));
    if (form.block) {
        command.address = (command.mode & extended_address) != 0 ? in.u16("DB-ADR") : in.u8("DB-ADR");
        command.count = in.u8("DB-N");
    }
    if (form.group) {
        command.address = in.u16("BLOCK-PTR");
        command.count = in.u8("BLOCK-RANGE");
    }
    if (which == Command::write_multiple_blocks) {
        command.size = in.u8("DB-SIZE");
        command.data = copy(in.bytes(std::size_t{command.count} * command.size, "DB"));
    }
    if (which == Command::block_permalock)
        command.data = copy(in.bytes(std::size_t{command.count} * 2, "MASK"));
    if (which == Command::kill && (command.mode & recommission) != 0) command.recom = in.u8("RECOM");
    return command;
}

void append_sized(ByteView bytes, wire::Writer& out) {
    out.u8(bytes.size());
    out.bytes(bytes);
}

void append(const TagCommand& command, Bytes& out) {
    wire::Writer writer(out);
    writer.u8(command.mode);
    if (command.is_addressed()) {
        if ((command.mode & uid_length) != 0) writer.u8(command.uid.size());
        writer.bytes(command.uid);
    }
    auto form = form_of(command);
    if (command.command == Command::lock) {
        writer.u8(command.type);
        append_sized(command.data, writer);
    }
    if (form.bank) writer.u8(command.bank);
    if (form.own_password || (form.bank && (command.bank & bank_password) != 0))
        append_sized(command.password, writer);
    if (form.block || form.group) {
        bool wide = form.group || (command.mode & extended_address) != 0;
        writer.big_endian(command.address, wide ? 2 : 1);
        writer.u8(command.count);
    }
    if (command.command == Command::write_multiple_blocks) writer.u8(command.size);
    if (command.command != Command::lock) writer.bytes(command.data);
    if (command.command == Command::kill && (command.mode & recommission) != 0)
        writer.u8(command.recom.value_or(0));
}

}  // namespace

bool is_tag_command(Command command) {
    switch (command) {
        case Command::read_multiple_blocks:
        case Command::write_multiple_blocks:
        case Command::kill:
        case Command::lock:
        case Command::block_permalock:
        case Command::read_permalock_status:
            return true;
        default:
            return false;
    }
}

wire::Result<TagCommand> parse_tag_command(std::uint8_t control, ByteView data) {
    wire::Reader in(data);
    auto sub = in.u8("SUB-COMMAND");
    auto which = static_cast<Command>(control << 8 | sub);
    if (!in.fault() && !is_tag_command(which)) in.fail(Errc::unknown_code, "SUB-COMMAND");
    if (in.fault()) return tl::unexpected(*in.fault());
    auto command = parse(which, in);
    if (!in.fault() && in.left() > 0) in.fail(Errc::trailing_bytes, "data");
    if (in.fault()) return tl::unexpected(*in.fault());
    return command;
}

void append_tag_command(const TagCommand& command, Bytes& out) {
    out.push_back(sub_of(command.command));
    append(command, out);
}

// Gen2's twenty bits at the top of 24.
Bytes lock_data(std::uint16_t mask, std::uint16_t action) {
    auto bits = static_cast<std::uint32_t>((mask & 0x3FF) << 14 | (action & 0x3FF) << 4);
    return {static_cast<std::uint8_t>(bits >> 16), static_cast<std::uint8_t>(bits >> 8 & 0xFF),
            static_cast<std::uint8_t>(bits & 0xFF)};
}
LockBits lock_bits(ByteView lock_data) {
    if (lock_data.size() < 3) return {};
    auto bits = static_cast<std::uint32_t>(lock_data[0] << 16 | lock_data[1] << 8 | lock_data[2]);
    return {static_cast<std::uint16_t>(bits >> 14 & 0x3FF), static_cast<std::uint16_t>(bits >> 4 & 0x3FF)};
}

namespace shapes {

namespace {

// The fields of a command as encode needs them; the first fault sticks.
class Taken {
public:
    Taken(Layout layout, const Fields& fields) : layout_(layout), fields_(fields) {}

    bool has(std::string_view name) const { return wire::find(fields_, name) != nullptr; }
    bool in_layout(std::string_view name) const {
        return std::ranges::find(layout_, name, &FieldRow::name) != layout_.end();
    }
    std::uint16_t number(std::string_view name, std::uint16_t fallback) {
        return in_layout(name) && has(name) ? number(name) : fallback;
    }
    std::uint16_t number(std::string_view name) {
        auto bytes = put_row(name);
        std::uint16_t value = 0;
        for (auto byte : bytes)
            value = static_cast<std::uint16_t>(value << 8 | byte);
        return value;
    }
    std::uint8_t byte(std::string_view name) { return static_cast<std::uint8_t>(number(name)); }
    Bytes bytes(std::string_view name, std::size_t max) {
        auto bytes = put_row(name);
        if (bytes.size() > max) fail(Errc::too_big, name, fmt::format("at most {} bytes fit", max));
        return bytes;
    }
    void fail(Errc code, std::string_view name, std::string detail) {
        if (!fault_) fault_ = Fault{code, 0, name, std::move(detail)};
    }
    const std::optional<Fault>& fault() const { return fault_; }

private:
    Bytes put_row(std::string_view name) {
        Bytes out;
        auto done = put(part(layout_, name)[0], fields_, out);
        if (!done && !fault_) fault_ = done.error();
        return done ? out : Bytes{};
    }

    Layout layout_;
    const Fields& fields_;
    std::optional<Fault> fault_;
};

Layout layout_of(Command command) {
    return row_of(command).request.layout;
}

void take_head(Taken& taken, TagCommand& command) {
    bool uid = taken.has("UID");
    command.mode = static_cast<std::uint8_t>(taken.number(
        "MODE", static_cast<std::uint16_t>(extended_address | (uid ? addressed | uid_length : 0))));
    if (command.is_addressed() != uid)
        taken.fail(Errc::bad_value, "UID",
                   uid ? "needs MODE with 1 (addressed)" : "missing: MODE says addressed");
    if (!uid) return;
    command.uid = taken.bytes("UID", 0xFF);
    if ((command.mode & uid_length) == 0 && command.uid.size() != plain_uid)
        taken.fail(Errc::bad_length, "UID", "without its length (MODE 0x10) a UID has 8 bytes");
}

void take_bank(Taken& taken, TagCommand& command) {
    auto bank = taken.byte("BANK");
    if (taken.has("A-PW")) {
        bank |= bank_password;
        command.password = taken.bytes("A-PW", 0xFF);
    } else if ((bank & bank_password) != 0) {
        taken.fail(Errc::bad_value, "A-PW", "missing: BANK has its flag");
    }
    command.bank = bank;
}

void take_blocks(Taken& taken, TagCommand& command) {
    command.address = taken.number("DB-ADR");
    if ((command.mode & extended_address) == 0 && command.address > 0xFF)
        taken.fail(Errc::bad_value, "DB-ADR", "over 255 needs MODE 0x20");
    if (command.command == Command::read_multiple_blocks) {
        command.count = taken.byte("DB-N");
        return;
    }
    command.size = static_cast<std::uint8_t>(taken.number("DB-SIZE", 2));
    command.data = taken.bytes("DB", 0xFFFF);
    auto count = command.size > 0 ? command.data.size() / command.size : 0;
    if (!taken.has("DB-N") && count > 0xFF) taken.fail(Errc::too_big, "DB", "at most 255 blocks fit");
    command.count = static_cast<std::uint8_t>(taken.number("DB-N", static_cast<std::uint16_t>(count)));
    if (std::size_t{command.count} * command.size != command.data.size())
        taken.fail(Errc::bad_length, "DB", "expected DB-N times DB-SIZE bytes");
}

}  // namespace

void decode_tag_command(Command which, wire::Reader& in, Fields& out) {
    auto command = parse(which, in);
    if (in.fault()) return;
    auto form = form_of(command);
    auto add = [&](std::string_view name, Value value) {
        out.push_back({std::string(name), std::move(value)});
    };
    auto add_named = [&](std::string_view name, const Enumeration& enumeration, std::uint8_t number) {
        const auto* known = enumeration.find(number);
        add(name, known != nullptr ? Value(std::string(known->name)) : Value(number));
    };
    add("MODE", Value(command.mode));
    if (command.is_addressed()) add("UID", Value(std::move(command.uid)));
    if (which == Command::lock) {
        add_named("TR-TYPE", transponder_types, command.type);
        add("LOCK-DATA", Value(std::move(command.data)));
    }
    if (form.bank) {
        add_named("BANK", banks, command.bank & ~bank_password & 0xFF);
        if ((command.bank & bank_password) != 0) add("A-PW", Value(std::move(command.password)));
    }
    if (form.own_password)
        add(which == Command::kill ? "KILL-PW" : "A-PW", Value(std::move(command.password)));
    if (form.block || form.group) {
        add(form.block ? "DB-ADR" : "BLOCK-PTR", Value(command.address));
        add(form.block ? "DB-N" : "BLOCK-RANGE", Value(command.count));
    }
    if (which == Command::write_multiple_blocks) {
        add("DB-SIZE", Value(command.size));
        add("DB", Value(std::move(command.data)));
    }
    if (which == Command::block_permalock) add("MASK", Value(std::move(command.data)));
    if (command.recom) add("RECOM", Value(*command.recom));
}

wire::Result<void> encode_tag_command(Command which, const Fields& fields, Bytes& out) {
    auto layout = layout_of(which);
    if (auto fine = known_names(layout, fields); !fine) return fine;
    Taken taken(layout, fields);
    TagCommand command{.command = which};
    take_head(taken, command);
    auto form = form_of(command);
    if (which == Command::lock) {
        command.type = static_cast<std::uint8_t>(taken.number("TR-TYPE", type_epc_gen2));
        command.data = taken.bytes("LOCK-DATA", 0xFF);
    }
    if (form.bank)
        take_bank(taken, command);
    else if (form.block && (taken.has("BANK") || taken.has("A-PW")))
        taken.fail(Errc::bad_value, "BANK", "needs MODE 0x20");
    if (form.own_password) {
        auto name = which == Command::kill ? "KILL-PW" : "A-PW";
        command.password = taken.bytes(name, 0xFF);
    }
    if (form.block) take_blocks(taken, command);
    if (form.group) {
        command.address = taken.number("BLOCK-PTR");
        command.count = taken.byte("BLOCK-RANGE");
    }
    if (which == Command::block_permalock) {
        command.data = taken.bytes("MASK", 0xFFFF);
        if (command.data.size() != std::size_t{command.count} * 2)
            taken.fail(Errc::bad_length, "MASK", "expected two bytes for each of BLOCK-RANGE");
    }
    if (taken.has("RECOM") != (which == Command::kill && (command.mode & recommission) != 0))
        taken.fail(Errc::bad_value, "RECOM", "goes with MODE 0x08");
    else if (taken.has("RECOM"))
        command.recom = taken.byte("RECOM");
    if (taken.fault()) return tl::unexpected(*taken.fault());
    append(command, out);
    return {};
}

}  // namespace shapes

}  // namespace gantry::harting
