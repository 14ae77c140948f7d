// What the address of a serial line of each make means.
#include <gtest/gtest.h>

#include <algorithm>

#include <asm/termbits.h>

#include "gateway/config.hpp"
#include "link/serial.hpp"
#include "protocols/registry.hpp"

namespace gantry::cli {
namespace {

Result<link::SerialSettings> settings_of_line(const std::string& url) {
    auto address = gateway::parse_address(url);
    if (!address) return tl::unexpected(address.error());
    return link::parse_serial(address->path, address->options);
}
std::string line_of(const std::string& url) {
    auto line = settings_of_line(url);
    return line ? link::to_text(*line) : line.error().text();
}

TEST(SerialLines, EachMakeHasItsUsualSettingsAndAnAddressMaySayOthers) {
    const std::pair<std::string_view, std::string_view> usual[] = {{"silion+serial", "115200 8N1"},
                                                                   {"caen+serial", "115200 8N1"},
                                                                   {"harting+serial", "38400 8E1"},
                                                                   {"dagprog", "38400 8N1"}};
    std::size_t lines = 0;
    for (auto* plugin : plugins())
        for (auto& scheme : plugin->schemes)
            lines += scheme.kind == LinkKind::serial ? 1 : 0;
    EXPECT_EQ(lines, std::size(usual));
    for (auto& [scheme, settings] : usual) {
        auto url = std::string(scheme) + ":///dev/serial/by-id/usb-1";
        EXPECT_EQ(line_of(url), "/dev/serial/by-id/usb-1, " + std::string(settings));
        EXPECT_EQ(line_of(url + "?baud=14400&parity=odd&data=7&stop=2"),
                  "/dev/serial/by-id/usb-1, 14400 7O2");
    }
}

// What the kernel is asked for them.
TEST(SerialLines, EachMakesSettingsBecomeTheirBits) {
    struct Bits {
        std::string_view line;
        tcflag_t speed, parity;
        std::uint32_t baud;
    };
    for (auto& [address, speed, parity, baud] :
         {Bits{"silion+serial:///dev/ttyS0", B115200, 0, 115200},
          Bits{"caen+serial:///dev/ttyS0?baud=14400", BOTHER, 0, 14400},
          Bits{"harting+serial:///dev/ttyS0", B38400, PARENB, 38400},
          Bits{"harting+serial:///dev/ttyS0?parity=odd", B38400, PARENB | PARODD, 38400},
          Bits{"harting+serial:///dev/ttyS0?parity=none", B38400, 0, 38400},
          Bits{"dagprog:///dev/ttyS0", B38400, 0, 38400},
          Bits{"dagprog:///dev/ttyS0?baud=250000", BOTHER, 0, 250000}}) {
        SCOPED_TRACE(address);
        auto settings = settings_of_line(std::string(address));
        ASSERT_TRUE(settings) << settings.error().text();
        ::termios2 line{};
        link::put_mode(*settings, line);
        EXPECT_EQ(line.c_cflag & CBAUD, speed);
        EXPECT_EQ(line.c_cflag & (PARENB | PARODD), parity);
        EXPECT_EQ((line.c_iflag & INPCK) != 0, parity != 0);
        EXPECT_EQ(line.c_cflag & CSIZE, tcflag_t{CS8});
        EXPECT_EQ(line.c_cflag & CSTOPB, 0u);
        EXPECT_EQ(line.c_ospeed, baud);
    }
}

}  // namespace
}  // namespace gantry::cli
