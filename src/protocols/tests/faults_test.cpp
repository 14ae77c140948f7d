// Every fault with every make, over each of its ways to be reached: it shows, and reading goes on after it.
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "joined.hpp"

namespace gantry::protocols::test {
namespace {

bool is_same(const FaultWord& a, const FaultWord& b) {
    return a.word == b.word;
}
bool has(const Plugin& plugin, const FaultWord& fault) {
    return std::ranges::any_of(plugin.faults(), [&](auto& each) { return is_same(each, fault); });
}
bool lasts(const FaultWord& fault) {
    return fault.value.ends_with("off");
}

// --- who can have what -------------------------------------------------------------------------------------

struct Cannot {
    std::string_view make, fault, why;
};
constexpr Cannot cannot[] = {
    {"silion", "clock-jump", "its frames carry no time"},
    {"caen", "bad-crc", "its messages have no checksum"},
    {"caen", "stuck-ack", "nothing that it sends is acknowledged"},
    {"dagprog", "clock-jump", "a unit has no clock"},
    {"dagprog", "buffer-full", "a unit keeps no tags, it sends each as it reads it"},
};

TEST(Faults, EveryMakeHasThemAllButThoseThatMeanNothingThereWhichItRefusesWithTheReason) {
    std::size_t refused = 0;
    for (auto* plugin : plugins())
        for (auto& fault : faults::common) {
            SCOPED_TRACE(std::string(plugin->name) + ": " + std::string(fault.word));
            auto row = std::ranges::find_if(
                cannot, [&](auto& each) { return each.make == plugin->name && each.fault == fault.word; });
            Joined pair({plugin, &plugin->schemes.front()});
            auto done = pair.inject(fault.word);
            if (row == std::end(cannot)) {
                EXPECT_TRUE(done) << done.error().text();
                EXPECT_TRUE(has(*plugin, fault));
                continue;
            }
            ++refused;
            EXPECT_FALSE(has(*plugin, fault));
            ASSERT_FALSE(done);
            EXPECT_EQ(done.error().what, "a reader of this make cannot have the fault \"" +
                                             std::string(fault.word) + "\": " + std::string(row->why));
            for (auto& each : plugin->faults())
                EXPECT_NE(done.error().hint.find(describe(each)), std::string::npos) << each.word;
        }
    EXPECT_EQ(refused, std::size(cannot));
}

TEST(Faults, AWordThatNobodyKnowsIsRefused) {
    for (auto* plugin : plugins()) {
        Joined pair({plugin, &plugin->schemes.front()});
        auto done = pair.inject("explode");
        ASSERT_FALSE(done);
        EXPECT_NE(done.error().what.find("there is no fault \"explode\""), std::string::npos);
    }
}

TEST(Faults, AValueThatMakesNoSenseIsRefused) {
    for (auto* plugin : plugins()) {
        Joined pair({plugin, &plugin->schemes.front()});
        for (std::string_view wrong : {"half-open perhaps", "slow soon", "garbage 70000", "garbage much",
                                       "antenna-broken 0", "antenna-broken 99", "antenna-broken x"}) {
            auto done = pair.inject(wrong);
            ASSERT_FALSE(done) << wrong;
            EXPECT_FALSE(done.error().hint.empty()) << wrong;
        }
    }
}

TEST(Faults, AWordThatStandsAloneTakesNoValue) {
    for (auto* plugin : plugins())
        for (auto& fault : plugin->faults()) {
            if (!fault.value.empty()) continue;
            Joined pair({plugin, &plugin->schemes.front()});
            auto done = pair.inject(std::string(fault.word) + " 5");
            ASSERT_FALSE(done) << fault.word;
            EXPECT_EQ(done.error().what, "\"" + std::string(fault.word) + " 5\" is not understood");
            EXPECT_EQ(done.error().hint, "\"" + std::string(fault.word) + "\" stands alone");
        }
}

TEST(Faults, ARestartFromTheStartWaitsForTheFirstLink) {
    for (auto& way : ways()) {
        SCOPED_TRACE(way.name());
        Joined pair(way, {.faults = {"reboot"}});
        EXPECT_EQ(pair.state("restarts"), 0);
        EXPECT_TRUE(pair.until([&] { return pair.state("restarts") == 1; }, 60s));
        EXPECT_EQ(pair.links > 0, !way.serial());
        EXPECT_TRUE(pair.until([&] { return pair.reads > 10; }, 120s)) << "and it reads after it";
    }
}

// --- what they do ------------------------------------------------------------------------------------------

// A driver and a reader that has been read from for a while.
struct Case {
    const Way& way;
    const FaultWord& fault;
    Joined pair;

