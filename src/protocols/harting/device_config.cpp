#include "protocols/harting/device_config.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/frame.hpp"

namespace gantry::harting {

void ConfigMemory::put(Stored& stored, const Block& block) {
    stored.data = block;
    stored.crc = crc_of(block);
}

ConfigMemory::ConfigMemory() {
    for (std::size_t i = 0; i < block_count; ++i)
        put(eeprom_[i], blocks()[i].factory);
    ram_ = at_start_ = eeprom_;
}

void ConfigMemory::start() {
    eeprom_failed_ = false;
    for (std::size_t i = 0; i < block_count; ++i) {
        if (crc_of(eeprom_[i].data) == eeprom_[i].crc) continue;
        put(eeprom_[i], blocks()[i].factory);
        eeprom_failed_ = true;
    }
    ram_ = at_start_ = eeprom_;
}

void ConfigMemory::spoil(std::size_t block) {
    eeprom_[block].data[0] ^= 0x01;
}

const Block& ConfigMemory::block(std::size_t number, bool eeprom) const {
    return (eeprom ? eeprom_ : ram_)[number].data;
}

void ConfigMemory::write(std::size_t number, const Block& block, bool eeprom) {
    put(ram_[number], block);
    if (eeprom) put(eeprom_[number], block);
}

void ConfigMemory::to_factory(std::size_t number, bool eeprom) {
    write(number, blocks()[number].factory, eeprom);
}

// --- by name -----------------------------------------------------------------------------------------------

// The bytes of all the blocks that a row touches.
Bytes ConfigMemory::bytes_of(const ConfigRow& row) const {
    auto& store = needs_reset(row) ? at_start_ : ram_;
    Bytes all;
    for (std::size_t i = row.block; i < std::min(row.block + blocks_of(row), block_count); ++i)
        all.insert(all.end(), store[i].data.begin(), store[i].data.end());
    return all;
}

std::int64_t ConfigMemory::number(std::string_view name) const {
    auto& row = config_row(name);
    return get_number(row, bytes_of(row));
}

Bytes ConfigMemory::bytes(std::string_view name) const {
    auto& row = config_row(name);
    auto all = bytes_of(row);
    auto from = all.begin() + row.byte;
    return Bytes(from, from + row.bits / 8);
}

Result<void> ConfigMemory::preset(std::string_view assignment) {
    auto equals = assignment.find('=');
    const auto* row = find_config(assignment.substr(0, equals));
    if (row == nullptr || equals == std::string_view::npos)
        return fail(fmt::format("\"{}\" sets no parameter of the configuration", printable(assignment)),
                    "write it like CFG1.MODE=BufferedRead");
    Bytes all;
    for (std::size_t i = row->block; i < row->block + blocks_of(*row); ++i)
        all.insert(all.end(), eeprom_[i].data.begin(), eeprom_[i].data.end());
    auto value = wire::Value(std::string(assignment.substr(equals + 1)));
    if (auto done = set(*row, value, all); !done) return fail(done.error().text());
    for (std::size_t i = 0; i < blocks_of(*row); ++i) {
        Block block;
        std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(i * block_size), block_size, block.begin());
        put(eeprom_[row->block + i], block);
    }
    return {};
}

// A bad value of one of these makes the reader misbehave on the air or unreachable, so it is refused; others
// are taken as they are.
static bool must_be_named(const ConfigRow& row) {
    return row.name == "CFG1.MODE" || row.name.find(".RF-POWER-") != std::string_view::npos;
}

bool is_legal(std::size_t block, const Block& bytes) {
    for (auto& row : config_rows()) {
        if (row.block != block || row.kind != ConfigRow::Kind::number || blocks_of(row) != 1) continue;
        auto value = get_number(row, bytes);
        if (row.min <= row.max && (value < row.min || value > row.max)) return false;
        if (must_be_named(row) && row.enumeration != nullptr && row.enumeration->find(value) == nullptr)
            return false;
    }
    return true;
}

// --- what it means -----------------------------------------------------------------------------------------

static double dbm_of(std::int64_t code) {  // 0x10: 100 mW, each more 100 mW more
    auto steps = std::clamp<std::int64_t>(code - 0x0F, 1, 20);
    return 10 * std::log10(static_cast<double>(steps) * 100);
}

