#include "protocols/harting/driver_setup.hpp"

#include <algorithm>
#include <array>
#include <charconv>

#include <fmt/format.h>

#include "base/text.hpp"
#include "protocols/harting/driver_settings.hpp"
#include "protocols/harting/records.hpp"

namespace gantry::harting {

namespace {
constexpr std::uint8_t interface_block = 1, identity_block = 4, read_data_block = 11, scan_block = 13;
constexpr std::uint8_t info_firmware = 0x00, info_lines = 0x60, info_device = 0x80;
constexpr int most_antennas = 4;
constexpr std::string_view give_it = "give its 8 hex digits with password_file or password_env";

std::string shown(const ConfigRow& row, std::span<const std::uint8_t> bytes) {
    if (row.secret) return "(secret)";
    auto value = get(row, bytes);
    if (auto* number = value.get<std::int64_t>())
        return fmt::format("{}{}{}{}", *number, row.unit.empty() ? "" : " ",
                           row.unit.starts_with('1') ? "x " : "", row.unit);
    if (auto* text = value.get<std::string>()) return *text;
    if (auto* raw = value.get<Bytes>()) return to_hex(*raw);
    return "?";
}

// Section 3, [0x87]: plain binary, the milliseconds with the seconds.
Request set_clock(Wall time) {
    auto day = std::chrono::floor<std::chrono::days>(time);
    std::chrono::year_month_day date(day);
    std::chrono::hh_mm_ss clock(std::chrono::floor<std::chrono::milliseconds>(time - day));
    auto year = static_cast<unsigned>(static_cast<int>(date.year()));
    Bytes data;
    wire::Writer writer(data);
    writer.u8(year / 100);
    writer.u8(year % 100);
    writer.u8(static_cast<unsigned>(date.month()));
    writer.u8(static_cast<unsigned>(date.day()));
    writer.u8(0);  // the time zone is not used
    writer.u8(static_cast<std::uint64_t>(clock.hours().count()));
    writer.u8(static_cast<std::uint64_t>(clock.minutes().count()));
    writer.u16(static_cast<std::uint64_t>(clock.seconds().count() * 1000 + clock.subseconds().count()));
    return Request(Command::set_system_time_and_date, std::move(data));
}
}  // namespace

Result<std::uint8_t> parse_antennas(std::string_view text) {
    std::uint8_t antennas = 0;
    while (!text.empty()) {
        auto piece = trimmed(text.substr(0, text.find(',')));
        text.remove_prefix(std::min(
            text.size(), text.find(',') == std::string_view::npos ? text.size() : text.find(',') + 1));
        int number = 0;
        auto [end, error] = std::from_chars(piece.data(), piece.data() + piece.size(), number);
        if (error != std::errc{} || end != piece.data() + piece.size() || number < 1 ||
            number > most_antennas)
            return fail(fmt::format("antennas: \"{}\" is no antenna", printable(piece)),
                        "write their numbers, as in \"1,2\"; there are 1 to 4");
        antennas = static_cast<std::uint8_t>(antennas | 1U << (number - 1));
    }
    return antennas;
}

DriverSetup::DriverSetup(const DriverOptions& options, Way way, KnownReader& reader, Described& described,
                         Reports& reports, std::set<std::string>& said)
    : options_(options), way_(way), reader_(reader), described_(described), reports_(reports), said_(said) {
    steps_.push_back({What::firmware, Request(Command::get_reader_info, {info_firmware})});
}

std::optional<Request> DriverSetup::next(Now now) {
    if (steps_.empty() && !planned_ && !locked_out_ && !broken_) plan();
    if (!steps_.empty()) {
        auto& step = steps_.front();
        if (step.what == What::clock) step.request = set_clock(now.wall);
        return step.request;
    }
    conclude(now);
    return {};
}

void DriverSetup::answered(const Reply& reply, Now now) {
    auto step = std::move(steps_.front());
    steps_.pop_front();
    switch (step.what) {
        case What::firmware:
            return firmware_told(reply, now);
        case What::login:
            if (!reply.ok() && !reply.silent)
                say(reply.status, fmt::format("the log-in failed: {}; is `password` right?", reply.words()),
                    now);
            return;
        case What::lines:
            if (reply.ok() && reply.data.size() >= 3) {
                reader_.inputs = reply.data[0];
                reader_.outputs = reply.data[1];
                reader_.relays = reply.data[2];
            }
            return;
        case What::device:
            if (reply.ok() && reply.data.size() >= 4)
                described_.detail += fmt::format("device {}; ", to_hex(reply.data.first(4)));
            return;
        case What::read:
            return block_told(step, reply, now);
        case What::write:
            return written(step, reply, now);
        case What::clock:
            if (!reply.ok())
                say(reply.silent ? fault_setting : reply.status,
                    fmt::format("the clock is not set: {}", reply.words()), now);
            return;
    }
}

void DriverSetup::firmware_told(const Reply& reply, Now now) {
    auto password = from_hex(options_.settings.text("password"));
    bool has_password = password && password->size() == 4;
    if (password && !password->empty() && !has_password)
        say(fault_setting, fmt::format("the password does not have 8 hex digits; {}", give_it), now);
    if (has_password && !std::exchange(login_tried_, true)) {
        // Much of what is locked says so only when it is asked for.
        steps_.push_back({What::login, Request(Command::reader_login, *password)});
        if (reply.is(Status::login_request))
            return steps_.push_back({What::firmware, Request(Command::get_reader_info, {info_firmware})});
    }
    if (reply.is(Status::login_request)) {
        locked_out_ = true;
        return say(reply.status, fmt::format("the reader wants a log-in before anything else; {}", give_it),
                   now);
    }
    if (reply.is(Status::eeprom_failure)) {
        broken_ = true;
        return say(reply.status,
                   "a configuration block in the reader's EEPROM was broken and is at its factory values "
                   "(EE-Init mode); restart the reader, then look at its settings: gantry reader restart",
                   now);
    }
    auto* record = find_record(info_records(), info_firmware);
    if (!reply.ok() || record == nullptr) {
        if (!reply.silent)
            say(reply.status, fmt::format("the reader does not say what it is: {}", reply.words()), now);
        return;
    }
    wire::Reader in(reply.data);
    wire::Fields fields;
    decode_record(record->layout, in, fields);
    auto number = [&](std::string_view name) {
        auto* value = wire::find(fields, name);
        auto read = value != nullptr ? wire::as_number(*value) : std::nullopt;
        return static_cast<std::uint16_t>(read.value_or(0));
    };
    reader_.receive_limit = number("RX-BUF");
    reader_.send_limit = number("TX-BUF");
    auto* type = reader_types.find(std::int64_t{number("SW-TYPE")});
    described_.model = !options_.model.empty() ? options_.model
                       : type != nullptr       ? std::string(type->name)
                                               : fmt::format("SW-TYPE {}", number("SW-TYPE"));
    if (reply.data.size() >= 2) described_.firmware = fmt::format("{}.{}", reply.data[0], reply.data[1]);
    reader_.model = described_.model;
    reader_.firmware = described_.firmware;
}

// --- what the settings want --------------------------------------------------------------------------------

void DriverSetup::want(std::string_view row, wire::Value value) {
    auto& known = config_row(row);
    wanted_[known.block].push_back({&known, std::move(value)});
}

// What is wanted for good is compared with EEPROM, too.
void DriverSetup::read(std::uint8_t block) {
    if (options_.settings.boolean("permanent") && !wanted_[block].empty())
        steps_.push_back({What::read, read_block(block, true), block, true});
    steps_.push_back({What::read, read_block(block), block});
}

void DriverSetup::plan() {
    planned_ = true;
    auto& settings = options_.settings;
    steps_.push_back({What::lines, Request(Command::get_reader_info, {info_lines})});
    steps_.push_back({What::device, Request(Command::get_reader_info, {info_device})});
    if (auto antennas = parse_antennas(settings.text("antennas")); antennas && *antennas != 0) {
        reader_.antennas = *antennas;
        want("CFG15.ENABLE", wire::Value(1));
        want("CFG15.SELECTION-MODE", wire::Value(1));
        want("CFG15.ANTENNA-SELECTION", wire::Value(std::int64_t{*antennas}));
    }
    if (!settings.text("power_mw").empty()) {
        // 0x10 is 100 mW, and each step 100 mW more (section 9).
        auto code = 0x0F + static_cast<std::int64_t>(settings.number("power_mw")) / 100;
        for (auto* row : {"CFG3.RF-POWER-1", "CFG20.RF-POWER-2", "CFG20.RF-POWER-3", "CFG20.RF-POWER-4"})
            want(row, wire::Value(code));
    }
    if (!settings.text("session").empty())
        want("CFG5.SESSION", wire::Value(static_cast<std::int64_t>(settings.number("session"))));
    if (!settings.text("rssi_filter").empty())
        for (int antenna = 1; antenna <= most_antennas; ++antenna)
            want(fmt::format("CFG20.RSSI-FILTER-{}", antenna),
                 wire::Value(static_cast<std::int64_t>(settings.number("rssi_filter"))));
    if (way_ == Way::buffered || way_ == Way::notification) plan_records();
    if (way_ == Way::notification) plan_notifications();
    if (way_ == Way::scan) plan_scan();
    constexpr std::array<Mode, 4> mode_of = {Mode::host, Mode::buffered_read, Mode::notification, Mode::scan};
    if (way_ != Way::keep)
        want("CFG1.MODE", wire::Value(static_cast<std::int64_t>(mode_of[static_cast<std::size_t>(way_)])));
    // The way of reading comes last, when all it needs is there.
    for (std::uint8_t block : {identity_block, read_data_block, scan_block})
        wanted_[block];
    for (auto& [block, changes] : wanted_)
        if (block != interface_block) read(block);
    if (settings.boolean("set_clock")) steps_.push_back({What::clock, set_clock({})});
    read(interface_block);
}

void DriverSetup::plan_records() {
    auto& settings = options_.settings;
    auto wanted_bank = settings.text("data_bank");
    auto bank = parse_bank(wanted_bank).value_or(Bank::user);
    bool blocks_wanted = !wanted_bank.empty();
    std::uint8_t first = tr1_idd | tr1_timer | tr1_date | tr1_antenna | tr1_extension;
    std::uint8_t second = tr2_antennas;
    if (blocks_wanted) first |= tr1_blocks;
    if (settings.text("input_events") == "on") {
        second |= tr2_input;
        want("CFG12.IN1-EVENT", wire::Value(1));
        want("CFG12.IN2-EVENT", wire::Value(1));
    } else if (settings.text("input_events") == "off") {
        want("CFG12.IN1-EVENT", wire::Value(0));
        want("CFG12.IN2-EVENT", wire::Value(0));
    }
    want("CFG11.TR-DATA1", wire::Value(std::int64_t{first}));
    want("CFG11.TR-DATA2", wire::Value(std::int64_t{second}));
    if (blocks_wanted) {
        want("CFG11.BANK", wire::Value(static_cast<std::int64_t>(bank)));
        want("CFG11.DB-ADR", wire::Value(static_cast<std::int64_t>(settings.number("data_first"))));
        want("CFG11.DB-N", wire::Value(static_cast<std::int64_t>(settings.number("data_blocks"))));
    }
    plan_valid_time();
}

void DriverSetup::plan_valid_time() {
    using namespace std::chrono_literals;
    want("CFG12.TRANSPONDER-VALID-TIME", wire::Value(options_.settings.duration("valid_time") / 100ms));
}

// Text that can be told apart: in hex, whatever stands between and behind.
void DriverSetup::plan_scan() {
    auto& settings = options_.settings;
    want("CFG13.DB-FORMAT", wire::Value(2));
    plan_valid_time();
    auto bank = parse_bank(settings.text("data_bank"));
    if (!bank) return;
    auto blocks = static_cast<std::int64_t>(settings.number("data_blocks"));
    want("CFG11.TR-DATA1", wire::Value(std::int64_t{tr1_idd | tr1_blocks}));
    want("CFG11.BANK", wire::Value(static_cast<std::int64_t>(*bank)));
    want("CFG11.DB-ADR", wire::Value(static_cast<std::int64_t>(settings.number("data_first"))));
    want("CFG11.DB-N", wire::Value(blocks));
    want("CFG11.D-START", wire::Value(0));
    want("CFG11.D-LGT", wire::Value(2 * blocks));
}

void DriverSetup::plan_notifications() {
    auto& settings = options_.settings;
    want("CFG49.ACK", wire::Value(settings.boolean("acknowledge") ? 1 : 0));
    auto seconds = std::chrono::ceil<std::chrono::seconds>(settings.duration("keepalive")).count();
    want("CFG49.KEEPALIVE", wire::Value(seconds > 0 ? 1 : 0));
    if (seconds > 0) want("CFG49.KEEPALIVE-INTERVAL", wire::Value(std::int64_t{seconds}));
    auto at = std::string_view(options_.notify_at);
    auto colon = at.rfind(':');
    if (colon == std::string_view::npos) {  // somebody else's destination stays
        unheard_ = true;
        return;
    }
    std::uint16_t to_port = 0;
    std::from_chars(at.data() + colon + 1, at.data() + at.size(), to_port);
    want("CFG49.DESTINATION", wire::Value(std::string(at.substr(0, colon))));
    want("CFG49.PORT", wire::Value(std::int64_t{to_port}));
}

void DriverSetup::block_told(const Step& step, const Reply& reply, Now now) {
    auto block = reply.block();
    auto& changes = wanted_[step.block];
    if (!block) {
        if (!reply.silent && (!changes.empty() || step.block == interface_block))
            say(reply.status,
                fmt::format("CFG{} cannot be read, so nothing in it is set: {}{}", step.block, reply.words(),
                            reply.is(Status::login_request) ? fmt::format("; {}", give_it) : std::string{}),
                now);
        return;
    }
    if (step.eeprom) {
        stored_ = *block;
        return;
    }
    if (!changes.empty() && step.block != interface_block) reader_.set[step.block] = *block;
    reader_.keep(step.block, *block);
    auto stored = std::exchange(stored_, std::nullopt);
    auto ram = *block;
    auto to_store = stored.value_or(ram);
    for (auto& change : changes) {
        auto before = shown(*change.row, ram), before_stored = shown(*change.row, to_store);
        if (auto fine = set(*change.row, change.value, ram); !fine) {
            say(fault_setting, fmt::format("{} is not set: {}", change.row->name, fine.error().text()), now);
            continue;
        }
        (void)set(*change.row, change.value, to_store);  // as it went well in RAM
        auto& from = stored && to_store != *stored ? before_stored : before;
        if (auto after = shown(*change.row, ram); after != before || (stored && after != before_stored))
            changing_.push_back(fmt::format("{} from {} to {}", change.row->name, from, after));
    }
    writing_ = ram;
    // Some readers take what is written to EEPROM into RAM as well, all of the block.
    bool store = stored && to_store != *stored;
    if (ram != *block || (store && to_store != ram))
        steps_.push_front({What::write, write_block(step.block, ram), step.block});
    if (store) steps_.push_front({What::write, write_block(step.block, to_store, true), step.block, true});
}

void DriverSetup::written(const Step& step, const Reply& reply, Now now) {
    bool another =
        !step.eeprom ? false : !steps_.empty() && steps_.front().what == What::write;  // then into RAM
    if (!reply.ok()) {
        say(reply.silent ? fault_setting : reply.status,
            fmt::format("CFG{} is not written{} ({}): {}{}", step.block, step.eeprom ? " to EEPROM" : "",
                        fmt::join(changing_, ", "), reply.words(),
                        reply.is(Status::login_request) ? fmt::format("; {}", give_it) : std::string{}),
            now);
        if (!another) changing_.clear();
        return;
    }
    if (!step.eeprom) reader_.keep(step.block, writing_);
    if (another) return;
    bool restart =
        blocks()[step.block].needs_reset && !(step.block == interface_block && changing_.size() == 1);
    needs_restart_ = needs_restart_ || restart;
    changed_.insert(changed_.end(), changing_.begin(), changing_.end());
    changing_.clear();
}

// Once over a link: several blocks may say the same, and so does each new try.
void DriverSetup::say(std::int64_t code, std::string text, Now now) {
    if (said_.insert(text).second) reports_.notice(FaultNotice{code, std::move(text), {}}, now);
}

void DriverSetup::conclude(Now now) {
    if (std::exchange(concluded_, true)) return;
    if (unheard_)
        say(fault_notifications,
            "its notifications go wherever CFG49 says, and not here: give the address with `notify`, or dial "
            "in with harting-listen://",
            now);
    if (!changed_.empty())
        described_.detail +=
            fmt::format("changed in its {}: {}; ", options_.settings.boolean("permanent") ? "EEPROM" : "RAM",
                        fmt::join(changed_, ", "));
    if (needs_restart_)
        say(fault_setting,
            options_.settings.boolean("permanent")
                ? "some of the settings take effect after a restart of the reader: gantry reader restart"
                : "some of the settings take effect only when they are in EEPROM and the reader was "
                  "restarted: "
                  "set permanent = true",
            now);
}

}  // namespace gantry::harting