    Case(const Way& of, const FaultWord& what, JoinedOptions options)
        : way(of), fault(what), pair(of, std::move(options)) {}
    void inject(std::string_view value = {}) {
        auto word = std::string(fault.word) + (value.empty() ? "" : " ") + std::string(value);
        auto done = pair.inject(word);
        EXPECT_TRUE(done) << word << ": " << done.error().text();
    }
    // `what` grows after the fault.
    template <class What>
    void expect_more(What what, std::string_view name) {
        auto before = what();
        inject();
        EXPECT_TRUE(pair.until([&] { return what() > before; }, 120s)) << name << " stays " << before;
    }
    void expect_more(Count which) {
        expect_more([&] { return pair.count(which); }, to_text(which));
    }
    void expect_more_in_state(std::string_view name) {
        expect_more([&] { return pair.state(name); }, name);
    }
    // Nothing comes for some time.
    void expect_silence(std::chrono::milliseconds time) {
        auto before = pair.bytes;
        pair.run_for(time);
        EXPECT_EQ(pair.bytes, before);
    }
};

void drop(Case& it) {
    auto links = it.pair.links, side_links = it.pair.side_links;
    it.inject();
    EXPECT_EQ(it.pair.links, links + 1);
    EXPECT_EQ(it.pair.side_links > side_links, it.way.notify);
}
void half_open(Case& it) {
    auto links = it.pair.links;
    it.inject();
    it.expect_silence(1500ms);
    EXPECT_EQ(it.pair.links, links) << "it seems to be there";
    EXPECT_TRUE(it.pair.until([&] { return it.pair.links > links; }, 300s)) << "until somebody has noticed";
    if (it.way.serial()) return;
    auto reads = it.pair.reads;  // ended with that link
    EXPECT_TRUE(it.pair.until([&] { return it.pair.reads > reads + 10; }, 120s));
}
void garbage(Case& it) {
    auto bytes = it.pair.bytes;
    it.expect_more([&] { return it.pair.trouble(); }, "trouble");
    EXPECT_GE(it.pair.bytes, bytes + 64);
}
void bad_crc(Case& it) {
    it.expect_more(Count::bad_checksum);
}
void truncated(Case& it) {
    it.expect_more([&] { return it.pair.trouble(); }, "trouble");
}
void duplicate(Case& it) {
    auto bytes = it.pair.bytes, reads = it.pair.reads;
    if (it.way.is("dagprog")) {
        it.expect_more(Count::malformed);  // the data of a tag without its number
    } else if (it.way.is("silion") || (it.way.is("caen") && it.way.notify)) {
        it.inject();  // nothing tells it from another read: what was acknowledged may come just so again
        EXPECT_GT(it.pair.reads, reads);
    } else if (it.way.notify || it.way.scheme->kind == LinkKind::listen) {
        it.expect_more(Count::repeats);
    } else {
        it.inject();  // an answer that nobody waits for
        EXPECT_EQ(it.pair.reads, reads);
    }
    EXPECT_GT(it.pair.bytes, bytes);
}
void slow(Case& it) {
    it.inject("2s");
    it.expect_silence(1500ms);
    auto reads = it.pair.reads;
    EXPECT_TRUE(it.pair.until([&] { return it.pair.reads > reads; }, 60s)) << "late, but it comes";
}
void stuck_ack(Case& it) {
    if (it.way.is("dagprog")) {  // what it acknowledges is commands: they come when it has restarted
        it.inject();
        auto before = it.pair.count(Count::timeouts);
        ASSERT_TRUE(it.pair.inject("reboot"));
        EXPECT_TRUE(it.pair.until([&] { return it.pair.count(Count::timeouts) > before; }, 60s));
    } else if (it.way.is("harting") && !it.way.notify && it.way.scheme->kind != LinkKind::listen) {
        it.expect_more_in_state("acks_lost");  // the host has read the buffer, and asks to clear it
        it.expect_more(Count::timeouts);
    } else {
        auto repeats = it.pair.count(Count::repeats);
        it.expect_more_in_state("resent");
        it.inject("off");
        EXPECT_TRUE(it.pair.until([&] { return it.pair.count(Count::repeats) > repeats; }, 60s));
    }
}
void reboot(Case& it) {
    it.expect_more_in_state("restarts");
}
void clock_jump(Case& it) {
    auto seconds = [](std::chrono::microseconds time) {
        return std::chrono::round<std::chrono::seconds>(time);
    };
    ASSERT_TRUE(it.pair.until([&] { return it.pair.reader_ahead.has_value(); }, 60s));
    it.pair.run_for(10s);
    auto ahead = *it.pair.reader_ahead;
    for (auto [value, by] : {std::pair("", 3600s), std::pair("-2h", -7200s), std::pair("+10min", 600s)}) {
        it.pair.clock_set.clear();
        it.inject(value);
        EXPECT_TRUE(it.pair.until([&] { return !it.pair.clock_set.empty(); }, 60s)) << value;
        it.pair.run_for(30s);
        ASSERT_EQ(it.pair.clock_set.size(), 1u) << value;
        EXPECT_LE(std::chrono::abs(it.pair.clock_set[0] - by), 2s) << it.pair.clock_set[0].count();
        ahead += by;
        EXPECT_LE(std::chrono::abs(seconds(*it.pair.reader_ahead - ahead)), 3s);
    }
}
void antenna_broken(Case& it) {
    it.inject();
    it.pair.run_for(10s);  // what was heard before
    auto heard = it.pair.reads;
    it.pair.run_for(10s);
    EXPECT_EQ(it.pair.reads, heard);
}
void buffer_full(Case& it) {
    if (it.way.is("silion")) {
        it.expect_more_in_state("dropped");
    } else if (it.way.is("harting")) {
        for (int round = 0; round < 2; ++round) {  // it is over when the host has read the buffer
            it.expect_more([&] { return it.pair.overflows; }, "overflow");
            auto told = it.pair.overflows;
            it.pair.run_for(10s);
            EXPECT_EQ(it.pair.overflows, told);
        }
    } else if (it.way.notify) {
        it.expect_more_in_state("events_dropped");
    } else {
        it.inject();  // waits for a channel, which has a memory
    }
}

struct Effect {
    const FaultWord& fault;
    void (*show)(Case& it);
};
constexpr Effect effects[] = {
    {faults::drop, drop},
    {faults::half_open, half_open},
    {faults::garbage, garbage},
    {faults::bad_crc, bad_crc},
    {faults::truncated, truncated},
    {faults::duplicate, duplicate},
    {faults::slow, slow},
    {faults::stuck_ack, stuck_ack},
    {faults::reboot, reboot},
    {faults::antenna_broken, antenna_broken},
    {faults::clock_jump, clock_jump},
    {faults::buffer_full, buffer_full},
};

// What it takes for the fault to show.
std::vector<JoinedOptions> settings_for(const Way& way, const FaultWord& fault) {
    if (is_same(fault, faults::clock_jump)) return {{.device = {{"clock", "set"}}}};
    // The CRC8 of a unit is in the data of tags: looked at where that is asked for, at either end.
    if (is_same(fault, faults::bad_crc) && way.is("dagprog"))
        return {{.driver = {{"mode", "rc"}}}, {.driver = {{"check_crc8", "true"}, {"crc8", "i-code"}}}};
    return {{}};
}

class EveryFault : public ::testing::TestWithParam<std::size_t> {};

TEST_P(EveryFault, ShowsAndReadingGoesOnAfterIt) {
    auto& [fault, show] = effects[GetParam()];
    std::size_t shown = 0;
    for (auto& way : ways()) {
        if (!has(*way.plugin, fault)) continue;
        for (auto& options : settings_for(way, fault)) {
            SCOPED_TRACE(way.name() + ": " + std::string(fault.word));
            Case it(way, fault, options);
            auto& pair = it.pair;
            ASSERT_TRUE(pair.until([&] { return pair.reads > 10; }, 60s));
            pair.run_for(10s);
            show(it);
            if (lasts(fault)) it.inject("off");
            auto reads = pair.reads;
            EXPECT_TRUE(pair.until([&] { return pair.reads > reads + 10; }, 300s));
            auto links = pair.links;
            pair.run_for(60s);
            EXPECT_EQ(pair.links, links) << "nothing of it is left";
            ++shown;
        }
    }
    EXPECT_GE(shown, 5u);
}

TEST_P(EveryFault, FromTheStartLetsReadingBegin) {
    auto& fault = effects[GetParam()].fault;
    for (auto& way : ways()) {
        if (!has(*way.plugin, fault)) continue;
        SCOPED_TRACE(way.name() + ": " + std::string(fault.word));
        Joined pair(way, {.faults = {std::string(fault.word)}});
        EXPECT_EQ(pair.refused, "");
        pair.run_for(20s);
        EXPECT_TRUE(!is_same(fault, faults::drop) || pair.links == 1) << pair.links;
        EXPECT_TRUE(!is_same(fault, faults::antenna_broken) || pair.reads == 0) << pair.reads;
        EXPECT_TRUE(!is_same(fault, faults::half_open) || !way.serial() || pair.bytes == 0) << pair.bytes;
        ASSERT_TRUE(!lasts(fault) || pair.inject(std::string(fault.word) + " off"));
        EXPECT_TRUE(pair.until([&] { return pair.reads > 10; }, 300s));
    }
}

// What else a make can be told to be, and how else it can be read.
std::vector<JoinedOptions> others(const Way& way) {
    std::vector<JoinedOptions> all;
    if (way.is("silion")) all = {{.device = {{"generation", "1"}}}, {.device = {{"ack", "false"}}}};
    if (way.is("caen") && !way.notify)
        for (auto* mode : {"raw", "inventory", "framed"})
            all.push_back({.driver = {{"mode", mode}}});
    if (way.is("harting") && way.scheme->kind != LinkKind::listen && !way.notify)
        all.push_back({.driver = {{"mode", "host"}}});
    if (way.is("harting") && way.serial()) all.push_back({.driver = {{"mode", "scan"}}});
    if (way.is("harting") && way.scheme->kind == LinkKind::listen)
        all.push_back({.device = {{"ack", "false"}}});
    if (way.is("dagprog")) all = {{.device = {{"family", "icode1"}}}, {.driver = {{"mode", "sr"}}}};
    return all;
}

TEST_P(EveryFault, IsOverInEveryOtherWayToReadAsWell) {
    auto& fault = effects[GetParam()].fault;
    for (auto& way : ways())
        for (auto& options : others(way)) {
            if (!has(*way.plugin, fault)) continue;
            auto& set = options.driver.empty() ? options.device.front() : options.driver.front();
            SCOPED_TRACE(way.name() + ", " + set.first + " " + set.second + ": " + std::string(fault.word));
            Joined pair(way, options);
            ASSERT_TRUE(pair.until([&] { return pair.reads > 5; }, 60s));
            ASSERT_TRUE(pair.inject(fault.word));
            pair.run_for(10s);
            ASSERT_TRUE(!lasts(fault) || pair.inject(std::string(fault.word) + " off"));
            auto reads = pair.reads;
            EXPECT_TRUE(pair.until([&] { return pair.reads > reads + 5; }, 300s));
        }
}

std::string name_of_fault(const ::testing::TestParamInfo<std::size_t>& info) {
    std::string name(effects[info.param].fault.word);
    std::ranges::replace(name, '-', '_');
    return name;
}
INSTANTIATE_TEST_SUITE_P(Faults, EveryFault, ::testing::Range(std::size_t{0}, std::size(effects)),
                         name_of_fault);

TEST(Faults, TheTableHasEachOfTheCommonOnes) {
    for (auto& fault : faults::common)
        EXPECT_TRUE(std::ranges::any_of(effects, [&](auto& each) { return is_same(each.fault, fault); }))
            << fault.word;
}

// One row a word: the word, what it does, then a column for each make.
TEST(Faults, ThePageSaysWhoCanHaveWhat) {
    std::ifstream page(GANTRY_SOURCE_DIR "/docs/faults.md");
    std::vector<std::string> makes;
    std::size_t rows = 0;
    for (std::string line; std::getline(page, line);) {
        if (!line.starts_with("| ")) continue;
        // A "\\|" inside a cell is no border.
        std::vector<std::string> cells(1);
        for (std::size_t i = 1; i < line.size(); ++i) {
            if (line[i] == '|' && line[i - 1] != '\\')
                cells.emplace_back();
            else if (line[i] != '\\')
                cells.back() += line[i];
        }
        ASSERT_GE(cells.size(), 7u) << line;
        if (makes.empty()) {
            makes.assign(cells.begin() + 2, cells.begin() + 6);
            continue;
        }
        auto fault = std::ranges::find_if(
            faults::common, [&](auto& each) { return cells[0] == " `" + describe(each) + "` "; });
        ASSERT_NE(fault, faults::common.end()) << cells[0];
        ++rows;
        for (auto* plugin : plugins()) {
            auto column = std::ranges::find_if(makes, [&](auto& make) {
                return alike(std::string_view(make).substr(1, make.size() - 2), plugin->name);
            });
            ASSERT_NE(column, makes.end()) << plugin->name;
            auto& said = cells[2 + static_cast<std::size_t>(column - makes.begin())];
            EXPECT_EQ(!said.starts_with(" no"), has(*plugin, *fault)) << plugin->name << cells[0];
        }
    }
    EXPECT_EQ(rows, faults::common.size());
}

// --- bytes one at a time -----------------------------------------------------------------------------------

TEST(EveryWay, BytesThatDripInOneByOneGiveTheSameReads) {
    for (auto& way : ways()) {
        SCOPED_TRACE(way.name());
        std::vector<std::uint64_t> reads, trouble;
        for (std::size_t piece : {0u, 1u, 3u}) {
            Joined pair(way, {.piece = piece});
            pair.run_for(30s);
            EXPECT_EQ(pair.links, 0u);
            EXPECT_EQ(pair.count(Count::skipped_bytes), 0u);
            reads.push_back(pair.reads);
            trouble.push_back(pair.trouble());
        }
        EXPECT_GT(reads[0], 10u);
        EXPECT_LE(trouble[0], 1u);  // a DAGProg unit is asked for what not each of them has
        for (std::size_t i : {1u, 2u}) {
            EXPECT_EQ(reads[i], reads[0]);
            EXPECT_EQ(trouble[i], trouble[0]);
        }
    }
}

// TCP loses none.
TEST(EveryWay, AByteThatALineHasLostCostsAFrameAndNotTheLink) {
    std::size_t lines = 0;
    for (auto& way : ways()) {
        if (!way.serial()) continue;
        SCOPED_TRACE(way.name());
        ++lines;
        Joined pair(way);
        ASSERT_TRUE(pair.until([&] { return pair.reads > 10; }, 60s));
        for (int round = 0; round < 5; ++round) {
            auto trouble = pair.trouble();
            pair.lose_byte = true;
            EXPECT_TRUE(pair.until([&] { return pair.trouble() > trouble; }, 60s));
            auto reads = pair.reads;
            EXPECT_TRUE(pair.until([&] { return pair.reads > reads + 10; }, 60s));
            pair.run_for(30s);
        }
        EXPECT_EQ(pair.links, 0u);
    }
    EXPECT_EQ(lines, 4u);
}

}  // namespace
}  // namespace gantry::protocols::test