static std::string nth(std::string_view name, std::size_t index) {
    return fmt::format("{}{}", name, index + 1);
}

// Multiplexing off: antenna 1. How number, selection and their switch go together is not public: here the
// switch makes the selection count.
static std::vector<std::uint16_t> antennas_of(const ConfigMemory& memory) {
    if (!memory.flag("CFG15.ENABLE")) return {1};
    auto chosen = memory.number("CFG15.ANTENNA-SELECTION");
    auto count = memory.number("CFG15.ANTENNAS");
    if (!memory.flag("CFG15.SELECTION-MODE") && count > 0)
        chosen = (std::int64_t{1} << std::min<std::int64_t>(count, antenna_count)) - 1;
    std::vector<std::uint16_t> antennas;
    for (std::uint16_t i = 0; i < antenna_count; ++i)
        if ((chosen >> i & 1) != 0) antennas.push_back(static_cast<std::uint16_t>(i + 1));
    return antennas;
}

// A bit each in SEP-CHAR and END-CHAR chooses a character; only which bit of each is the user's is known
// (section 9: the defaults 0x20 with 0x2C and 0x01 with 0x0D). Other bits mean nothing here.
static constexpr std::int64_t separator_is_user = 0x20, end_is_user = 0x01;

static Setup::Scan scan_of(const ConfigMemory& memory) {
    Setup::Scan scan;
    scan.ascii = memory.number("CFG13.DB-FORMAT") == 2;
    scan.prefix = memory.bytes("CFG13.HEADER-USER");
    scan.prefix.resize(std::min<std::size_t>(scan.prefix.size(),
                                             static_cast<std::size_t>(memory.number("CFG13.HEADER-USER-N"))));
    if ((memory.number("CFG13.SEP-CHAR") & separator_is_user) != 0)
        scan.separator = {static_cast<std::uint8_t>(memory.number("CFG13.SEP-USER"))};
    if ((memory.number("CFG13.END-CHAR") & end_is_user) != 0) {
        scan.end = memory.bytes("CFG13.END-USER");
        // The default row has a character and a count of zero: one.
        auto count = std::max<std::int64_t>(1, memory.number("CFG13.END-USER-N"));
        scan.end.resize(std::min(scan.end.size(), static_cast<std::size_t>(count)));
    }
    return scan;
}

static Setup::Notify notify_of(const ConfigMemory& memory) {
    Setup::Notify notify;
    notify.ack = memory.flag("CFG49.ACK");
    notify.keepalive = memory.flag("CFG49.KEEPALIVE");
    notify.interval = std::chrono::seconds{memory.number("CFG49.KEEPALIVE-INTERVAL")};
    notify.hold = std::chrono::seconds{memory.number("CFG49.HOLD-TIME")};
    auto host = memory.bytes("CFG49.DESTINATION");
    auto host_port = memory.number("CFG49.PORT");
    if (host_port != 0 && std::ranges::any_of(host, [](auto byte) { return byte != 0; }))
        notify.address = fmt::format("{}.{}.{}.{}:{}", host[0], host[1], host[2], host[3], host_port);
    return notify;
}

static std::vector<SelectionMask> masks_of(const ConfigMemory& memory) {
    std::vector<SelectionMask> masks;
    for (std::string_view block : {"CFG22", "CFG24", "CFG26"}) {
        auto name = [&](std::string_view part) { return fmt::format("{}.{}", block, part); };
        SelectionMask mask;
        mask.bits = static_cast<std::size_t>(memory.number(name("MASK-LENGTH")));
        if (mask.bits == 0) continue;
        mask.bank = static_cast<Bank>(memory.number(name("BANK")));
        mask.negated = memory.flag(name("NEGATION"));
        mask.first_bit = static_cast<std::size_t>(memory.number(name("FIRST-BIT")));
        mask.mask = memory.bytes(name("MASK"));
        mask.bits = std::min(mask.bits, mask.mask.size() * 8);
        masks.push_back(std::move(mask));
    }
    return masks;
}

