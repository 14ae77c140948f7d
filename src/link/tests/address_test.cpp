#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "link/link.hpp"

namespace gantry::link {
namespace {

TEST(Endpoints, AreReadAsTheyAreWritten) {
    struct Case {
        std::string_view text, host;
        std::uint16_t port;
    };
    for (auto& [text, host, port] :
         {Case{"127.0.0.1:9055", "127.0.0.1", 9055}, Case{"[::1]:0", "::1", 0},
          Case{"localhost:80", "localhost", 80}, Case{":9055", "", 9055},
          Case{"0.0.0.0:65535", "0.0.0.0", 65535}, Case{"[fe80::1%eth0]:9", "fe80::1%eth0", 9},
          Case{"dock_1.site-7.example:1000", "dock_1.site-7.example", 1000}}) {
        auto endpoint = parse_endpoint(text);
        ASSERT_TRUE(endpoint) << endpoint.error().text();
        EXPECT_EQ(*endpoint, (Endpoint{std::string(host), port}));
        EXPECT_EQ(to_text(*endpoint), text);
    }
}

TEST(Endpoints, AreRefusedWithTheReason) {
    struct Case {
        std::string_view text, why;
    };
    for (auto& [text, why] :
         {Case{"", "port is missing"}, Case{"localhost", "port is missing"}, Case{"[::1]", "port is missing"},
          Case{"host:", "0 to 65535"}, Case{"host:65536", "0 to 65535"}, Case{"host:-1", "0 to 65535"},
          Case{"host:80x", "0 to 65535"}, Case{"::1:9055", "more than one colon"},
          Case{"[::1:9055", "closing bracket"}, Case{"[127.0.0.1]:1", "no IPv6 address"},
          Case{"[]:1", "no IPv6 address"}, Case{"a b:1", "neither an address nor a name"},
          Case{"user@host:1", "neither an address nor a name"}}) {
        auto endpoint = parse_endpoint(text);
        ASSERT_FALSE(endpoint) << text;
        EXPECT_NE(endpoint.error().what.find(why), std::string::npos) << endpoint.error().what;
        EXPECT_FALSE(endpoint.error().hint.empty());
    }
}

RC_GTEST_PROP(Endpoints, AnyTextIsReadOrRefusedWithPrintableWords, (const std::string& text)) {
    auto endpoint = parse_endpoint(text);
    if (endpoint) {
        RC_ASSERT(parse_endpoint(to_text(*endpoint)).value() == *endpoint);
    } else {
        for (auto c : endpoint.error().what)
            RC_ASSERT(static_cast<unsigned char>(c) >= 0x20);
    }
}

TEST(Networks, HoldTheirAddresses) {
    EXPECT_TRUE(in_network("192.168.0.5", "192.168.0.0/24"));
    EXPECT_FALSE(in_network("192.168.1.5", "192.168.0.0/24"));
    EXPECT_TRUE(in_network("10.0.0.7", "10.0.0.7"));
    EXPECT_FALSE(in_network("10.0.0.8", "10.0.0.7"));
    EXPECT_TRUE(in_network("10.0.0.8", "10.0.0.0/0"));
    EXPECT_TRUE(in_network("172.31.255.255", "172.16.0.0/12"));
    EXPECT_FALSE(in_network("172.32.0.0", "172.16.0.0/12"));
    EXPECT_TRUE(in_network("fe80::1234", "fe80::/10"));
    EXPECT_TRUE(in_network("fe80::1234%eth0", "fe80::/10"));
    EXPECT_FALSE(in_network("fec0::1", "fe80::/10"));
    EXPECT_TRUE(in_network("::1", "::1/128"));
    EXPECT_TRUE(in_network("2001:db8::1", "::/0"));
}

TEST(Networks, TakeMappedAddressesAsIPv4) {
    EXPECT_TRUE(in_network("::ffff:192.168.0.5", "192.168.0.0/24"));
    EXPECT_TRUE(in_network("192.168.0.5", "::ffff:192.168.0.0/120"));
    EXPECT_FALSE(in_network("::192.168.0.5", "192.168.0.0/24"));
    EXPECT_FALSE(in_network("2001:db8::1", "0.0.0.0/0"));
}

TEST(Networks, AreTold) {
    for (auto text : {"192.168.0.0/24", "10.0.0.7", "fe80::/10", "::/0", "0.0.0.0/0", "1.2.3.4/32"})
        EXPECT_TRUE(is_network(text)) << text;
    for (auto text : {"", "192.168.0.0/33", "192.168.0/24", "dock-1", "fe80::/129", "1.2.3.4/", "1.2.3.4/-1",
                      "1.2.3.4/8/8", "/8"})
        EXPECT_FALSE(is_network(text)) << text;
    EXPECT_FALSE(in_network("not an address", "0.0.0.0/0"));
    EXPECT_FALSE(in_network("1.2.3.4", "not a network"));
}

RC_GTEST_PROP(Networks, APrefixDecidesByItsBitsAlone, (std::uint32_t a, std::uint32_t b)) {
    auto bits = *rc::gen::inRange(0, 33);
    auto text = [](std::uint32_t v) {
        return std::to_string(v >> 24) + "." + std::to_string(v >> 16 & 255) + "." +
               std::to_string(v >> 8 & 255) + "." + std::to_string(v & 255);
    };
    bool same = bits == 0 || (a >> (32 - bits)) == (b >> (32 - bits));
    RC_ASSERT(in_network(text(a), text(b) + "/" + std::to_string(bits)) == same);
}

TEST(Backoff, DoublesFromTheFirstToTheMostWithinAQuarter) {
    Backoff backoff(500ms, 30s, 42);
    std::chrono::milliseconds middle = 500ms;
    for (int i = 0; i < 20; ++i) {
        auto wait = backoff.next();
        EXPECT_GE(wait, middle * 3 / 4) << i;
        EXPECT_LE(wait, middle * 5 / 4) << i;
        middle = std::min<std::chrono::milliseconds>(middle * 2, 30s);
    }
    backoff.reset();
    EXPECT_LE(backoff.next(), 625ms);
}

RC_GTEST_PROP(Backoff, NeverLeavesItsBoundsAndSpreads, (std::uint64_t seed)) {
    Backoff a(100ms, 10s, seed), b(100ms, 10s, seed + 1);
    bool differ = false;
    for (int i = 0; i < 200; ++i) {
        auto wait = a.next();
        RC_ASSERT(wait >= 75ms);
        RC_ASSERT(wait <= 12500ms);
        differ = differ || wait != b.next();
    }
    RC_ASSERT(differ);
}

TEST(Backoff, OfNothingIsNothing) {
    Backoff backoff(0ms, 0ms);
    EXPECT_EQ(backoff.next(), 0ms);
    EXPECT_EQ(backoff.next(), 0ms);
}

}  // namespace
}  // namespace gantry::link
