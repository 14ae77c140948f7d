#include "protocols/harting/tables.hpp"

#include <array>

#include <fmt/format.h>

namespace gantry::harting {

using wire::EnumRow;

std::string_view to_text(Confidence confidence) {
    switch (confidence) {
        case Confidence::manual:
            return "manual";
        case Confidence::confirmed:
            return "confirmed";
        case Confidence::single:
            return "single";
        case Confidence::inferred:
            return "inferred";
    }
    return "";
}

static constexpr std::array status_rows = {
    EnumRow{0x00, "ok", "done"},
    EnumRow{0x01, "no-transponder", "no transponder in the field"},
    EnumRow{0x02, "data-false", "data from the transponder with a CRC error"},
    EnumRow{0x03, "write-error",
            "the transponder did not take what was written: read-only, too far, or noise"},
    EnumRow{0x04, "address-error", "no such address in the transponder"},
    EnumRow{0x05, "wrong-transponder-type", "the command does not work on this type of transponder"},
    EnumRow{0x08, "authentication-error", "authentication failed"},
    EnumRow{0x0F, "busy", "the reader is busy"},
    EnumRow{0x10, "eeprom-failure", "EEPROM failure: the reader runs in EE-Init mode"},
    EnumRow{0x11, "parameter-range", "a parameter is outside its range"},
    EnumRow{0x13, "login-request", "log in first"},
    EnumRow{0x14, "login-error", "wrong password"},
    EnumRow{0x15, "read-protect", "must not be read"},
    EnumRow{0x16, "write-protect", "must not be written"},
    EnumRow{0x17, "firmware-activation", "the firmware must be activated first"},
    EnumRow{0x18, "wrong-firmware", "the firmware does not fit the hardware"},
    EnumRow{0x80, "unknown-command", "unknown command"},
    EnumRow{0x81, "length-error", "the length does not fit the command, or is over what the reader takes"},
    EnumRow{0x82, "command-not-available", "not available in this mode of the reader"},
    EnumRow{0x83, "rf-communication-error", "communication with the transponder failed"},
    EnumRow{0x84, "rf-warning", "RF warning: antenna, power or temperature; data may follow"},
    EnumRow{0x85, "synchronisation-error", "synchronisation failed"},
    EnumRow{0x90, "table-overrun", "the data table is full"},
    EnumRow{0x92, "no-valid-data", "no valid data: the buffer is empty"},
    EnumRow{0x93, "buffer-overflow", "the data buffer has overflowed"},
    EnumRow{0x94, "more-data", "more data than fit: ask again"},
    EnumRow{0x95, "tag-error", "the transponder refused; its own error code follows"},
    EnumRow{0xF1, "hardware-warning", "hardware warning"},
};
constinit const wire::Enumeration statuses{"STATUS", status_rows};

static constexpr std::array tag_error_rows = {
    EnumRow{0x00, "other", "an error without a code of its own"},
    EnumRow{0x01, "not-supported", "the tag does not support it"},
    EnumRow{0x02, "insufficient-privileges", "the tag does not allow it now"},
    EnumRow{0x03, "memory-overrun", "no such place in the tag's memory"},
    EnumRow{0x04, "memory-locked", "that memory is locked"},
    EnumRow{0x05, "crypto-suite-error", "the crypto suite failed"},
    EnumRow{0x06, "not-encapsulated", "the command must be encapsulated"},
    EnumRow{0x07, "response-overflow", "the answer does not fit the tag's buffer"},
    EnumRow{0x08, "security-timeout", "the tag waits after a failed authentication"},
    EnumRow{0x0B, "insufficient-power", "too little power to write"},
    EnumRow{0x0F, "non-specific", "the tag does not say why"},
};
constinit const wire::Enumeration tag_errors{"TAG-ERROR", tag_error_rows};

static constexpr std::array bank_rows = {EnumRow{0, "reserved", "passwords"}, EnumRow{1, "epc"},
                                         EnumRow{2, "tid"}, EnumRow{3, "user"}};
constinit const wire::Enumeration banks{"BANK", bank_rows};

static constexpr std::array transponder_rows = {
    EnumRow{0x00, "I-CODE1"},
    EnumRow{0x01, "Tag-it-HF"},
    EnumRow{0x03, "ISO15693"},
    EnumRow{0x04, "ISO14443A"},
    EnumRow{0x05, "ISO14443B"},
    EnumRow{0x06, "I-CODE-EPC"},
    EnumRow{0x07, "I-CODE-UID"},
    EnumRow{0x08, "Jewel"},
    EnumRow{0x09, "ISO18000-3M3"},
    EnumRow{0x0A, "SR176"},
    EnumRow{0x0B, "SRIxx"},
    EnumRow{0x0C, "MCRFxxx"},
    EnumRow{0x10, "Innovatron"},
    EnumRow{0x11, "ASK-CTx"},
    EnumRow{0x80, "ISO18000-6A"},
    EnumRow{0x81, "ISO18000-6B"},
    EnumRow{0x83, "EM4222"},
    EnumRow{type_epc_gen2, "EPC-Class1-Gen2", "the only one that an RF-R400 reads"},
    EnumRow{0x88, "EPC-Class0"},
    EnumRow{0x89, "EPC-Class1-Gen1"},
    EnumRow{0xC2, "barcode"},
};
constinit const wire::Enumeration transponder_types{"TR-TYPE", transponder_rows};

static std::string describe(const wire::Enumeration& codes, std::uint8_t code) {
    const auto* row = codes.find(code);
    if (row == nullptr) return fmt::format("0x{:02X}", code);
    return fmt::format("{} (0x{:02X})", row->note, code);
}
std::string describe(std::uint8_t status) {
    return describe(statuses, status);
}
std::string describe_tag_error(std::uint8_t error) {
    return describe(tag_errors, error);
}

event::Technology technology_of(std::uint8_t transponder_type) {
    using event::Technology;
    switch (transponder_type) {
        case 0x00:
            return Technology::icode1;
        case 0x03:
            return Technology::iso15693;
        case 0x80:
            return Technology::iso18000_6a;
        case 0x81:
            return Technology::iso18000_6b;
        case type_epc_gen2:
            return Technology::epc_gen2;
        case 0x89:
            return Technology::epc_gen1;
        default:
            return Technology::unknown;
    }
}

int transponder_type_of(event::Technology technology) {
    return technology == event::Technology::epc_gen2 ? type_epc_gen2 : -1;
}

// Of every command together: what a command's own list lacks comes without data anyway.
bool has_data(std::uint8_t status) {
    switch (static_cast<Status>(status)) {
        case Status::ok:
        case Status::firmware_activation:
        case Status::wrong_firmware:
        case Status::rf_communication_error:
        case Status::rf_warning:
        case Status::synchronisation_error:
        case Status::table_overrun:
        case Status::buffer_overflow:
        case Status::more_data:
        case Status::tag_error:
        case Status::hardware_warning:
            return true;
        default:
            return false;
    }
}

}  // namespace gantry::harting