static void add_radio(const ConfigMemory& memory, Setup& setup) {
    static constexpr std::int64_t gen2_driver = 0x0010;
    static constexpr std::int64_t epc_and_tid = 0x02;  // as IDDT; nobody has published the values of CFG4
    setup.reads_gen2 = (memory.number("CFG3.TAG-DRV") & gen2_driver) != 0;
    setup.with_tid = memory.number("CFG4.IDENTIFIER") == epc_and_tid;
    setup.tid_size = static_cast<std::size_t>(memory.number("CFG4.TID-LENGTH"));  // taken as bytes
    setup.session = static_cast<unsigned>(memory.number("CFG5.SESSION"));
    setup.antennas = antennas_of(memory);
    setup.persistence_reset = memory.flag("CFG16.ENABLE");
    for (std::size_t i = 0; i < antenna_count; ++i) {
        auto power = nth(i == 0 ? "CFG3.RF-POWER-" : "CFG20.RF-POWER-", i);
        setup.power_dbm[i] = dbm_of(memory.number(power));
        setup.rssi_filter[i] = static_cast<std::uint8_t>(memory.number(nth("CFG20.RSSI-FILTER-", i)));
        // The unit is not public; 100 ms is that of the reader's other times.
        setup.persistence[i] = Setup::Milliseconds{100 * memory.number(nth("CFG16.TIME-", i))};
    }
    setup.masks = masks_of(memory);
}

static void add_read_mode(const ConfigMemory& memory, Setup& setup) {
    auto u8 = [&](std::string_view name) { return static_cast<std::uint8_t>(memory.number(name)); };
    auto u16 = [&](std::string_view name) { return static_cast<std::uint16_t>(memory.number(name)); };
    setup.tr1 = u8("CFG11.TR-DATA1");
    setup.tr2 = u8("CFG11.TR-DATA2");
    setup.prefix_address = memory.flag("CFG11.BUS-ADDRESS-PREFIX");
    setup.pool = memory.flag("CFG11.ANTENNA-POOL");
    setup.complete_bank = memory.flag("CFG11.COMPLETE-BANK");
    setup.bank = static_cast<Bank>(memory.number("CFG11.BANK"));
    setup.first_block = u16("CFG11.DB-ADR");
    setup.blocks = u16("CFG11.DB-N");
    setup.scan_first = u8("CFG11.D-START");
    setup.scan_size = u16("CFG11.D-LGT");
    setup.valid_time = Setup::Milliseconds{100 * memory.number("CFG12.TRANSPONDER-VALID-TIME")};
    setup.tell_by_data = memory.number("CFG12.TR-ID") == 0;
    setup.identity_block = u16("CFG12.TR-ID-DB-ADR");
    setup.identity_blocks = u8("CFG12.TR-ID-DB-N");
    setup.triggered = memory.flag("CFG10.ENABLE");
    setup.unlimited = memory.flag("CFG10.UNLIMITED");
    setup.hold = Setup::Milliseconds{100 * memory.number("CFG10.IN1-HOLD-TIME")};
    setup.input_1_inverted = memory.flag("CFG2.IN1-INVERTED");
    setup.input_events = {memory.flag("CFG12.IN1-EVENT"), memory.flag("CFG12.IN2-EVENT")};
    setup.trigger_event = memory.flag("CFG12.TRIGGER-EVENT");
    setup.timeout_event = memory.flag("CFG12.TIMEOUT-EVENT");
}

Setup setup_of(const ConfigMemory& memory) {
    Setup setup;
    setup.mode = static_cast<Mode>(memory.number("CFG1.MODE"));
    setup.address = static_cast<std::uint8_t>(memory.number("CFG1.COM-ADR"));
    add_radio(memory, setup);
    add_read_mode(memory, setup);
    static constexpr std::array<std::string_view, output_count> names = {"OUT1", "OUT2", "REL1"};
    for (std::size_t i = 0; i < output_count; ++i) {
        auto& output = setup.outputs[i];
        auto u8 = [&](std::string_view block, std::string_view part) {
            return static_cast<std::uint8_t>(memory.number(fmt::format("{}.{}-{}", block, names[i], part)));
        };
        output.idle = u8("CFG2", "IDLE");
        output.active = u8("CFG2", "ACTIVE");
        output.antennas = u8("CFG9", "ANTENNA");
        output.time = Setup::Milliseconds{100 * memory.number(fmt::format("CFG2.{}-SETTING-TIME", names[i]))};
    }
    setup.scan = scan_of(memory);
    setup.notify = notify_of(memory);
    return setup;
}

}  // namespace gantry::harting
