#pragma once
#include <algorithm>
#include <utility>

#include "protocols/harting/codec.hpp"
#include "protocols/harting/frame.hpp"
#include "protocols/harting/records.hpp"
#include "protocols/harting/tables.hpp"
#include "protocols/harting/tag_command.hpp"
#include "testkit/fuzz_input.hpp"

// What every stream must hold to, whatever the bytes: the result does not depend on the pieces, every byte is
// accounted for, memory stays bounded, and what decodes encodes to the same bytes.
namespace gantry::harting::fuzz {

using testkit::demand;
using testkit::Input;
using wire::Direction;

inline std::vector<Bytes> frames_of(Direction direction, const std::vector<ByteView>& pieces,
                                    std::size_t given) {
    std::vector<Bytes> found;
    Framer framer(direction);
    std::size_t size = 0;
    for (auto piece : pieces) {
        framer.add(piece);
        while (auto frame = framer.next()) {
            found.emplace_back(frame->bytes.begin(), frame->bytes.end());
            size += frame->bytes.size();
        }
        demand(framer.rest().size() < 65536);
    }
    demand(size + framer.tally().skipped_bytes + framer.rest().size() == given);
    demand(found.size() == framer.tally().frames);
    return found;
}

inline void check_seen(const std::vector<Observation>& seen, const Bytes& bank) {
    for (auto& each : seen) {
        demand(each.tag.size >= 1 && each.tag.size <= event::TagId::max_size);
        demand(each.reads >= 1 && each.tid_size <= each.data_size);
        demand(std::size_t{each.data_offset} + each.data_size <= bank.size());
    }
}

// The walkers see the same records as the codec, and all they point at is there.
inline void check_walks(ByteView data) {
    Bytes exact(data.begin(), data.end());
    exact.shrink_to_fit();
    std::vector<Observation> seen;
    std::vector<InputEvent> inputs;
    Bytes bank;
    auto walked = walk_buffer(exact, min_reply - 2, {}, seen, bank, inputs);
    demand(walked.unusable <= walked.records && bank.size() <= data.size());
    check_seen(seen, bank);
    wire::Fields fields;
    if (decode_reply(row_of(Command::read_buffer), {}, 0, exact, fields)) {
        demand(!walked.fault);
        demand(wire::find(fields, "DATA-SETS")->get<wire::Value::List>()->size() == walked.records);
    }
    for (bool antennas : {false, true}) {
        seen.clear();
        bank.clear();
        walked = walk_inventory(exact, min_reply - 2, antennas, seen, bank);
        demand(walked.unusable <= walked.records);
        check_seen(seen, bank);
        Bytes request = {1, antennas ? inventory_antennas : std::uint8_t{0}};
        fields.clear();
        bool fits = decode_reply(row_of(Command::inventory), request, 0, exact, fields);
        demand(fits != walked.fault.has_value());
    }
    if (auto blocks = parse_block_data(exact); blocks && blocks->bad_status == 0 && blocks->size > 0) {
        Bytes again;
        append_block_data(blocks->data, blocks->size, again);
        demand(again == exact);
    }
}

inline void check_tag_commands(ByteView data) {
    for (auto control : {host_command, epc_command}) {
        auto command = parse_tag_command(control, data);
        if (!command) continue;
        Bytes again;
        append_tag_command(*command, again);
        demand(std::ranges::equal(again, data));
    }
}

// As the driver reads the reply to each command, knowing what it asked.
inline void check_replies(ByteView data, std::uint8_t dice) {
    for (auto& row : commands()) {
        wire::Fields fields;
        Bytes request = {has_sub(row.control) ? row.sub : dice, dice}, again;
        auto status = static_cast<std::uint8_t>(dice % 4 == 0 ? 0x95 : dice % 4 == 1 ? 0x03 : 0x00);
        decode_reply(row, request, status, data, fields);
        demand(encode_reply(row, status, fields, again).has_value());
        demand(std::ranges::equal(again, data));
    }
}

inline void check_codec(ByteView bytes, Direction direction) {
    std::size_t covered = 0;
    for (auto rest = bytes; !rest.empty();) {
        auto decoded = codec().decode(rest, direction, true);
        demand(decoded.length > 0 && decoded.length <= rest.size());
        if (decoded.message) {
            Bytes again;
            demand(codec().encode(*decoded.message, direction, again).has_value());
            demand(std::ranges::equal(again, rest.first(decoded.length)));
            (void)codec().check(*decoded.message, direction);
        }
        covered += decoded.length;
        rest = rest.subspan(decoded.length);
    }
    demand(covered == bytes.size());
}

// The input as a stream; and as the data of frames whose checksum is right, which bytes by chance never have.
inline void check_stream(const std::uint8_t* data, std::size_t size, Direction direction) {
    Input input(data, size);
    // In more bytes than these one call may give up its search for the next frame.
    constexpr std::size_t always_searched = 1400;
    auto whole = frames_of(direction, {input.bytes}, input.bytes.size());
    auto cut = frames_of(direction, input.pieces(), input.bytes.size());
    demand(whole == cut || input.bytes.size() > always_searched);
    for (auto& frame : whole)
        demand(codec().decode(frame, direction, true).message.has_value());
    check_codec(input.bytes, direction);
    if (input.bytes.size() < 2) return;
    auto control = input.bytes[0], status = input.bytes[1];
    auto body = ByteView(input.bytes).subspan(2);
    if (body.size() > max_frame - min_reply) return;
    Bytes framed;
    if (direction == Direction::to_host)
        append_reply(framed, 0, control, status, body);
    else
        append_request(framed, any_address, control, body);
    check_codec(framed, direction);
    check_walks(body);
    check_tag_commands(body);
    check_replies(body, status);
}

}  // namespace gantry::harting::fuzz
