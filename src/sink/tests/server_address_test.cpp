#include "sink/server_address.hpp"

#include <gtest/gtest.h>

namespace gantry::sink {

TEST(ServerAddress, HostAndPort) {
    auto address = parse_server_url("mqtts://broker.example:8884", 8883);
    ASSERT_TRUE(address);
    EXPECT_EQ(address->scheme, "mqtts");
    EXPECT_EQ(address->host, "broker.example");
    EXPECT_EQ(address->port, 8884);
    EXPECT_EQ(address->text(), "broker.example:8884");
    EXPECT_EQ(parse_server_url("mqtts://broker.example", 8883)->port, 8883);
    EXPECT_EQ(parse_server_url("mqtts://broker.example/", 8883)->host, "broker.example");
    EXPECT_EQ(parse_server_url("nats://[fe80::1]:4222", 1)->text(), "[fe80::1]:4222");
    EXPECT_EQ(parse_server("a", 7)->text(), "a:7");
}

TEST(ServerAddress, WhatIsNoneIsRefused) {
    for (auto* url : {"broker:1883", "mqtt://", "mqtt://:1883", "mqtt://a:0", "mqtt://a:65536",
                      "mqtt://a:18x", "mqtt://a:", "mqtt://a/path", "mqtt://a b", "mqtt://[::1",
                      "mqtt://[::1]x", "mqtt://[host]", "mqtt://a?b", "mqtt://a\n"})
        EXPECT_FALSE(parse_server_url(url, 1883)) << url;
}

TEST(ServerAddress, AUrlWithAPasswordIsRefusedAndNotRepeated) {
    auto address = parse_server_url("mqtt://joe:s3cret@broker", 1883);
    ASSERT_FALSE(address);
    EXPECT_EQ(address.error().text().find("s3cret"), std::string::npos);
}

TEST(ServerAddress, LoopbackIsTheMachineItself) {
    for (auto* host : {"localhost", "127.0.0.1", "127.8.8.8", "[::1]"})
        EXPECT_TRUE(parse_server(host, 1)->is_loopback()) << host;
    for (auto* host : {"192.168.0.1", "broker", "127.example", "[::2]", "128.0.0.1"})
        EXPECT_FALSE(parse_server(host, 1)->is_loopback()) << host;
}

}  // namespace gantry::sink
