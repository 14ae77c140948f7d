#include "epc/scheme.hpp"

#include <algorithm>

namespace gantry::epc {

static constexpr Keyed sgtin_96{"sgtin",
                                "01",
                                "21",
                                1,
                                {4, 7, 10, 14, 17, 20, 24},
                                38,
                                0,
                                "company prefix",
                                "indicator and item reference"};
static constexpr Keyed sscc_96{"sscc",
                               "00",
                               "",
                               5,
                               {18, 21, 24, 28, 31, 34, 38},
                               0,
                               24,
                               "company prefix",
                               "extension and serial reference"};

// TDS 2.3 table 14-1, in the order of the headers.
static constexpr std::array schemes = {
    Scheme{0x2C, "gdti-96", "GDTI-96", 96},
    Scheme{0x2D, "gsrn-96", "GSRN-96", 96},
    Scheme{0x2E, "gsrnp-96", "GSRNP-96", 96},
    Scheme{0x2F, "usdod-96", "USDoD-96", 96},
    Scheme{0x30, "sgtin-96", "SGTIN-96", 96, &sgtin_96},
    Scheme{0x31, "sscc-96", "SSCC-96", 96, &sscc_96},
    Scheme{0x32, "sgln-96", "SGLN-96", 96},
    Scheme{0x33, "grai-96", "GRAI-96", 96},
    Scheme{0x34, "giai-96", "GIAI-96", 96},
    Scheme{0x35, "gid-96", "GID-96", 96},
    Scheme{0x36, "sgtin-198", "SGTIN-198", 198},
    Scheme{0x37, "grai-170", "GRAI-170", 170},
    Scheme{0x38, "giai-202", "GIAI-202", 202},
    Scheme{0x39, "sgln-195", "SGLN-195", 195},
    Scheme{0x3A, "gdti-113", "GDTI-113", 113},
    Scheme{0x3B, "adi-var", "ADI-var", 0},
    Scheme{0x3C, "cpi-96", "CPI-96", 96},
    Scheme{0x3D, "cpi-var", "CPI-var", 0},
    Scheme{0x3E, "gdti-174", "GDTI-174", 174},
    Scheme{0x3F, "sgcn-96", "SGCN-96", 96},
    Scheme{0x40, "itip-110", "ITIP-110", 110},
    Scheme{0x41, "itip-212", "ITIP-212", 212},
    Scheme{0xE6, "cpi++", "CPI++", 0},
    Scheme{0xE7, "gsrn++", "GSRN++", 0},
    Scheme{0xE8, "gsrnp++", "GSRNP++", 0},
    Scheme{0xE9, "sgln++", "SGLN++", 0},
    Scheme{0xEA, "gdti++", "GDTI++", 0},
    Scheme{0xEB, "grai++", "GRAI++", 0},
    Scheme{0xEC, "sgcn++", "SGCN++", 0},
    Scheme{0xED, "itip++", "ITIP++", 0},
    Scheme{0xEE, "giai++", "GIAI++", 0},
    Scheme{0xEF, "sscc++", "SSCC++", 0},
    Scheme{0xF0, "cpi+", "CPI+", 0},
    Scheme{0xF1, "grai+", "GRAI+", 0},
    Scheme{0xF2, "sgln+", "SGLN+", 0},
    Scheme{0xF3, "itip+", "ITIP+", 0},
    Scheme{0xF4, "gsrn+", "GSRN+", 84},
    Scheme{0xF5, "gsrnp+", "GSRNP+", 84},
    Scheme{0xF6, "gdti+", "GDTI+", 0},
    Scheme{0xF7, "sgtin+", "SGTIN+", 0},
    Scheme{0xF8, "sgcn+", "SGCN+", 0},
    Scheme{0xF9, "sscc+", "SSCC+", 84},
    Scheme{0xFA, "giai+", "GIAI+", 0},
    Scheme{0xFB, "dsgtin+", "DSGTIN+", 0},
    Scheme{0xFC, "dsgtin++", "DSGTIN++", 0},
    Scheme{0xFD, "sgtin++", "SGTIN++", 0},
};
static_assert(std::ranges::is_sorted(schemes, std::ranges::less_equal{}, &Scheme::header),
              "one row a header, in order");

// Which row a header byte has, plus one; 0: none.
static constexpr auto row_of_header = [] {
    std::array<std::uint8_t, 256> rows{};
    for (std::size_t i = 0; i < schemes.size(); ++i)
        rows[schemes[i].header] = static_cast<std::uint8_t>(i + 1);
    return rows;
}();

std::span<const Scheme> all_schemes() {
    return schemes;
}

const Scheme* find_header(std::uint8_t header) {
    auto row = row_of_header[header];
    return row == 0 ? nullptr : &schemes[row - 1u];
}

template <class Match>
static const Scheme* find(Match match) {
    auto it = std::ranges::find_if(schemes, match);
    return it == schemes.end() ? nullptr : &*it;
}

const Scheme* find_scheme(std::string_view name) {
    return find([&](auto& scheme) { return scheme.name == name; });
}

const Scheme* find_uri_name(std::string_view uri_name) {
    return find([&](auto& scheme) { return scheme.keyed != nullptr && scheme.keyed->uri_name == uri_name; });
}

const Scheme* find_key_ai(std::string_view ai) {
    return find([&](auto& scheme) { return scheme.keyed != nullptr && scheme.keyed->key_ai == ai; });
}

}  // namespace gantry::epc
