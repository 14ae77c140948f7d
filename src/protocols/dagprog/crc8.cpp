#include "protocols/dagprog/crc8.hpp"

#include <algorithm>
#include <array>

namespace gantry::dagprog {

static constexpr std::array rows = {
    Crc8Row{"i-code", 0x1D, 0xFD, false, 0x00, 0x7E, "named after ICODE reader chips"},
    Crc8Row{"maxim-dow", 0x31, 0x00, true, 0x00, 0xA1, "commonest in small firmware"},
    Crc8Row{"smbus", 0x07, 0x00, false, 0x00, 0xF4, "commonest plain CRC8"},
    Crc8Row{"mifare-mad", 0x1D, 0xC7, false, 0x00, 0x99, "same maker's cards"},
    Crc8Row{"hitag", 0x1D, 0xFF, false, 0x00, 0xB4, "same maker's tags"},
    Crc8Row{"tech-3250", 0x1D, 0xFF, true, 0x00, 0x97, "1D reflected"},
    Crc8Row{"gsm-a", 0x1D, 0x00, false, 0x00, 0x37, "1D from 0"},
    Crc8Row{"sae-j1850", 0x1D, 0xFF, false, 0xFF, 0x4B, "1D inverted"},
    Crc8Row{"rohc", 0x07, 0xFF, true, 0x00, 0xD0, ""},
    Crc8Row{"i-432-1", 0x07, 0x00, false, 0x55, 0xA1, ""},
    Crc8Row{"nrsc-5", 0x31, 0xFF, false, 0x00, 0xF7, ""},
    Crc8Row{"dvb-s2", 0xD5, 0x00, false, 0x00, 0xBC, ""},
};

std::span<const Crc8Row> crc8_rows() {
    return rows;
}
const Crc8Row* find_crc8(std::string_view name) {
    auto* row = std::ranges::find(rows, name, &Crc8Row::name);
    return row == rows.end() ? nullptr : row;
}

static std::uint8_t turned(std::uint8_t byte) {
    std::uint8_t out = 0;
    for (int bit = 0; bit < 8; ++bit)
        out = static_cast<std::uint8_t>(out << 1 | (byte >> bit & 1));
    return out;
}

std::uint8_t crc8(const Crc8Row& row, ByteView bytes) {
    std::uint8_t crc = row.initial;
    for (auto byte : bytes) {
        crc ^= row.reflected ? turned(byte) : byte;
        for (int bit = 0; bit < 8; ++bit)
            crc = static_cast<std::uint8_t>((crc & 0x80) != 0 ? crc << 1 ^ row.polynomial : crc << 1);
    }
    return (row.reflected ? turned(crc) : crc) ^ row.final_xor;
}

bool crc8_fits(const Crc8Row& row, ByteView block) {
    return block.size() == 4 && crc8(row, block.first(3)) == block[3];
}

Crc8Finder::Crc8Finder() {
    for (bool reversed : {false, true})
        for (auto& row : rows)
            left_.push_back({&row, reversed});
}

void Crc8Finder::sample(ByteView block) {
    if (block.size() != 4 || samples_ >= 2 * samples_to_trust) return;
    Bytes bytes(block.begin(), block.end());
    if (std::ranges::find(seen_, bytes) != seen_.end()) return;
    std::erase_if(left_, [&](const Candidate& each) {
        std::array data = {block[0], block[1], block[2]};
        if (each.reversed) std::ranges::reverse(data);
        return crc8(*each.row, data) != block[3];
    });
    seen_.push_back(std::move(bytes));
    ++samples_;
}

std::optional<Crc8Finder::Candidate> Crc8Finder::found() const {
    if (samples_ < samples_to_trust || left_.size() != 1) return {};
    return left_.front();
}

}  // namespace gantry::dagprog
