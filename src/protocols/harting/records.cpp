#include "protocols/harting/records.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

#include "protocols/harting/tables.hpp"
#include "wire/cursor.hpp"

namespace gantry::harting {

using wire::Errc;

namespace {

// The parts of identifier data, by their sizes. On the hot path: no object is made of them.
struct Split {
    std::size_t head = 0, epc = 0;  // PC and XPC, then the EPC, then the TID
    bool has_xpc = false, has_tid = false, whole = true;
};
inline Split split(std::uint8_t transponder_type, std::uint8_t iddt, const std::uint8_t* idd,
                   std::size_t size) {
    constexpr std::uint8_t coded_header = 0x01, with_tid = 0x02, xpc_follows = 0x02;
    Split parts;
    if (transponder_type != type_epc_gen2 || iddt == coded_header) {
        parts.epc = size;
        return parts;
    }
    parts.whole = size >= 2;
    if (!parts.whole) return parts;
    parts.has_tid = iddt == with_tid;
    parts.has_xpc = (idd[0] & xpc_follows) != 0;
    parts.head = parts.has_xpc ? 4 : 2;
    parts.epc = static_cast<std::size_t>(idd[0] >> 3) * 2;
    // The PC of the air counts the XPC word. Where the EPC is all there is, it may as well not.
    if (parts.has_xpc && (parts.has_tid || size != parts.head + parts.epc)) {
        parts.whole = parts.epc >= 2;
        parts.epc -= parts.whole ? 2 : 0;
    }
    parts.whole = parts.whole && size >= parts.head + parts.epc;
    return parts;
}

std::uint16_t u16_at(const std::uint8_t* at) {
    return static_cast<std::uint16_t>(at[0] << 8 | at[1]);
}

}  // namespace

std::optional<TagIdentity> take_apart(std::uint8_t transponder_type, std::uint8_t iddt, ByteView idd) {
    auto parts = split(transponder_type, iddt, idd.data(), idd.size());
    if (!parts.whole) return {};
    TagIdentity tag{.pc = 0, .xpc = {}, .epc = idd.subspan(parts.head, parts.epc), .tid = {}};
    if (parts.head > 0) tag.pc = u16_at(idd.data());
    if (parts.has_xpc) tag.xpc = u16_at(idd.data() + 2);
    if (parts.has_tid) tag.tid = idd.subspan(parts.head + parts.epc);
    return tag;
}

// --- the reader's clock ------------------------------------------------------------------------------------

namespace {

constexpr std::int64_t us_a_minute = 60'000'000, us_a_day = 24 * 60 * us_a_minute;

// Time as the reader says it, to UTC.
class Clock {
public:
    explicit Clock(const WalkOptions& options)
        : offset_(std::chrono::microseconds(options.utc_offset).count()),
          now_(to_us(options.now) + offset_),
          midnight_(now_ - ((now_ % us_a_day) + us_a_day) % us_a_day) {}

    // Four bytes: hour, minute, milliseconds. Without a date the day is such that the time is near now.
    std::int64_t of(const std::uint8_t* timer, const std::uint8_t* date) const {
        std::int64_t in_day = (timer[0] * std::int64_t{60} + timer[1]) * us_a_minute +
                              std::int64_t{timer[2] << 8 | timer[3]} * 1000;
        if (date != nullptr)
            if (auto day = day_of(date)) return *day + in_day - offset_;
        if (now_ == offset_) return 0;  // now is not known either
        auto time = midnight_ + in_day;
        if (time > now_ + us_a_day / 2) time -= us_a_day;
        if (time < now_ - us_a_day / 2) time += us_a_day;
        return time - offset_;
    }

private:
    // Five bytes: century, year, month, day, time zone. A reader whose clock was never set sends no date.
    static std::optional<std::int64_t> day_of(const std::uint8_t* date) {
        std::chrono::year_month_day day{std::chrono::year{date[0] * 100 + date[1]},
                                        std::chrono::month{date[2]}, std::chrono::day{date[3]}};
        if (date[0] == 0 || date[0] > 99 || date[1] > 99 || !day.ok()) return {};
        return to_us(Wall{std::chrono::sys_days{day}});
    }

