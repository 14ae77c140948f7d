#include "sinks/webhook/verdict.hpp"

#include <gtest/gtest.h>

namespace gantry::sinks::webhook {
namespace {

const Wall now = *parse_rfc3339("2026-11-21T23:04:00Z");

TEST(WebhookVerdict, RetryAfter) {
    struct Case {
        std::string value, date;
        std::optional<std::chrono::milliseconds> wanted;
    };
    for (auto& each : std::vector<Case>{
             {"", "", {}},
             {"0", "", 0s},
             {"120", "", 120s},
             {"86401", "", 24h},
             {"99999999999999999999999", "", 24h},
             {"-5", "", {}},
             {"soon", "", {}},
             {"1.5", "", {}},
             {"Sat, 21 Nov 2026 23:05:00 GMT", "", 60s},
             {"Saturday, 21-Nov-26 23:05:00 GMT", "", 60s},
             {"Sat Nov 21 23:05:00 2026", "", 60s},
             {"Sat, 21 Nov 2026 23:03:00 GMT", "", 0s},
             {"Sat, 21 Nov 2026 23:05:00 GMT", "Sat, 21 Nov 2026 23:04:50 GMT", 10s},
             {"Sat, 21 Nov 2026 23:05:00 GMT", "no date", 60s},
             {"Sat, 21 Nov 2099 23:05:00 GMT", "", 24h},
             {"Fri, 01 Jan 999999999 00:00:00 GMT", "", {}},
         })
        EXPECT_EQ(parse_retry_after(each.value, each.date, now), each.wanted)
            << each.value << " | " << each.date;
}

TEST(WebhookVerdict, UrlsAreShownWithoutWhatIsSecret) {
    auto url = parse_url("HTTPS://Me:Hush@ERP.Example.com:8443/a/b?code=hush#part");
    ASSERT_TRUE(url);
    EXPECT_EQ(url->scheme, "https");
    EXPECT_EQ(url->host, "erp.example.com");
    EXPECT_TRUE(url->has_password);
    EXPECT_EQ(url->shown.find("ush"), std::string::npos) << url->shown;
    EXPECT_TRUE(url->shown.ends_with(":8443/a/b")) << url->shown;
    EXPECT_FALSE(parse_url("not a url"));
}

}  // namespace
}  // namespace gantry::sinks::webhook
