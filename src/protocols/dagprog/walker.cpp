#include "protocols/dagprog/walker.hpp"

#include <algorithm>
#include <cstring>

namespace gantry::dagprog {

using event::TagId;
using event::Technology;

static constexpr std::uint8_t uid_first = 0xE0;  // the top byte of every ISO15693 number
static constexpr std::size_t serial_line = 21, block_line = 16;

// 0xFF where a character is no hex digit.
static constexpr std::array<std::uint8_t, 256> digits = [] {
    std::array<std::uint8_t, 256> table{};
    table.fill(0xFF);
    for (unsigned i = 0; i < 10; ++i)
        table['0' + i] = static_cast<std::uint8_t>(i);
    for (unsigned i = 0; i < 6; ++i)
        table['A' + i] = table['a' + i] = static_cast<std::uint8_t>(10 + i);
    return table;
}();

template <std::size_t size>
static bool hex(const std::uint8_t* text, std::uint8_t* out) {
    unsigned wrong = 0;
    for (std::size_t i = 0; i < size; ++i) {
        unsigned high = digits[text[2 * i]], low = digits[text[2 * i + 1]];
        wrong |= high | low;
        out[i] = static_cast<std::uint8_t>(high << 4 | low);
    }
    return wrong < 16;
}

void put_in_order(std::array<std::uint8_t, 8>& serial, ByteOrder order, Technology technology) {
    bool turn = order == ByteOrder::lsb;
    if (order == ByteOrder::automatic)
        turn = technology != Technology::icode1 && serial[0] != uid_first && serial[7] == uid_first;
    if (turn) std::ranges::reverse(serial);
}

void TagWalker::set_up(const Setup& setup) {
    setup_ = setup;
    setup_.blocks = std::clamp<std::uint32_t>(setup.blocks, 1, max_blocks);
    pending_ = false;
    blocks_ = 0;
}

void TagWalker::emit(const TagId& tag, std::size_t blocks, std::vector<Observation>& out, Bytes& data) {
    auto& o = out.emplace_back();
    o.tag = tag;
    o.technology = setup_.technology;
    // Before it is known which kind of unit this is, the number tells.
    if (o.technology == Technology::unknown)
        o.technology = tag.data[0] == uid_first ? Technology::iso15693 : Technology::icode1;
    o.antenna = Observation::no_antenna;
    if (blocks > 0) {
        o.data_size = static_cast<std::uint16_t>(blocks * block_size);
        o.data_offset = static_cast<std::uint32_t>(data.size());
        data.insert(data.end(), run_.begin(),
                    run_.begin() + static_cast<std::ptrdiff_t>(blocks * block_size));
    }
    ++tally_.reads;
}

void TagWalker::end_serial(std::vector<Observation>& out, Bytes& data) {
    tally_.stray += blocks_;
    blocks_ = 0;
    pending_ = false;
    emit(tag_, 0, out, data);
}

void TagWalker::serial(const std::array<std::uint8_t, 8>& serial, Steady now, std::vector<Observation>& out,
                       Bytes& data) {
    if (pending_) end_serial(out, data);
    auto ordered = serial;
    put_in_order(ordered, setup_.order, setup_.technology);
    tag_ = TagId(ordered);
    tally_.stray += blocks_;
    blocks_ = 0;
    if (!setup_.data) return emit(tag_, 0, out, data);
    pending_ = true;
    since_ = now;
}

void TagWalker::block(std::uint8_t count, const std::uint8_t* block, Steady now,
                      std::vector<Observation>& out, Bytes& data) {
    if (pending_ && now > since_ + together) end_serial(out, data);
    if (!setup_.data || (setup_.serials && !pending_)) {
        ++tally_.stray;
        return;
    }
    if (setup_.crc8 != nullptr && !crc8_fits(*setup_.crc8, ByteView(block, block_size))) {
        ++tally_.bad_crc;
        tally_.stray += blocks_;
        blocks_ = 0;
        pending_ = false;  // whose data they were is no read either, as in checked reading
        return;
    }
    // The blocks of one read come in a row and carry one count (section 9.1, K11).
    if (blocks_ > 0 && count != count_) {
        tally_.stray += blocks_;
        blocks_ = 0;
    }
    count_ = count;
    std::memcpy(run_.data() + blocks_ * block_size, block, block_size);
    if (++blocks_ < setup_.blocks) return;
    if (pending_) {
        emit(tag_, blocks_, out, data);
    } else {
        auto size = std::min(blocks_ * block_size, TagId::max_size);
        emit(TagId(ByteView(run_).first(size)), blocks_, out, data);
    }
    pending_ = false;
    blocks_ = 0;
}

std::size_t TagWalker::walk(ByteView in, Steady now, std::vector<Observation>& out, Bytes& data) {
    const auto* at = in.data();
    auto left = in.size();
    while (left >= block_line && at[0] == byte_stx) {
        if (at[1] == '0') {
            std::uint8_t count = 0;
            std::array<std::uint8_t, block_size> bytes;  // NOLINT(cppcoreguidelines-pro-type-member-init)
            if (at[2] != '0' || at[3] != byte_tab || at[6] != byte_tab || at[15] != byte_cr ||
                !hex<1>(at + 4, &count) || !hex<block_size>(at + 7, bytes.data()))
                break;
            block(count, bytes.data(), now, out, data);
            at += block_line;
            left -= block_line;
        } else {
            std::array<std::uint8_t, 8> bytes;  // NOLINT(cppcoreguidelines-pro-type-member-init)
            if (left < serial_line || at[1] != 'S' || at[2] != 'N' || at[3] != byte_tab ||
                at[20] != byte_cr || !hex<8>(at + 4, bytes.data()))
                break;
            // Small numbers are results, not tags (section 5.2).
            if (std::ranges::all_of(bytes.begin(), bytes.end() - 1, [](auto b) { return b == 0; })) break;
            serial(bytes, now, out, data);
            at += serial_line;
            left -= serial_line;
        }
        ++lines_;
    }
    return in.size() - left;
}

std::optional<Steady> TagWalker::deadline() const {
    if (!pending_) return {};
    return since_ + together;
}

void TagWalker::time_passed(Steady now, std::vector<Observation>& out, Bytes& data) {
    if (pending_ && now >= since_ + together) end_serial(out, data);
}

}  // namespace gantry::dagprog