    std::int64_t offset_, now_, midnight_;
};

// --- walking -----------------------------------------------------------------------------------------------

// The reader gives the strength as -dBm; 0 is none.
std::int16_t rssi_of(std::uint8_t magnitude) {
    return magnitude == 0 ? Observation::no_rssi : static_cast<std::int16_t>(-10 * magnitude);
}

// The parts of a record that a walk needs, as pointers into it; null: not there.
struct Parts {
    const std::uint8_t* idd = nullptr;     // TR-TYPE, IDDT, IDD-LEN, IDD
    const std::uint8_t* blocks = nullptr;  // DB-N, DB-SIZE, DB
    const std::uint8_t* timer = nullptr;
    const std::uint8_t* date = nullptr;
    const std::uint8_t* antenna = nullptr;
    const std::uint8_t* input = nullptr;
    const std::uint8_t* antennas = nullptr;  // ANT-CNT and four bytes an antenna
    bool whole = true;
};

constexpr std::size_t timer_size = 4, date_size = 5, statistics_size = 7, input_size = 2, mac_size = 6,
                      antenna_size = 7, buffer_antenna_size = 6;

Parts parts_of(const std::uint8_t* at, const std::uint8_t* end, std::uint8_t tr1, std::uint8_t tr2) {
    Parts parts;
    auto take = [&](std::size_t size) -> const std::uint8_t* {
        if (static_cast<std::size_t>(end - at) < size) {
            parts.whole = false;
            at = end;
            return nullptr;
        }
        return std::exchange(at, at + size);
    };
    if ((tr1 & tr1_idd) != 0) {
        parts.idd = take(3);
        if (parts.whole) take(parts.idd[2]);
    }
    if ((tr1 & tr1_blocks) != 0) {
        parts.blocks = take(3);
        if (parts.blocks != nullptr) take(std::size_t{u16_at(parts.blocks)} * parts.blocks[2]);
    }
    if ((tr1 & tr1_timer) != 0) parts.timer = take(timer_size);
    if ((tr1 & tr1_date) != 0) parts.date = take(date_size);
    if ((tr1 & tr1_antenna) != 0) parts.antenna = take((tr2 & tr2_statistics) != 0 ? 1 + statistics_size : 1);
    if (tr2 == 0) return parts;
    if ((tr2 & tr2_input) != 0) parts.input = take(input_size);
    if ((tr2 & tr2_mac) != 0) take(mac_size);
    if ((tr2 & tr2_antennas) != 0) {
        parts.antennas = take(1);
        if (parts.antennas != nullptr) take(std::size_t{*parts.antennas} * buffer_antenna_size);
    }
    if ((tr2 & tr2_direction) != 0) take(1);
    return parts;
}

class Walk {
public:
    Walk(const WalkOptions& options, std::vector<Observation>& out, Bytes& bank)
        : clock_(options), block_bank_(options.block_bank), out_(out), bank_(bank) {}

    // Appends the tag; false: it has no id that can be used.
    bool tag(std::uint8_t type, std::uint8_t iddt, const std::uint8_t* idd, std::size_t size) {
        auto parts = split(type, iddt, idd, size);
        if (!parts.whole || parts.epc == 0 || parts.epc > event::TagId::max_size) return false;
        first_ = out_.size();
        out_.push_back(blank);
        auto& seen = out_.back();
        // In place: a TagId made beside it would be read back before its bytes have settled.
        seen.tag.size = static_cast<std::uint8_t>(parts.epc);
        std::memcpy(seen.tag.data.data(), idd + parts.head, parts.epc);
        seen.technology = type == type_epc_gen2 ? event::Technology::epc_gen2 : technology_of(type);
        if (parts.head > 0) {
            seen.pc = u16_at(idd);
            seen.xpc = parts.has_xpc ? std::uint32_t{u16_at(idd + 2)} << 16 : 0;
        }
        auto before = parts.head + parts.epc;
        tid_ = parts.has_tid ? ByteView(idd + before, size - before) : ByteView{};
        return true;
    }

    Observation& seen() { return out_[first_]; }

