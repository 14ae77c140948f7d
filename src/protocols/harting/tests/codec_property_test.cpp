#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "protocols/harting/codec.hpp"
#include "protocols/harting/frame.hpp"
#include "protocols/harting/records.hpp"
#include "protocols/harting/tag_command.hpp"

namespace gantry::harting::test {

using wire::Direction;
using wire::Fields;
using wire::Message;
using wire::Value;

namespace {

constexpr auto to_reader = Direction::to_reader, to_host = Direction::to_host;

Bytes arbitrary_bytes(std::size_t most) {
    return *rc::gen::container<Bytes>(*rc::gen::inRange<std::size_t>(0, most + 1),
                                      rc::gen::arbitrary<std::uint8_t>());
}

// Values for the rows of a layout, some of them as a person types them.
Fields arbitrary_fields(wire::Layout layout) {
    Fields fields;
    for (auto& row : layout) {
        Value value;
        switch (row.type) {
            case wire::Type::number:
            case wire::Type::integer:
                value = Value(*rc::gen::inRange<std::int64_t>(0, std::int64_t{1} << (8 * row.size)));
                break;
            case wire::Type::list: {
                Value::List list;
                for (auto count = *rc::gen::inRange(0, 4); count > 0; --count)
                    list.emplace_back(arbitrary_fields(row.record));
                value = Value(std::move(list));
                break;
            }
            default: {
                auto size = row.type == wire::Type::sized || row.size == 0
                                ? *rc::gen::inRange<std::size_t>(0, 20)
                                : std::size_t{row.size};
                auto bytes = *rc::gen::container<Bytes>(size, rc::gen::arbitrary<std::uint8_t>());
                value = *rc::gen::arbitrary<bool>() ? Value(bytes) : Value(to_hex(bytes));
            }
        }
        fields.push_back({std::string(row.name), std::move(value)});
    }
    return fields;
}

TagCommand arbitrary_command(Command which) {
    TagCommand command{.command = which};
    command.mode = *rc::gen::arbitrary<std::uint8_t>();
    if (command.is_addressed())
        command.uid = (command.mode & uid_length) != 0
                          ? arbitrary_bytes(30)
                          : *rc::gen::container<Bytes>(8, rc::gen::arbitrary<std::uint8_t>());
    bool blocks = which == Command::read_multiple_blocks || which == Command::write_multiple_blocks;
    bool wide = (command.mode & extended_address) != 0;
    bool groups = which == Command::block_permalock || which == Command::read_permalock_status;
    if (groups || (blocks && wide)) command.bank = *rc::gen::arbitrary<std::uint8_t>();
    bool password = which == Command::kill || which == Command::lock || (command.bank & bank_password) != 0;
    if (password) command.password = arbitrary_bytes(6);
    if (blocks || groups) {
        command.address = *rc::gen::inRange<std::uint16_t>(0, blocks && !wide ? 256 : 0xFFFF);
        command.count = *rc::gen::inRange<std::uint8_t>(0, 20);
    }
    auto size = groups ? 2 : *rc::gen::inRange<std::size_t>(0, 5);
    if (which == Command::write_multiple_blocks) command.size = static_cast<std::uint8_t>(size);
    if (which == Command::write_multiple_blocks || which == Command::block_permalock)
        command.data = *rc::gen::container<Bytes>(command.count * size, rc::gen::arbitrary<std::uint8_t>());
    if (which == Command::lock) {
        command.data = arbitrary_bytes(4);
        command.type = *rc::gen::arbitrary<std::uint8_t>();
    }
    if (which == Command::kill && (command.mode & recommission) != 0)
        command.recom = *rc::gen::arbitrary<std::uint8_t>();
    return command;
}
Command arbitrary_tag_command() {
    return *rc::gen::element(Command::read_multiple_blocks, Command::write_multiple_blocks, Command::kill,
                             Command::lock, Command::block_permalock, Command::read_permalock_status);
}

// A reply's data as some command has them.
Bytes arbitrary_reply_data() {
    TagRecord record;
    record.transponder_type = *rc::gen::element<std::uint8_t>(0x84, 0x81, 0x05, 0x77);
    record.idd = arbitrary_bytes(20);
    record.blocks = arbitrary_bytes(8);
    for (auto count = *rc::gen::inRange(0, 3); count > 0; --count)
        record.antennas.push_back({.number = 2, .rssi = *rc::gen::arbitrary<std::uint8_t>()});
    auto count = *rc::gen::inRange<std::uint8_t>(0, 4);
    Bytes data;
    switch (*rc::gen::inRange(0, 4)) {
        case 0:
        case 1: {
            bool antennas = *rc::gen::arbitrary<bool>();
            data.push_back(count);
            for (; count > 0; --count)
                append_inventory_tag(record, antennas, data);
            break;
        }
        case 2: {
            auto tr1 = *rc::gen::arbitrary<std::uint8_t>();
            auto tr2 = *rc::gen::arbitrary<std::uint8_t>();
            append_buffer_head(tr1, tr2, count, data);
            for (; count > 0; --count)
                append_record(record, tr1, tr2, {}, data);
            break;
        }
        default:
            append_block_data(record.blocks, 2, data);
    }
    return data;
}

Bytes arbitrary_frame(Direction direction) {
    auto rows = commands();
    auto& row = rows[*rc::gen::inRange<std::size_t>(0, rows.size())];
    auto control = *rc::gen::inRange(0, 8) != 0 ? row.control : *rc::gen::arbitrary<std::uint8_t>();
    Bytes data, out;
    if (*rc::gen::inRange(0, 3) == 0)
        data = arbitrary_bytes(70);
    else if (direction == to_host)
        data = *rc::gen::arbitrary<bool>()
                   ? arbitrary_reply_data()
                   : Bytes(*rc::gen::element<std::size_t>(2, 11, 14, 16, 30, 32, 36, 63));
    else if (auto which = static_cast<Command>(row.control << 8 | row.sub); is_tag_command(which))
        append_tag_command(arbitrary_command(which), data);
    else if (row.request.encode == nullptr)
        (void)encode_request(row, arbitrary_fields(row.request.layout), data);
    auto status = *rc::gen::element<std::uint8_t>(0, 0, 0, 0x03, 0x84, 0x94, 0x95, 0x77);
    if (direction == to_host)
        append_reply(out, *rc::gen::arbitrary<std::uint8_t>(), control, status, data);
    else
        append_request(out, *rc::gen::arbitrary<std::uint8_t>(), control, data);
    return out;
}

Direction arbitrary_direction() {
    return *rc::gen::element(to_host, to_reader);
}

}  // namespace

RC_GTEST_PROP(HartingCodecProperty, WhatDecodesEncodesToTheSameBytes, ()) {
    auto direction = arbitrary_direction();
    auto bytes = arbitrary_frame(direction);
    auto decoded = codec().decode(bytes, direction, true);
    RC_ASSERT(decoded.message.has_value());
    RC_ASSERT(decoded.length == bytes.size());
    Bytes again;
    auto done = codec().encode(*decoded.message, direction, again);
    if (!done) RC_FAIL(done.error().text());
    RC_ASSERT(to_hex(again) == to_hex(bytes));
}

// With all layouts that have no conditions; the others have properties of their own.
RC_GTEST_PROP(HartingCodecProperty, EveryRowTakesItsFieldsAndGivesThemBack, ()) {
    for (auto& row : commands()) {
        auto direction = arbitrary_direction();
        auto& shape = direction == to_reader ? row.request : row.reply;
        if (shape.encode != nullptr) continue;
        Message message{std::string(row.name), {}, arbitrary_fields(shape.layout)};
        Bytes bytes, again;
        RC_ASSERT(codec().encode(message, direction, bytes).has_value());
        auto decoded = codec().decode(bytes, direction, true);
        RC_ASSERT(decoded.message.has_value());
        if (direction == to_reader || !has_sub(row.control)) RC_ASSERT(decoded.message->name == row.name);
        RC_ASSERT(codec().encode(*decoded.message, direction, again).has_value());
        RC_ASSERT(bytes == again);
        if (direction == to_host && !has_sub(row.control))
            RC_ASSERT(decoded.message->fields.size() == message.fields.size());
    }
}

RC_GTEST_PROP(HartingCodecProperty, CommandsForATagAreParsedAsTheyWereAppended, ()) {
    auto command = arbitrary_command(arbitrary_tag_command());
    Bytes data;
    append_tag_command(command, data);
    auto parsed = parse_tag_command(control_of(command.command), data);
    RC_ASSERT(parsed.has_value());
    RC_ASSERT(*parsed == command);
    for (std::size_t size = 0; size < data.size(); ++size)
        RC_ASSERT(!parse_tag_command(control_of(command.command), ByteView(data).first(size)).has_value());
    auto& row = row_of(command.command);
    Fields fields;
    Bytes again;
    RC_ASSERT(decode_request(row, data, fields));
    RC_ASSERT(encode_request(row, fields, again).has_value());
    RC_ASSERT(again == data);
}

RC_GTEST_PROP(HartingCodecProperty, AnyBytesDoNoHarm, ()) {
    auto direction = arbitrary_direction();
    Bytes bytes;
    while (bytes.size() < 300 && *rc::gen::inRange(0, 6) != 0) {
        auto more = *rc::gen::inRange(0, 2) == 0 ? arbitrary_frame(direction) : arbitrary_bytes(30);
        if (!more.empty() && *rc::gen::inRange(0, 3) == 0)
            more[*rc::gen::inRange<std::size_t>(0, more.size())] = *rc::gen::arbitrary<std::uint8_t>();
        bytes.insert(bytes.end(), more.begin(), more.end());
    }
    std::size_t covered = 0;
    for (ByteView rest = bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, direction, true);
        RC_ASSERT(decoded.length > 0u);
        RC_ASSERT(decoded.length <= rest.size());
        covered += decoded.length;
        rest = rest.subspan(decoded.length);
        if (decoded.message) (void)codec().check(*decoded.message, direction);
    }
    RC_ASSERT(covered == bytes.size());
}

RC_GTEST_PROP(HartingCodecProperty, TheWalkersAgreeWithTheGenericCodec, ()) {
    auto data = arbitrary_reply_data();
    Fields fields;
    std::vector<Observation> seen;
    std::vector<InputEvent> inputs;
    Bytes bank;
    for (auto command : {Command::inventory, Command::read_buffer}) {
        fields.clear();
        bool fits = decode_reply(row_of(command), {}, 0, data, fields);
        if (!fits) continue;
        const auto& list = *fields.back().value.get<Value::List>();
        bool antennas = !list.empty() && wire::find(*list[0].get<Fields>(), "FLAGS") != nullptr;
        auto walked = command == Command::inventory ? walk_inventory(data, 0, antennas, seen, bank)
                                                    : walk_buffer(data, 0, {}, seen, bank, inputs);
        if (!walked.fault) RC_ASSERT(walked.records == list.size());
        RC_ASSERT(command == Command::read_buffer || !walked.fault.has_value());
    }
}

}  // namespace gantry::harting::test
