#include "protocols/harting/driver_scan.hpp"

#include <algorithm>

#include "protocols/harting/records.hpp"

namespace gantry::harting {

namespace {
// CFG13: SEP-CHAR and END-CHAR choose among usual characters by bits, of which only "own ones" is known (bit
// 5 and bit 0 of the two defaults, section 9); the own ones stand in SEP-USER and END-USER.
constexpr std::uint8_t format_hex = 0x02;

Bytes raw_of(std::string_view row, const Block& block, std::size_t most) {
    auto value = get(config_row(row), block);
    auto raw = wire::as_raw(value).value_or(Bytes{});
    raw.resize(std::min(raw.size(), most));
    return raw;
}
}  // namespace

void ScanText::configure(const Block& scan_format, const Block& read_data) {
    auto number = [](std::string_view row, const Block& block) {
        return static_cast<std::size_t>(get_number(config_row(row), block));
    };
    hex_ = number("CFG13.DB-FORMAT", scan_format) == format_hex;
    prefix_ = raw_of("CFG13.HEADER-USER", scan_format, number("CFG13.HEADER-USER-N", scan_format));
    end_ = raw_of("CFG13.END-USER", scan_format, number("CFG13.END-USER-N", scan_format));
    if (end_.empty()) end_ = {'\r'};
    separator_ = {static_cast<std::uint8_t>(number("CFG13.SEP-USER", scan_format))};
    if (separator_.front() == 0) separator_.clear();
    auto parts = number("CFG11.TR-DATA1", read_data);
    with_id_ = (parts & tr1_idd) != 0 || (parts & tr1_blocks) == 0;
    with_data_ = (parts & tr1_blocks) != 0;
    bank_ = static_cast<Bank>(number("CFG11.BANK", read_data) & 3);
}

ScanText::Taken ScanText::take(ByteView text, std::vector<Observation>& out, Bytes& bank) {
    Taken taken;
    pending_.insert(pending_.end(), text.begin(), text.end());
    auto at = pending_.begin();
    for (;;) {
        auto line_end = std::search(at, pending_.end(), end_.begin(), end_.end());
        if (line_end == pending_.end()) break;
        ByteView line(pending_.data() + (at - pending_.begin()), static_cast<std::size_t>(line_end - at));
        at = line_end + static_cast<std::ptrdiff_t>(end_.size());
        if (line.empty()) continue;
        if (take_line(line, out, bank))
            ++taken.tags;
        else
            ++taken.unusable;
    }
    pending_.erase(pending_.begin(), at);
    if (pending_.size() > longest_line) {
        pending_.clear();
        ++taken.unusable;
    }
    return taken;
}

bool ScanText::take_line(ByteView line, std::vector<Observation>& out, Bytes& bank) const {
    // The prefix comes once in a cycle, before its first tag.
    if (!prefix_.empty() && line.size() >= prefix_.size() &&
        std::equal(prefix_.begin(), prefix_.end(), line.begin()))
        line = line.subspan(prefix_.size());
    auto piece = [this](ByteView raw) -> std::optional<Bytes> {
        if (!hex_) return Bytes(raw.begin(), raw.end());
        return from_hex(as_text(raw));
    };
    std::optional<Bytes> id, data;
    if (with_id_) {
        auto size = line.size();
        if (with_data_ && !separator_.empty()) {
            auto cut = std::search(line.begin(), line.end(), separator_.begin(), separator_.end());
            size = static_cast<std::size_t>(cut - line.begin());
        }
        id = piece(line.first(size));
        line = line.subspan(std::min(line.size(), size + (with_data_ ? separator_.size() : 0)));
        if (!id || id->empty() || id->size() > event::TagId::max_size) return false;
    }
    if (with_data_) {
        data = piece(line);
        if (!data || (data->empty() && !with_id_)) return false;
    }
    auto& seen = out.emplace_back();
    // Data alone are all that is known of the tag: they stand for it.
    auto& known = id ? *id : *data;
    if (known.size() > event::TagId::max_size) {
        out.pop_back();
        return false;
    }
    seen.tag = event::TagId(known);
    seen.technology = event::Technology::epc_gen2;
    seen.antenna = Observation::no_antenna;
    if (data && id && (bank_ == Bank::user || bank_ == Bank::tid) && data->size() <= 0xFFFF) {
        seen.data_size = static_cast<std::uint16_t>(data->size());
        seen.data_offset = static_cast<std::uint32_t>(bank.size());
        seen.data_bank = bank_;
        bank.insert(bank.end(), data->begin(), data->end());
    }
    return true;
}

}  // namespace gantry::harting