    // Data blocks, in the order of the tag's memory.
    void data(const std::uint8_t* blocks, bool lsb_first) {
        ByteView bytes;
        std::size_t block = 0;
        if (blocks != nullptr && (block_bank_ == Bank::user || block_bank_ == Bank::tid)) {
            block = blocks[2];
            bytes = ByteView(blocks + 3, u16_at(blocks) * block);
        }
        // Both say the TID: the longer one is it.
        if (block_bank_ == Bank::tid && !tid_.empty() && !bytes.empty()) {
            if (bytes.size() > tid_.size())
                tid_ = {};
            else
                bytes = {};
        }
        if (tid_.empty() && bytes.empty()) return;
        auto& tag = seen();
        auto start = bank_.size();
        tag.data_offset = static_cast<std::uint32_t>(start);
        bank_.insert(bank_.end(), tid_.begin(), tid_.end());
        bank_.insert(bank_.end(), bytes.begin(), bytes.end());
        if (lsb_first && block > 1)
            for (auto at = start + tid_.size(); at + block <= bank_.size(); at += block)
                std::reverse(bank_.begin() + static_cast<std::ptrdiff_t>(at),
                             bank_.begin() + static_cast<std::ptrdiff_t>(at + block));
        tag.data_size = static_cast<std::uint16_t>(std::min<std::size_t>(bank_.size() - start, 0xFFFF));
        tag.data_bank = bytes.empty() ? Bank::tid : block_bank_;
        tag.tid_size = bytes.empty() ? 0 : static_cast<std::uint8_t>(tid_.size());
    }

    // The next antenna that has read the same tag.
    void antenna(std::uint8_t number, std::uint8_t rssi) {
        if (seen().antenna != Observation::no_antenna) {
            auto again = seen();
            again.reads = 1;
            out_.push_back(again);
        }
        out_.back().antenna = number;
        out_.back().rssi = rssi_of(rssi);
    }

    // All reads are the first antenna's, but for one each of the others.
    void reads(std::uint16_t count, int antennas) {
        seen().reads = static_cast<std::uint16_t>(std::max(count - std::max(antennas - 1, 0), 1));
    }

    // A bit each; with statistics their count and strength.
    void antennas(const std::uint8_t* field, bool statistics) {
        if (statistics) reads(u16_at(field + 1), std::popcount(*field));
        auto rssi = statistics ? field[3] : std::uint8_t{0};
        for (unsigned bits = *field; bits != 0; bits &= bits - 1)
            antenna(static_cast<std::uint8_t>(std::countr_zero(bits) + 1), rssi);
        if (*field == 0) seen().rssi = rssi_of(rssi);
    }

    const Clock& clock() const { return clock_; }

private:
    static constexpr Observation blank = [] {
        Observation seen;
        seen.antenna = Observation::no_antenna;
        return seen;
    }();

