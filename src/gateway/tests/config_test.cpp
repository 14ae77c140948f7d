#include <algorithm>
#include <fstream>

#include <gtest/gtest.h>
#include <unistd.h>

#include "gateway/config_makes.hpp"
#include "gateway/tests/toy_makes.hpp"
#include "gateway/tests/toy_sink.hpp"
#include "protocols/registry.hpp"
#include "sinks/registry.hpp"
#include "testkit/temp_dir.hpp"

namespace gantry::gateway {
namespace {

using std::chrono::hours;
using test::makes;

Result<Config> parse(std::string_view toml) {
    return parse_config(toml, "gantry.toml", makes, test::kinds);
}

constexpr std::string_view full = R"(
[gateway]
id = "site-7"
data_dir = "data/here"

[[reader]]
name = "dock-1"
address = "acme://192.168.0.125"
model = "A948EU"
notify = "0.0.0.0:3000"
advertise = "192.168.0.10:3000"
zone = "dock"
power_mw = 500
mode = "pushed"
poll_every = "1s"
checked = false
[[reader.antenna]]
name = "Ant1"
zone = "dock/left"

[[reader]]
name = "gate-*"
address = "knock-listen://0.0.0.0:9055"
from = ["192.168.0.0/24", "fe80::/10"]

[presence]
lose_after = "4s"
observe_after_reads = 3

[[zone]]
name = "dock/left"
lose_after = "1min"
offline_lose_after = "2h"

[events]
tag_read = true

[store]
keep = "7d"
max_size = "512MiB"
on_full = "drop_oldest"
)";

TEST(Config, SinksHaveAllThatTheySay) {
    auto config = parse(R"(
[[sink]]
name = "broker"
type = "box"
url = "boxes://me@h/x"
start = "oldest"
types = ["tag.*", "overflow"]
readers = ["dock-*"]
tags = ["3074ab*", "urn:epc:id:sgtin:*"]
shape = "cloudevents"
max_rate = 50
timeout = "5s"
retry_min = "2s"
tries = 4
depth = 7
[[sink]]
name = "lost"
type = "hole"
batch = 77
)");
    ASSERT_TRUE(config) << config.error().text();
    ASSERT_EQ(config->sinks.size(), 2u);
    auto& broker = config->sinks[0];
    EXPECT_EQ(broker.kind, &test::box);
    EXPECT_EQ(broker.url, "boxes://me@h/x");
    EXPECT_TRUE(broker.from_oldest);
    EXPECT_EQ(broker.selection.types.size(), 8u);
    EXPECT_EQ(broker.selection.readers, std::vector<std::string>{"dock-*"});
    EXPECT_EQ(broker.selection.tags[0], "3074AB*");
    EXPECT_EQ(broker.shape, sink::Shape::cloudevents);
    EXPECT_EQ(broker.batch, 100u) << "what suits the kind";
    EXPECT_EQ(broker.max_rate, 50u);
    EXPECT_EQ(broker.timeout, 5s);
    EXPECT_EQ(broker.retry_min, 2s);
    EXPECT_EQ(broker.retry_max, 30s);
    EXPECT_EQ(broker.tries, 4u);
    EXPECT_EQ(broker.settings.number("depth"), 7);
    EXPECT_EQ(config->sinks[1].batch, 77u);
    EXPECT_FALSE(config->sinks[1].from_oldest);
    EXPECT_EQ(config->store.sinks, (std::vector<std::string>{"broker", "lost"}));
}

TEST(Config, EveryKeyArrivesWhereItBelongs) {
    auto config = parse(full);
    ASSERT_TRUE(config) << config.error().text();
    EXPECT_EQ(config->gateway_id, "site-7");
    EXPECT_EQ(config->data_dir, "data/here");
    ASSERT_EQ(config->readers.size(), 2u);
    auto& dock = config->readers[0];
    EXPECT_EQ(dock.name, "dock-1");
    EXPECT_EQ(dock.zone, "dock");
    EXPECT_EQ(dock.address.plugin, &test::acme);
    EXPECT_EQ(dock.address.host, "192.168.0.125");
    EXPECT_EQ(dock.address.port, 1000);
    EXPECT_EQ(dock.address.text, "acme://192.168.0.125");
    EXPECT_EQ(dock.model, "A948EU");
    EXPECT_EQ(dock.notify, "0.0.0.0:3000");
    EXPECT_EQ(dock.advertise, "192.168.0.10:3000");
    EXPECT_EQ(dock.settings.number("power_mw"), 500);
    EXPECT_EQ(dock.settings.text("mode"), "pushed");
    EXPECT_EQ(dock.settings.duration("poll_every"), 1s);
    EXPECT_FALSE(dock.settings.boolean("checked"));
    ASSERT_EQ(dock.antennas.size(), 1u);
    EXPECT_EQ(dock.antennas[0].name, "Ant1");
    EXPECT_EQ(dock.antennas[0].zone, "dock/left");
    auto& gate = config->readers[1];
    EXPECT_EQ(gate.address.scheme->kind, LinkKind::listen);
    EXPECT_EQ(gate.from, (std::vector<std::string>{"192.168.0.0/24", "fe80::/10"}));
    EXPECT_EQ(gate.settings.number("repeats"), 3);
    EXPECT_EQ(config->presence.lose_after, 4s);
    EXPECT_EQ(config->presence.observe_after_reads, 3u);
    EXPECT_EQ(config->presence.glimpse_timeout, 2s);
    EXPECT_TRUE(config->tag_read);
    EXPECT_FALSE(config->tag_glimpsed);
    EXPECT_EQ(config->store.path, "data/here/gantry.db");
    EXPECT_EQ(config->store.keep, hours(24 * 7));
    EXPECT_EQ(config->store.max_size, 512u << 20);
    EXPECT_EQ(config->store.on_full, journal::OnFull::drop_oldest);
    EXPECT_TRUE(config->warnings.empty());
}

TEST(Config, AZoneHasWhatItLeavesOutFromPresence) {
    auto config = parse(full);
    ASSERT_TRUE(config) << config.error().text();
    ASSERT_EQ(config->zones.size(), 1u);
    auto& rules = config->zones[0].rules;
    EXPECT_EQ(rules.lose_after, 1min);
    EXPECT_EQ(rules.offline_lose_after, hours(2));
    EXPECT_EQ(rules.observe_after_reads, 3u);
    EXPECT_EQ(rules.purge_after, 1h);
}

TEST(Config, OfflineLoseAfterMayGoBackToNever) {
    auto config = parse(
        "[presence]\noffline_lose_after = \"1h\"\n[[zone]]\nname = \"a\"\n"
        "offline_lose_after = \"never\"\n");
    ASSERT_TRUE(config) << config.error().text();
    EXPECT_EQ(config->presence.offline_lose_after, hours(1));
    EXPECT_EQ(config->zones.at(0).rules.offline_lose_after, std::nullopt);
}

TEST(Config, GlimpsedEventsReachTheRulesOfEveryZone) {
    auto config = parse("[events]\ntag_glimpsed = true\n[[zone]]\nname = \"a\"\n");
    ASSERT_TRUE(config);
    EXPECT_TRUE(config->tag_glimpsed);
    EXPECT_TRUE(config->presence.glimpsed_events);
    EXPECT_TRUE(config->zones.at(0).rules.glimpsed_events);
}

// The rows' fallbacks are what the modules below would do by themselves.
TEST(Config, DefaultsAreThoseOfTheModules) {
    auto config = default_config();
    EXPECT_EQ(config.presence, presence::Rules{});
    EXPECT_EQ(config.store.keep, journal::Options{}.keep);
    EXPECT_EQ(config.store.max_size, journal::Options{}.max_size);
    EXPECT_EQ(config.store.on_full, journal::Options{}.on_full);
    EXPECT_EQ(config.store.path, config.data_dir / "gantry.db");
    EXPECT_TRUE(config.gateway_id.empty());
    EXPECT_TRUE(config.readers.empty());
    EXPECT_FALSE(config.tag_read);
}

TEST(Config, DataLiesUnderTheUsersStateUnlessRootRuns) {
    if (geteuid() == 0) {
        EXPECT_EQ(default_config().data_dir, "/var/lib/gantry");
        return;
    }
    setenv("XDG_STATE_HOME", "/tmp/state", 1);
    EXPECT_EQ(default_config().data_dir, "/tmp/state/gantry");
    setenv("XDG_STATE_HOME", "not/absolute", 1);
    setenv("HOME", "/home/someone", 1);
    EXPECT_EQ(default_config().data_dir, "/home/someone/.local/state/gantry");
}

TEST(Config, TheApiAddressIsAcceptedWithAWarning) {
    auto config = parse("[api]\nlisten = \"127.0.0.1:8477\"\n");
    ASSERT_TRUE(config) << config.error().text();
    EXPECT_EQ(config->warnings,
              std::vector<std::string>{"gantry.toml:2:1: api.listen is not served by this version; the "
                                       "gateway answers on gantry.sock in the data directory"});
}

TEST(Config, AZoneThatNoReaderIsInIsAWarning) {
    auto config = parse(
        "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\nzone = \"dock\"\n"
        "[[zone]]\nname = \"dokc\"\n");
    ASSERT_TRUE(config) << config.error().text();
    EXPECT_EQ(config->warnings,
              std::vector<std::string>{
                  "gantry.toml:6:8: no reader or antenna is in zone \"dokc\"; did you mean \"dock\"?"});
}

TEST(Config, ReadsFurtherApartThanPresenceWaitsAreAWarning) {
    auto warnings = [](std::string_view poll, std::string_view more) {
        auto config =
            parse("[[reader]]\nname = \"a\"\naddress = \"acme://h\"\nzone = \"dock\"\npoll_every = \"" +
                  std::string(poll) + "\"\n" + std::string(more));
        EXPECT_TRUE(config) << config.error().text();
        return config ? config->warnings : std::vector<std::string>{};
    };
    EXPECT_TRUE(warnings("2s", "").empty());
    EXPECT_EQ(warnings("5s", ""),
              std::vector<std::string>{"gantry.toml:5:14: poll_every = \"5s\" is longer than lose_after = "
                                       "\"2s\": tags that stand still will come and go"});
    EXPECT_TRUE(warnings("5s", "[presence]\nlose_after = \"6s\"\n").empty());
    EXPECT_TRUE(warnings("5s", "[[zone]]\nname = \"dock\"\nlose_after = \"6s\"\n").empty());
    EXPECT_EQ(warnings("5s",
                       "[[reader.antenna]]\nname = \"Ant1\"\nzone = \"door\"\n"
                       "[[zone]]\nname = \"dock\"\nlose_after = \"6s\"\n")
                  .size(),
              1u);
}

struct Wrong {
    std::string_view name, toml, errors;
};

class WrongConfig : public testing::TestWithParam<Wrong> {};

TEST_P(WrongConfig, SaysWhereAndWhatToDo) {
    auto config = parse(GetParam().toml);
    ASSERT_FALSE(config);
    EXPECT_EQ(config.error().text(), GetParam().errors);
}

INSTANTIATE_TEST_SUITE_P(
    Table, WrongConfig,
    testing::ValuesIn(std::vector<Wrong>{
        {"UnknownSection", "[presense]\n",
         "gantry.toml:1:2: unknown section \"presense\"; did you mean [presence]?"},
        {"UnknownRepeatedSection", "[[readers]]\n",
         "gantry.toml:1:3: unknown section \"readers\"; did you mean [[reader]]?"},
        {"SectionLikeNoOther", "[xyzzy]\n",
         "gantry.toml:1:2: unknown section \"xyzzy\"; sections: gateway, reader, presence, zone, events, "
         "store, sink, api"},
        {"UnknownKey", "[presence]\nloose_after = \"2s\"\n",
         "gantry.toml:2:1: unknown key \"loose_after\" in [presence]; did you mean \"lose_after\"?"},
        {"KeyLikeNoOther", "[events]\nxyzzy = 1\n",
         "gantry.toml:2:1: unknown key \"xyzzy\" in [events]; keys: tag_read, tag_glimpsed"},
        {"SingleSectionTwice", "[[store]]\nkeep = \"1d\"\n",
         "gantry.toml:1:3: store is a list; it stands once, as a section [store]"},
        {"RepeatedSectionOnce", "[reader]\nname = \"a\"\n",
         "gantry.toml:1:2: reader is a table; there may be several: write [[reader]]"},
        {"NumberForDuration", "[presence]\nlose_after = 2\n",
         "gantry.toml:2:14: lose_after is a whole number; write it like \"500ms\", \"2s\", \"5min\", \"1h\" "
         "or "
         "\"30d\""},
        {"BadDuration", "[presence]\nlose_after = \"2 seconds\"\n",
         "gantry.toml:2:14: lose_after = \"2 seconds\" is no duration; write it like \"500ms\", \"2s\", "
         "\"5min\", \"1h\" or \"30d\""},
        {"ShortDuration", "[presence]\nlose_after = \"0s\"\n",
         "gantry.toml:2:14: lose_after = \"0s\" is too short; it must be at least \"1ms\""},
        {"NeitherDurationNorNever", "[presence]\noffline_lose_after = \"nevr\"\n",
         "gantry.toml:2:22: offline_lose_after = \"nevr\" is no duration; write it like \"500ms\", \"2s\", "
         "\"5min\", \"1h\" or \"30d\", or \"never\""},
        {"FractionForCount", "[presence]\nobserve_after_reads = 1.5\n",
         "gantry.toml:2:23: observe_after_reads is a number; expected a whole number"},
        {"NegativeCount", "[presence]\nobserve_after_reads = -1\n",
         "gantry.toml:2:23: observe_after_reads = -1 is outside 0 to 1000000"},
        {"BadSize", "[store]\nmax_size = \"8 GiB\"\n",
         "gantry.toml:2:12: max_size = \"8 GiB\" is no size; write it like \"512MiB\" or \"8GiB\""},
        {"NumberForSize", "[store]\nmax_size = 8000000\n",
         "gantry.toml:2:12: max_size is a whole number; write it like \"512MiB\" or \"8GiB\""},
        {"SmallSize", "[store]\nmax_size = \"100B\"\n",
         "gantry.toml:2:12: max_size = \"100B\" is too small; it must be at least \"1MiB\""},
        {"BadChoice", "[store]\non_full = \"drop_newest\"\n",
         "gantry.toml:2:11: on_full = \"drop_newest\" is not known; did you mean \"drop_oldest\"?"},
        {"TextForBoolean", "[events]\ntag_read = \"yes\"\n",
         "gantry.toml:2:12: tag_read is text; expected true or false"},
        {"BadGatewayId", "[gateway]\nid = \"site 7\"\n",
         "gantry.toml:2:6: id = \"site 7\" cannot be part of an event id; use 1 to 64 letters, digits, '-', "
         "'_' and '.'"},
        {"LongGatewayId",
         "[gateway]\nid = \"0123456789012345678901234567890123456789012345678901234567890123456789\"\n",
         "gantry.toml:2:6: id is longer than 64 bytes"},
        {"EmptyText", "[gateway]\ndata_dir = \"\"\n",
         "gantry.toml:2:12: data_dir is empty; leave the key out, or name something"},
        {"ControlCharacter", "[gateway]\ndata_dir = \"a\\u0000b\"\n",
         "gantry.toml:2:12: data_dir = \"a\\x00b\" holds a control character"},
        {"SinkWithoutAType", "[[sink]]\nname = \"broker\"\n",
         "gantry.toml:1:1: [[sink]] has no type; write type = \"mqtt\""},
        {"SinkOfNoKind", "[[sink]]\nname = \"a\"\ntype = \"boxx\"\nwhatever = 1\n",
         "gantry.toml:3:8: there is no kind of sink \"boxx\"; did you mean \"box\"?"},
        {"SinkTypeMisspelt", "[[sink]]\nname = \"a\"\ntpye = \"box\"\n",
         "gantry.toml:1:1: [[sink]] has no type; write type = \"mqtt\"\n"
         "gantry.toml:3:1: unknown key \"tpye\" in [[sink]]; did you mean \"type\"?"},
        {"SinkOverWhichNoRequestsCome", "[[sink]]\nname = \"a\"\ntype = \"hole\"\ncommands = true\n",
         "gantry.toml:4:12: no requests come in over hole; remove it"},
        {"SinkWithoutUrl", "[[sink]]\nname = \"a\"\ntype = \"box\"\n",
         "gantry.toml:1:1: [[sink]] of type box needs a url; add url = \"box://… or boxes://…\""},
        {"SinkWithAUrlOfAnother", "[[sink]]\nname = \"a\"\ntype = \"box\"\nurl = \"http://h\"\n",
         "gantry.toml:4:7: url = \"http://h\" is none that box takes; write box://… or boxes://…"},
        {"SinkWithAUrlTooMany", "[[sink]]\nname = \"a\"\ntype = \"hole\"\nurl = \"http://h\"\n",
         "gantry.toml:4:7: hole takes no url; remove it"},
        {"SinkWithAPasswordInTheUrl", "[[sink]]\nname = \"a\"\ntype = \"box\"\nurl = \"box://me:hush@h\"\n",
         "gantry.toml:4:7: a password does not stand in a url; write password_file = \"/path\" or "
         "password_env = "
         "\"VARIABLE\""},
        {"SinkWithASecret",
         "[[sink]]\nname = \"a\"\ntype = \"box\"\nurl = \"box://h\"\npassword = \"hush\"\n",
         "gantry.toml:5:1: password is a secret and does not stand here; write password_file = \"/path\" or "
         "password_env = \"VARIABLE\""},
        {"SinkSettingOfAnother", "[[sink]]\nname = \"a\"\ntype = \"box\"\nurl = \"box://h\"\nwidth = 3\n",
         "gantry.toml:5:1: box sinks have no setting \"width\"; remove it"},
        {"SinkSettingMisspelt", "[[sink]]\nname = \"a\"\ntype = \"box\"\nurl = \"box://h\"\ndepht = 3\n",
         "gantry.toml:5:1: unknown key \"depht\" in [[sink]]; did you mean \"depth\"?"},
        {"SinkSettingOutOfRange", "[[sink]]\nname = \"a\"\ntype = \"box\"\nurl = \"box://h\"\ndepth = 30\n",
         "gantry.toml:5:9: depth = 30 is outside 1 to 10"},
        {"SinkThatCannotBe", "[[sink]]\nname = \"a\"\ntype = \"box\"\nurl = \"box://h\"\nbroken = true\n",
         "gantry.toml:1:1: the box is broken; get another"},
        {"SinkTypes", "[[sink]]\nname = \"a\"\ntype = \"hole\"\ntypes = [\"tag.nwe\"]\n",
         "gantry.toml:4:9: there is no event type \"tag.nwe\"; did you mean \"tag.new\"?"},
        {"SinkTags", "[[sink]]\nname = \"a\"\ntype = \"hole\"\ntags = [\"xyz\"]\n",
         "gantry.toml:4:8: tags = \"xyz\" is neither hex nor an EPC URI; write it like \"3074*\" or "
         "\"urn:epc:id:sgtin:0614141.*\""},
        {"SinkName", "[[sink]]\nname = \"a/b\"\ntype = \"hole\"\n",
         "gantry.toml:2:8: name = \"a/b\" is no name for a sink; use letters, digits, '-', '_' and '.'"},
        {"SinkTwice", "[[sink]]\nname = \"a\"\ntype = \"hole\"\n[[sink]]\nname = \"a\"\ntype = \"hole\"\n",
         "gantry.toml:5:8: sink \"a\" is already defined at line 2; names must differ"},
        {"SinkRetries", "[[sink]]\nname = \"a\"\ntype = \"hole\"\nretry_min = \"1min\"\n",
         "gantry.toml:1:1: retry_max is shorter than retry_min; make it longer"},
        {"NoNameAndNoAddress", "[[reader]]\nzone = \"dock\"\n",
         "gantry.toml:1:1: [[reader]] has no name; write name = \"dock-1\"\n"
         "gantry.toml:1:1: [[reader]] has no address; write address = \"SCHEME://HOST:PORT\""},
        {"NoScheme", "[[reader]]\nname = \"a\"\naddress = \"192.0.2.1:1000\"\n",
         "gantry.toml:3:11: \"192.0.2.1:1000\" is no address; write SCHEME://HOST:PORT; schemes: acme, "
         "acme+serial, knock-listen"},
        {"UnknownScheme", "[[reader]]\nname = \"a\"\naddress = \"knock://:9000\"\n",
         "gantry.toml:3:11: there is no scheme \"knock\"; schemes: acme, acme+serial, knock-listen"},
        {"MisspeltScheme", "[[reader]]\nname = \"a\"\naddress = \"acne://h\"\n",
         "gantry.toml:3:11: there is no scheme \"acne\"; did you mean \"acme://\"?"},
        {"NoPort", "[[reader]]\nname = \"a\"\naddress = \"knock-listen://0.0.0.0\"\n",
         "gantry.toml:3:11: \"knock-listen://0.0.0.0\" has no port; write knock-listen://0.0.0.0:PORT"},
        {"NoHost", "[[reader]]\nname = \"a\"\naddress = \"acme://:1000\"\n",
         "gantry.toml:3:11: \"acme://:1000\" does not say which host to dial; write acme://HOST:1000"},
        {"PortZero", "[[reader]]\nname = \"a\"\naddress = \"acme://h:0\"\n",
         "gantry.toml:3:11: \"acme://h:0\": port 0 cannot be dialled; write the reader's port"},
        {"SomethingAfterThePort", "[[reader]]\nname = \"a\"\naddress = \"acme://h:1/x?y=1\"\n",
         "gantry.toml:3:11: \"acme://h:1/x?y=1\" has something after the port; write acme://HOST:PORT"},
        {"SerialWithoutDevice", "[[reader]]\nname = \"a\"\naddress = \"acme+serial://ttyS0\"\n",
         "gantry.toml:3:11: \"acme+serial://ttyS0\" names no device file; write acme+serial:///dev/ttyUSB0"},
        {"BadSerialOption", "[[reader]]\nname = \"a\"\naddress = \"acme+serial:///dev/ttyS0?baud\"\n",
         "gantry.toml:3:11: \"baud\" in the address is no name=value; write options like ?baud=38400"},
        {"NameTwice",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\n[[reader]]\nname = \"a\"\naddress = "
         "\"acme://i\"\n",
         "gantry.toml:5:8: reader \"a\" is already defined at line 2; names must differ"},
        {"PatternTwiceAtOneAddress",
         "[[reader]]\nname = \"g-*\"\naddress = \"knock-listen://:9\"\n"
         "[[reader]]\nname = \"g-*\"\naddress = \"knock-listen://:9\"\n",
         "gantry.toml:5:8: reader \"g-*\" is already defined at line 2; names must differ"},
        {"AddressTwice",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\n[[reader]]\nname = \"b\"\naddress = "
         "\"acme://h:1000\"\n",
         "gantry.toml:6:11: address \"acme://h:1000\" is taken by the reader at line 3; one reader, one "
         "section"},
        {"PatternThatIsDialled", "[[reader]]\nname = \"a-*\"\naddress = \"acme://h\"\n",
         "gantry.toml:2:8: name = \"a-*\": a * is for readers that dial in; give this reader a name of its "
         "own"},
        {"BadNetwork",
         "[[reader]]\nname = \"a\"\naddress = \"knock-listen://:9\"\nfrom = [\"192.168.0.0/33\"]\n",
         "gantry.toml:4:8: from = \"192.168.0.0/33\" is no network; write it like \"192.168.0.0/24\", "
         "\"10.0.0.7\" or \"fe80::/10\""},
        {"NetworkIsNoList",
         "[[reader]]\nname = \"a\"\naddress = \"knock-listen://:9\"\nfrom = \"192.168.0.0/24\"\n",
         "gantry.toml:4:8: from is text; expected a list: from = [\"192.168.0.0/24\"]"},
        {"FromForADialledReader",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\nfrom = [\"10.0.0.0/8\"]\n",
         "gantry.toml:4:8: from is for readers that dial in, and this one is dialled; remove it"},
        {"SettingOfAnotherMake", "[[reader]]\nname = \"a\"\naddress = \"knock-listen://:9\"\npower_mw = 5\n",
         "gantry.toml:4:1: knock readers have no setting \"power_mw\"; remove it"},
        {"MisspeltSetting", "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\npowr_mw = 5\n",
         "gantry.toml:4:1: unknown key \"powr_mw\" in [[reader]]; did you mean \"power_mw\"?"},
        {"SettingOutOfRange", "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\npower_mw = 9000\n",
         "gantry.toml:4:12: power_mw = 9000 is outside 1 to 2000"},
        {"SettingOfWrongKind", "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\npower_mw = \"5\"\n",
         "gantry.toml:4:12: power_mw is text; expected a number"},
        {"SettingThatIsNoNumber", "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\npower_mw = nan\n",
         "gantry.toml:4:12: power_mw = nan is no number to work with"},
        {"SettingDuration", "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\npoll_every = 3\n",
         "gantry.toml:4:14: poll_every is a whole number; expected a duration in quotes, like \"2s\""},
        {"UnknownModel", "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\nmodel = \"A948\"\n",
         "gantry.toml:4:9: acme knows no model \"A948\"; did you mean \"A948EU\"?"},
        {"ModelLikeNoOther", "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\nmodel = \"xyzzy\"\n",
         "gantry.toml:4:9: acme knows no model \"xyzzy\"; models: A948EU, A528"},
        {"ModelOfAMakeWithoutAny",
         "[[reader]]\nname = \"a\"\naddress = \"knock-listen://:9\"\nmodel = \"A528\"\n",
         "gantry.toml:4:9: knock readers have no choice of model; remove it"},
        {"NotifyOfAMakeThatDoesNot",
         "[[reader]]\nname = \"a\"\naddress = \"knock-listen://:9\"\nnotify = \":3000\"\n",
         "gantry.toml:4:10: readers at knock-listen:// do not dial in with notifications; remove it"},
        {"NotifyOnASerialLine",
         "[[reader]]\nname = \"a\"\naddress = \"acme+serial:///dev/ttyS0\"\nnotify = \":3000\"\n",
         "gantry.toml:4:10: readers at acme+serial:// do not dial in with notifications; remove it"},
        {"AdvertiseWithoutNotify",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\nadvertise = \"10.0.0.1:3000\"\n",
         "gantry.toml:4:13: advertise says where notify is, and there is none; add notify = "
         "\"0.0.0.0:3000\", or remove it"},
        {"AdvertiseThatNobodyCanDial",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\nnotify = \":3000\"\nadvertise = \":3000\"\n",
         "gantry.toml:5:13: advertise = \":3000\" is no address a reader could dial; write it like "
         "\"192.168.0.10:3000\""},
        {"TwoNotifiersThatCannotBeToldApart",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h:1\"\nnotify = \":3000\"\n"
         "[[reader]]\nname = \"b\"\naddress = \"acme://h:2\"\nnotify = \":3000\"\n",
         "gantry.toml:8:10: the reader at line 4 has the same host and notify port: their notifications "
         "could not be told apart; give this one a notify port of its own"},
        {"UnknownAntenna",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\n[[reader.antenna]]\nname = \"Port1\"\nzone = "
         "\"z\"\n",
         "gantry.toml:5:8: acme readers have no antenna \"Port1\"; theirs are called \"Ant1\", \"Ant2\", "
         "…"},
        {"AntennaTwice",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\n[[reader.antenna]]\nname = \"Ant1\"\nzone = "
         "\"z\"\n"
         "[[reader.antenna]]\nname = \"Ant1\"\nzone = \"y\"\n",
         "gantry.toml:8:8: antenna \"Ant1\" has a zone already, at line 5; one section an antenna"},
        {"AntennaWithoutZone",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\n[[reader.antenna]]\nname = \"Ant1\"\n",
         "gantry.toml:4:1: [[reader.antenna]] has no zone; write zone = \"dock/left\""},
        {"AntennaAsTable",
         "[[reader]]\nname = \"a\"\naddress = \"acme://h\"\n[reader.antenna]\nname = \"Ant1\"\nzone = "
         "\"z\"\n",
         "gantry.toml:4:9: antenna is a table; write each antenna as a section [[reader.antenna]]"},
        {"ZoneTwice", "[[zone]]\nname = \"z\"\n[[zone]]\nname = \"z\"\n",
         "gantry.toml:4:8: zone \"z\" is already defined; names must differ"},
        {"ListOfNumbers", "reader = [1]\n",
         "gantry.toml:1:11: reader is a list with a whole number in it; write each reader as a section "
         "[[reader]]"},
        {"Date", "[gateway]\nid = 1979-05-27\n",
         "gantry.toml:2:6: id is a date or time; expected text in quotes"},
        {"Syntax", "[presence]\nlose_after = 2s\n",
         "gantry.toml:2:15: bad decimal integer: expected digit, saw 's'; text, durations and sizes stand in "
         "quotes: \"2s\""},
        {"KeyTwice", "[gateway]\nid = \"a\"\nid = \"b\"\n",
         "gantry.toml:3:1: bad key-value pair: cannot redefine existing string 'id'"},
        {"SectionThatTheParserGivesUpOn", "[events]\ntag_read = true\n[{store}]\n",
         "gantry.toml:3:1: this line is no TOML"},
        {"LetterOutsideQuotes", "[gateway]\n\u00F6 = 1\n",
         "gantry.toml:2:1: expected keys, tables, whitespace or comments, saw '\u00F6'"},
        {"NotUtf8", "[gateway]\nid = \"\xFF\"\n", "gantry.toml:2:6: Encountered invalid utf-8 sequence"},
        {"EveryErrorAtOnce", "[gateway]\nid = \"?\"\n[stor]\n[presence]\nlose_after = 1\nx = 2\n",
         "gantry.toml:2:6: id = \"?\" cannot be part of an event id; use 1 to 64 letters, digits, '-', '_' "
         "and '.'\n"
         "gantry.toml:3:2: unknown section \"stor\"; did you mean [store]?\n"
         "gantry.toml:5:14: lose_after is a whole number; write it like \"500ms\", \"2s\", \"5min\", \"1h\" "
         "or "
         "\"30d\"\n"
         "gantry.toml:6:1: unknown key \"x\" in [presence]; keys: glimpse_timeout, observe_after, "
         "observe_after_reads, lose_after, purge_after, offline_lose_after"},
    }),
    [](auto& each) { return std::string(each.param.name); });

TEST(Config, OnePatternMayServeTwoAddresses) {
    auto config = parse(
        "[[reader]]\nname = \"g-*\"\naddress = \"knock-listen://:9\"\n"
        "[[reader]]\nname = \"g-*\"\naddress = \"knock-listen://:10\"\n");
    EXPECT_TRUE(config) << config.error().text();
}

TEST(Config, ManyReadersMayDialInAtOneAddress) {
    auto config = parse(
        "[[reader]]\nname = \"a\"\naddress = \"knock-listen://:9\"\n"
        "[[reader]]\nname = \"b\"\naddress = \"knock-listen://:9\"\n");
    EXPECT_TRUE(config) << config.error().text();
}

TEST(Config, ErrorsAreBoundedInNumber) {
    std::string toml = "[events]\n";
    for (int i = 0; i < 200; ++i)
        toml += fmt::format("bad{} = 1\n", i);
    auto config = parse(toml);
    ASSERT_FALSE(config);
    auto text = config.error().text();
    EXPECT_EQ(std::ranges::count(text, '\n'), 50);
    EXPECT_TRUE(text.ends_with("gantry.toml: and 150 errors more")) << text;
}

TEST(Config, DeepKeysDoNotUseUpTheStack) {
    std::string deep = "a";
    for (int i = 0; i < 100'000; ++i)
        deep += ".a";
    EXPECT_FALSE(parse(deep + " = 1\n"));
    EXPECT_FALSE(parse("x = " + std::string(100'000, '[')));
}

TEST(Config, AFileThatIsNoConfigurationIsRefusedBySize) {
    auto config = parse(std::string(5 << 20, '#'));
    ASSERT_FALSE(config);
    EXPECT_EQ(config.error().text(), "gantry.toml:1:1: the file is over 4 MiB: is it the right file?");
}

TEST(Config, SizesAreReadInBothFamiliesOfUnits) {
    EXPECT_EQ(document::parse_size("8GiB"), std::int64_t{8} << 30);
    EXPECT_EQ(document::parse_size("512MiB"), 512 << 20);
    EXPECT_EQ(document::parse_size("1.5kB"), 1500);
    EXPECT_EQ(document::parse_size("2TB"), 2'000'000'000'000);
    EXPECT_EQ(document::parse_size("0B"), 0);
    for (auto bad : {"", "8", "GiB", "-1GiB", "8GiBs", "8Gib", "1e3MiB", "99999999999TiB", " 8GiB", "nanB"})
        EXPECT_EQ(document::parse_size(bad), std::nullopt) << bad;
}

TEST(Config, AFileThatIsNotThereIsNamed) {
    auto config = load_config("/nowhere/gantry.toml");
    ASSERT_FALSE(config);
    EXPECT_EQ(
        config.error().text(),
        "/nowhere/gantry.toml: there is no such file; `gantry config example` prints one to start from");
    EXPECT_FALSE(load_config("/tmp"));
}

TEST(Config, WhereTheDataIsCanBeReadWithoutTheSecrets) {
    testkit::TempDir dir;
    auto path = dir.path() + "/gantry.toml";
    testkit::write_file(path,
                        "[gateway]\ndata_dir = \"/data/here\"\n[[sink]]\nname = \"a\"\ntype = \"webhook\"\n"
                        "url = \"https://h/\"\nsecret_file = \"/not/for/us\"\n");
    EXPECT_FALSE(load_config(path));
    auto data = load_data_dir(path);
    ASSERT_TRUE(data) << data.error().text();
    EXPECT_EQ(*data, "/data/here");
    testkit::write_file(path, "[gateway]\ndata_dir = 7\n");
    EXPECT_FALSE(load_data_dir(path));
    testkit::write_file(path, "[gateway\n");
    EXPECT_FALSE(load_data_dir(path));
}

TEST(Config, AFileIsReadWhole) {
    auto path = std::filesystem::temp_directory_path() / fmt::format("gantry-config-test-{}.toml", getpid());
    {
        std::ofstream file(path);
        file << std::string(10'000, '#') << "\n[gateway]\nid = \"from-file\"\n";
    }
    auto config = load_config(path);
    std::filesystem::remove(path);
    ASSERT_TRUE(config) << config.error().text();
    EXPECT_EQ(config->gateway_id, "from-file");
}

TEST(Config, AddressesAreTakenApart) {
    auto serial = parse_address("acme+serial:///dev/ttyS0?baud=38400&parity=even", makes);
    ASSERT_TRUE(serial) << serial.error().text();
    EXPECT_EQ(serial->path, "/dev/ttyS0");
    EXPECT_EQ(serial->options,
              (std::vector<std::pair<std::string, std::string>>{{"baud", "38400"}, {"parity", "even"}}));
    auto six = parse_address("acme://[fe80::1]", makes);
    ASSERT_TRUE(six) << six.error().text();
    EXPECT_EQ(six->host, "fe80::1");
    EXPECT_EQ(six->port, 1000);
    auto any = parse_address("knock-listen://:9055", makes);
    ASSERT_TRUE(any) << any.error().text();
    EXPECT_EQ(any->host, "");
    EXPECT_EQ(any->port, 9055);
    EXPECT_FALSE(parse_address("acme+serial:///dev/ttyS0?baud=1&baud=2", makes));
    EXPECT_FALSE(parse_address("acme://h:70000", makes));
    EXPECT_FALSE(parse_address("acme://user@h:1", makes));
    EXPECT_FALSE(parse_address("", makes));
}

TEST(ConfigExample, IsValidAndComplete) {
    auto text = config_example("", makes);
    ASSERT_TRUE(text);
    auto config = parse(*text);
    ASSERT_TRUE(config) << config.error().text() << "\n" << *text;
    EXPECT_TRUE(config->warnings.empty());
    EXPECT_EQ(config->readers.size(), 2u);
    for (auto& section : config_sections())
        for (auto& row : section.rows)
            EXPECT_NE(text->find(row.key), std::string::npos) << section.path << "." << row.key;
}

// What is commented out is as true as the rest.
TEST(ConfigExample, IsValidWithEveryKeyInIt) {
    for (auto& section : config_sections()) {
        if (section.path == "reader" || section.path == "reader.antenna" || section.path == "sink") continue;
        auto text = *config_example("", {});
        std::string toml =
            section.repeated ? fmt::format("[[{}]]\n", section.path) : fmt::format("[{}]\n", section.path);
        for (auto& row : section.rows) {
            auto at = text.find(fmt::format("\n{} = ", row.key));
            if (at == std::string::npos) at = text.find(fmt::format("\n# {} = ", row.key));
            ASSERT_NE(at, std::string::npos) << row.key;
            auto line = text.substr(at + 1, text.find('\n', at + 1) - at - 1);
            toml += (line.starts_with("# ") ? line.substr(2) : line) + "\n";
        }
        auto config = parse(toml);
        EXPECT_TRUE(config) << toml << config.error().text();
    }
}

TEST(ConfigExample, OfAMakeIsItsSample) {
    EXPECT_EQ(*config_example("acme", makes), test::acme.sample_toml);
    auto slip = config_example("acne", makes);
    ASSERT_FALSE(slip);
    EXPECT_EQ(slip.error().text(), "there is no make \"acne\"; did you mean acme?");
}

TEST(ConfigExample, OfEveryRealMakeIsValid) {
    auto whole = config_example("");
    ASSERT_TRUE(whole);
    auto parsed = parse_config(*whole, "example");
    EXPECT_TRUE(parsed) << parsed.error().text();
    for (auto* make : plugins()) {
        auto config = parse_config(*config_example(make->name), "example");
        ASSERT_TRUE(config) << make->name << ": " << config.error().text();
        EXPECT_FALSE(config->readers.empty()) << make->name;
    }
    for (auto* kind : sink_kinds()) {
        auto sample = *config_example(kind->name);
        EXPECT_NE(sample.find(fmt::format("type = \"{}\"", kind->name)), std::string::npos) << sample;
        auto config = parse_config(sample, "example");
        ASSERT_TRUE(config) << kind->name << ": " << config.error().text();
        EXPECT_EQ(config->sinks.size(), 1u) << kind->name;
    }
}

}  // namespace
}  // namespace gantry::gateway