    Clock clock_;
    Bank block_bank_;
    std::vector<Observation>& out_;
    Bytes& bank_;
    std::size_t first_ = 0;  // of the tag
    ByteView tid_;
};

}  // namespace

Walked walk_buffer(ByteView data, std::size_t base, const WalkOptions& options, std::vector<Observation>& out,
                   Bytes& bank, std::vector<InputEvent>& inputs) {
    Walked walked;
    wire::Reader in(data, base);
    auto tr1 = in.u8("TR-DATA1");
    std::uint8_t tr2 = (tr1 & tr1_extension) != 0 ? in.u8("TR-DATA2") : std::uint8_t{0};
    if ((tr2 & tr2_extension) != 0) in.u8("TR-DATA3");
    std::size_t count = in.u16("DATA-SETS");
    if (in.fault()) {
        walked.fault = in.fault();
        return walked;
    }
    Walk walk(options, out, bank);
    const auto* at = data.data() + (in.offset() - base);
    const auto* const end = data.data() + data.size();
    auto refuse = [&](Errc code) {
        walked.fault = wire::Fault{code, base + static_cast<std::size_t>(at - data.data()), "RecLen"};
    };
    for (; count > 0; --count) {
        if (end - at < 2) {
            refuse(Errc::truncated);
            return walked;
        }
        std::size_t size = u16_at(at);
        if (size < 2 || size > static_cast<std::size_t>(end - at)) {
            refuse(size < 2 ? Errc::bad_length : Errc::truncated);
            return walked;
        }
        auto parts = parts_of(at + 2, at + size, tr1, tr2);
        at += size;
        ++walked.records;
        if (!parts.whole) {
            ++walked.unusable;
            continue;
        }
        std::int64_t time = parts.timer != nullptr ? walk.clock().of(parts.timer, parts.date) : 0;
        if (parts.input != nullptr) inputs.push_back({parts.input[0], parts.input[1], time});
        if (parts.idd == nullptr) {
            if (parts.input == nullptr) ++walked.unusable;
            continue;
        }
        bool event_only = parts.input != nullptr && parts.idd[2] == 0;
        if (event_only || !walk.tag(parts.idd[0], parts.idd[1], parts.idd + 3, parts.idd[2])) {
            if (!event_only) ++walked.unusable;
            continue;
        }
        walk.seen().reader_time_us = time;
        walk.data(parts.blocks, (tr1 & tr1_lsb_first) != 0);
        bool statistics = (tr2 & tr2_statistics) != 0;
        if (parts.antennas != nullptr && *parts.antennas > 0) {
            if (parts.antenna != nullptr && statistics)
                walk.reads(u16_at(parts.antenna + 1), *parts.antennas);
            for (std::size_t i = 0; i < *parts.antennas; ++i)
                walk.antenna(parts.antennas[1 + i * buffer_antenna_size],
                             parts.antennas[2 + i * buffer_antenna_size]);
        } else if (parts.antenna != nullptr) {
            walk.antennas(parts.antenna, statistics);
        }
    }
    if (at != end) refuse(Errc::trailing_bytes);
    return walked;
}

Walked walk_inventory(ByteView data, std::size_t base, bool antennas, std::vector<Observation>& out,
                      Bytes& bank) {
    Walked walked;
    wire::Reader in(data, base);
    Walk walk({}, out, bank);
    for (std::size_t count = in.u8("DATA-SETS"); count > 0; --count) {
        std::uint8_t flags = antennas ? in.u8("FLAGS") : record_has_tag;
        bool has_tag = (flags & record_has_tag) != 0;
        bool has_antennas = (flags & record_has_antennas) != 0;
        std::uint8_t type = 0, iddt = 0;
        ByteView idd;
        if (has_tag) {
            type = in.u8("TR-TYPE");
            iddt = in.u8("IDDT");
            idd = in.bytes(in.u8("IDD-LEN"), "IDD");
        }
        // Without a tag it is one antenna, and no count.
        std::size_t entries = !has_antennas ? 0 : has_tag ? in.u8("ANT-CNT") : 1;
        auto entry = in.bytes(entries * antenna_size, "ANT-NR");
        if (in.fault()) break;
        ++walked.records;
        if (!has_tag) continue;
        if (!walk.tag(type, iddt, idd.data(), idd.size())) {
            ++walked.unusable;
            continue;
        }
        walk.data(nullptr, false);
        for (; !entry.empty(); entry = entry.subspan(antenna_size))
            walk.antenna(entry[0], entry[2]);
    }
    if (!in.fault() && in.left() > 0) in.fail(Errc::trailing_bytes, "DATA-SETS");
    walked.fault = in.fault();
    return walked;
}

// --- for the virtual reader --------------------------------------------------------------------------------

Bytes gen2_idd(ByteView epc, std::optional<std::uint16_t> xpc, ByteView tid) {
    Bytes idd;
    wire::Writer out(idd);
    auto words = (epc.size() + 1) / 2 + (xpc ? 1 : 0);
    out.u16(words << 11 | (xpc ? 0x0200u : 0u));
    if (xpc) out.u16(*xpc);
    out.bytes(epc);
    out.bytes(tid);
    return idd;
}

static void append_idd(const TagRecord& record, wire::Writer& out) {
    out.u8(record.transponder_type);
    out.u8(record.iddt);
    out.u8(record.idd.size());
    out.bytes(record.idd);
}

static void append_time(Wall time, std::uint8_t tr1, wire::Writer& out) {
    auto day = std::chrono::floor<std::chrono::days>(time);
    auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(time - day).count();
    if ((tr1 & tr1_timer) != 0) {
        out.u8(static_cast<std::uint64_t>(ms / 3'600'000));
        out.u8(static_cast<std::uint64_t>(ms / 60'000 % 60));
        out.u16(static_cast<std::uint64_t>(ms % 60'000));
    }
    if ((tr1 & tr1_date) == 0) return;
    std::chrono::year_month_day date{day};
    auto year = static_cast<unsigned>(std::clamp(static_cast<int>(date.year()), 0, 9999));
    out.u8(year / 100);
    out.u8(year % 100);
    out.u8(static_cast<unsigned>(date.month()));
    out.u8(static_cast<unsigned>(date.day()));
    out.u8(0);
}

static void append_antennas(const TagRecord& record, bool statistics, wire::Writer& out) {
    unsigned bits = 0, reads = 0, sum = 0;
    std::uint8_t strongest = 0;
    for (auto& antenna : record.antennas) {
        if (antenna.number >= 1 && antenna.number <= 8) bits |= 1u << (antenna.number - 1);
        reads += antenna.count;
        sum += antenna.rssi;
        if (strongest == 0 || (antenna.rssi != 0 && antenna.rssi < strongest)) strongest = antenna.rssi;
    }
    out.u8(bits);
    if (!statistics) return;
    out.u16(std::min(reads, 0xFFFFu));
    out.u8(strongest);
    out.u8(record.antennas.empty() ? 0 : sum / record.antennas.size());
    out.big_endian(0, 3);
}

void append_buffer_head(std::uint8_t tr1, std::uint8_t tr2, std::uint16_t data_sets, Bytes& out) {
    wire::Writer writer(out);
    writer.u8(tr1);
    if ((tr1 & tr1_extension) != 0) writer.u8(tr2);
    writer.u16(data_sets);
}

void append_record(const TagRecord& record, std::uint8_t tr1, std::uint8_t tr2, ByteView mac, Bytes& bytes) {
    wire::Writer out(bytes);
    auto start = out.hole(2);
    if ((tr1 & tr1_extension) == 0) tr2 = 0;
    if ((tr1 & tr1_idd) != 0) append_idd(record, out);
    if ((tr1 & tr1_blocks) != 0) {
        std::size_t size = record.block_size;
        auto count = size > 0 ? record.blocks.size() / size : 0;
        out.u16(count);
        out.u8(size);
        auto at = static_cast<std::ptrdiff_t>(bytes.size());
        out.bytes(ByteView(record.blocks).first(count * size));
        if ((tr1 & tr1_lsb_first) != 0)
            for (; count > 0; --count, at += static_cast<std::ptrdiff_t>(size))
                std::reverse(bytes.begin() + at, bytes.begin() + at + static_cast<std::ptrdiff_t>(size));
    }
    append_time(record.time, tr1, out);
    if ((tr1 & tr1_antenna) != 0) append_antennas(record, (tr2 & tr2_statistics) != 0, out);
    if ((tr2 & tr2_input) != 0) {
        auto input = record.input.value_or(InputEvent{});
        out.u8(input.inputs);
        out.u8(input.status);
    }
    if ((tr2 & tr2_mac) != 0)
        for (std::size_t i = 0; i < mac_size; ++i)
            out.u8(i < mac.size() ? mac[i] : 0);
    if ((tr2 & tr2_antennas) != 0) {
        out.u8(record.antennas.size());
        for (auto& antenna : record.antennas) {
            out.u8(antenna.number);
            out.u8(antenna.rssi);
            out.u16(antenna.phase);
            out.u16(0);
        }
    }
    if ((tr2 & tr2_direction) != 0) out.u8(0);
    out.patch_big_endian(start, out.written(), 2);
}

void append_inventory_tag(const TagRecord& record, bool antennas, Bytes& bytes) {
    wire::Writer out(bytes);
    if (antennas) out.u8(record_has_tag | record_has_antennas);
    append_idd(record, out);
    if (!antennas) return;
    out.u8(record.antennas.size());
    for (auto& antenna : record.antennas) {
        out.u8(antenna.number);
        out.u8(antenna.status);
        out.u8(antenna.rssi);
        out.u16(antenna.phase);
        out.u16(0);
    }
}

}  // namespace gantry::harting
