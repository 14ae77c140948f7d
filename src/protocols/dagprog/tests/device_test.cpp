#include "protocols/dagprog/crc8.hpp"
#include "support.hpp"

namespace gantry::dagprog::test {

namespace {

const Given icode1 = {{"family", "icode1"}};
const std::string unknown = said({"??"});

struct Exchange {
    std::string line, answer;
};
void every(const Given& settings, const std::vector<Exchange>& exchanges) {
    Unit unit(settings);
    unit.ask("SO");
    for (auto& [line, answer] : exchanges)
        EXPECT_EQ(unit.ask(line), answer) << line;
}

}  // namespace

TEST(DagprogDevice, AnswersEveryCommandOfAnIso15693Unit) {
    every({}, {{"v?", said({"V=\tV1.00A"})},
               {"bk", said({"BK\t00000"})},
               {"BK\t00014", said({"BK\t00014"})},
               {"bk", said({"BK\t00014"})},
               {"BK\t00015", unknown},
               {"nb", said({"NB\t00000"})},
               {"NB\t00001", said({"NB\t00001"})},
               {"NB\t00002", unknown},
               {"tx", said({"TX\t00005"})},
               {"TX\t00004", said({"TX\t00004"})},
               {"TX\t00002", unknown},
               {"TX\t00006", unknown},
               {"tl", said({"TL\t00000"})},
               {"TL\t00004", said({"TL\t00004"})},
               {"TL\t00005", unknown},
               {"SV", said({"SV\t00001"})},
               {"AP0", said({"AP0"})},
               {"AP1", said({"AP1"})},
               {"UR", said({"UR"})},
               {"UR", said({"UR"})},
               {"SR", unknown},
               {"RC", unknown},
               {"SO", said({"SO"})},
               {"SR", said({"SR"})},
               {"SO.", said({"SO"})},
               {"RC", said({"RC"})},
               {"WD\t05\t11223344", unknown},
               {"SO", said({"SO"})},
               {"AS", unknown},
               {"WD\t0F\t11223344", unknown},
               {"WD\t05\t11223344", said({"SN\t0000000000000001"})},
               {"WC\t05\t112233", said({"SN\t0000000000000001"})},
               {"", ""},
               {"hello", unknown},
               {"bk\tmore", unknown}});
}

TEST(DagprogDevice, AnswersEveryCommandOfAnIcode1Unit) {
    every(icode1, {{"bk", said({"BK\t00000"})},
                   {"BK\t00010", said({"BK\t00010"})},
                   {"NB\t00005", said({"NB\t00005"})},
                   {"NB\t00006", unknown},
                   {"BK\t00011", unknown},
                   {"BK\t00016", unknown},
                   {"tx", said({"TX\t00001"})},
                   {"TX\t00000", said({"TX\t00000"})},
                   {"TX\t00004", unknown},
                   {"TX\t00005", unknown},
                   {"tl", unknown},
                   {"TL\t00002", unknown},
                   {"UR", said({"UR"})},
                   {"AS", unknown},
                   {"SO", said({"SO"})},
                   {"SR", unknown},
                   {"RC", unknown},
                   {"AS", said({"AS", "SN\t0000000000000001"})},
                   {"WC\t05\t112233", unknown},
                   {"WD\t0F\t11223344", said({"SN\t0000000000000001"})}});
}

TEST(DagprogDevice, AcceptsEveryFormAndOnlyTheOneItInsistsOn) {
    struct Form {
        std::string name, line;
    };
    const std::vector<Form> forms = {{"tab", "BK\t00003"}, {"none", "BK00003"}, {"space", "BK 00003"}};
    const std::vector<Form> writes = {
        {"tab", "WD\t05\t11223344"}, {"none", "WD0511223344"}, {"space", "WD 05 11223344"}};
    const auto good = said({"BK\t00003"}), nobody = said({"SN\t0000000000000001"});
    for (std::string wants : {"any", "tab", "none", "space"}) {
        Unit unit(Given{{"separator", wants}});
        unit.ask("SO");
        for (std::size_t i = 0; i < forms.size(); ++i) {
            bool taken = wants == "any" || wants == forms[i].name;
            EXPECT_EQ(unit.ask(forms[i].line), taken ? good : unknown) << wants << " " << forms[i].name;
            EXPECT_EQ(unit.ask(writes[i].line), taken ? nobody : unknown) << wants << " " << forms[i].name;
        }
        EXPECT_EQ(unit.ask("TL\t00002"), said({"TL\t00002"})) << wants;
    }
    for (std::string wants : {"any", "yes", "no"}) {
        Unit unit(Given{{"stx", wants}});
        unit.ask("\x02SO");
        unit.ask("SO");
        EXPECT_EQ(unit.ask("v?"), wants == "yes" ? unknown : said({"V=\tV1.00A"}));
        EXPECT_EQ(unit.ask("\x02v?"), wants == "no" ? unknown : said({"V=\tV1.00A"}));
    }
}

TEST(DagprogDevice, EveryVectorToAUnitIsAnsweredInItsFormAndRefusedInAnyOther) {
    auto vectors = testkit::read_vectors(GANTRY_SOURCE_DIR "/src/protocols/dagprog/tests/vectors.tsv");
    for (auto& vector : vectors) {
        if (vector.direction != "to-reader") continue;
        auto line = std::string(as_text(vector.bytes));
        bool has_forms = vector.id.size() == 7 && (vector.id[4] == '2' || vector.id[4] == '7');
        bool only_icode1 = vector.id == "DAG-33";
        for (std::string wants : {"any", "tab", "none", "space"}) {
            Unit unit(Given{{"separator", wants}, {"family", only_icode1 ? "icode1" : "iso15693"}});
            auto answer = unit.at_rest(line);
            auto form = vector.id.back() == 'a' ? "tab" : vector.id.back() == 'b' ? "none" : "space";
            bool tl_with_tab = vector.id == "DAG-23a";
            bool taken = !has_forms || wants == "any" || wants == form || tl_with_tab;
            EXPECT_EQ(answer == unknown, !taken)
                << vector.id << " " << wants << " " << to_hex(as_bytes(answer));
        }
    }
}

TEST(DagprogDevice, SaysWhoItIsWhenItStartsAndReadsInItsPowerUpMode) {
    Unit unit(Given{{"boot", "500ms"}}, false);
    EXPECT_EQ(unit.waits(400ms), "");
    EXPECT_EQ(unit.ask("v?"), "");  // it is not there yet
    EXPECT_EQ(unit.waits(200ms), said({"#0\tDAGProg ISO15693 V1.00A", "#6"}));
    unit.hf.put(tag_a);
    EXPECT_NE(unit.waits(1s).find("SN\tE004010012345678"), std::string::npos);
    EXPECT_EQ(unit.ask("TL\t00002"), said({"TL\t00002"}));
    unit.device.inject("restart", unit.now);
    unit.waits(1s);
    EXPECT_EQ(wire::find(unit.device.state(), "mode")->get<std::string>()->c_str(), std::string("UR"));
    unit.ask("SV");
    unit.ask("TL\t00002");
    unit.device.inject("restart", unit.now);
    unit.waits(1s);
    EXPECT_EQ(*wire::find(unit.device.state(), "mode")->get<std::string>(), "SR");
    EXPECT_EQ(unit.state("restarts"), 2);
    Unit bare(Given{{"banner_stx", "false"}, {"family", "icode1"}}, false);
    EXPECT_EQ(bare.waits(1s), "#0\tDAGProg ICODE1 V1.00A\r#6\r");
}

TEST(DagprogDevice, KeepsOverARestartOnlyWhatFollowsSv) {
    Unit unit(icode1);
    unit.ask("SO");
    unit.ask("BK\t00003");
    unit.ask("SV");
    unit.ask("TX\t00000");  // not one of the three
    unit.ask("NB\t00002");  // this is
    unit.ask("BK\t00007");
    unit.device.inject("restart", unit.now);
    unit.waits(1s);
    unit.ask("SO");
    EXPECT_EQ(unit.ask("bk"), said({"BK\t00000"}));
    EXPECT_EQ(unit.ask("nb"), said({"NB\t00002"}));
    EXPECT_EQ(unit.ask("tx"), said({"TX\t00001"}));
    EXPECT_EQ(unit.state("saved_block_count"), 2);
}

TEST(DagprogDevice, TwoTagsDisturbEachOtherWhenReadForEver) {
    Unit unit;
    unit.hf.put(tag_a, hex("00123407"));
    auto one = unit.waits(500ms);
    EXPECT_NE(one.find("\x02SN\tE004010012345678\r\x02"
                       "00\t00\t00123407\r"),
              std::string::npos);
    EXPECT_NE(one.find("\x02"
                       "00\t01\t00123407\r"),
              std::string::npos)
        << "the count goes on";
    unit.hf.put(tag_b);
    unit.waits(100ms);
    auto two = unit.waits(1s);
    EXPECT_EQ(two.find("SN\t"), std::string::npos);
    EXPECT_NE(two.find("ER\t2"), std::string::npos);
    EXPECT_GT(unit.state("collisions"), 3);
    unit.hf.take(tag_a);
    unit.waits(100ms);
    EXPECT_NE(unit.waits(1s).find("SN\tE0040100AABBCCDD"), std::string::npos);
    Unit icode(icode1);
    icode.hf.put(icode_a);
    icode.hf.put("0102030405060709");
    EXPECT_EQ(icode.waits(1s), "");
}

TEST(DagprogDevice, ReadsEachTagOnceAndLetsItSleep) {
    Unit unit;
    unit.ask("SO");
    unit.hf.put(tag_a);
    unit.hf.put(tag_b);
    unit.ask("SR");
    auto first = unit.waits(5s);
    EXPECT_EQ(std::ranges::count(first, 'N'), 2) << first;
    EXPECT_EQ(unit.state("asleep"), 2);
    EXPECT_EQ(unit.waits(5s), "");
    // The field off wakes them; one that left and came back is awake too.
    EXPECT_EQ(unit.ask("AP0"), said({"AP0"}));
    EXPECT_EQ(unit.waits(100ms), "");
    EXPECT_EQ(unit.ask("AP1"), said({"AP1"}));
    EXPECT_EQ(std::ranges::count(unit.waits(1s), 'N'), 2);
    unit.hf.take(tag_a);
    unit.waits(1s);
    unit.hf.put(tag_a);
    auto back = unit.waits(1s);
    EXPECT_EQ(std::ranges::count(back, 'N'), 1);
    EXPECT_NE(back.find("E004010012345678"), std::string::npos);
}

TEST(DagprogDevice, ChecksAndComputesTheCrc8ItWasGiven) {
    for (auto& row : crc8_rows()) {
        Unit unit(Given{{"crc8", std::string(row.name)}});
        unit.ask("SO");
        unit.hf.put(tag_a);
        unit.waits(500ms);
        Bytes block = hex("001234");
        block.push_back(crc8(row, block));
        EXPECT_EQ(unit.ask("WC\t00\t001234"), said({"SN\tE004010012345678", "00\t00\t" + to_hex(block)}))
            << row.name;
        unit.ask("RC");
        auto good = unit.waits(500ms);
        EXPECT_NE(good.find("00\t01\t" + to_hex(block)), std::string::npos) << row.name;
        EXPECT_EQ(good.find("ER"), std::string::npos);
        unit.ask("SO");
        unit.ask("WD\t00\t001234");
        unit.ask("RC");
        auto wrong = unit.waits(500ms);
        bool fits_by_chance = crc8(row, hex("001234")) == 0;
        EXPECT_EQ(wrong.find("ER\t1") != std::string::npos, !fits_by_chance) << row.name;
    }
}

TEST(DagprogDevice, WritesTheOneTagThatIsThere) {
    Unit unit(icode1);
    unit.ask("SO");
    EXPECT_EQ(unit.ask("AS"), said({"AS", "SN\t0000000000000001"}));
    unit.hf.put(icode_a);
    unit.waits(500ms);
    EXPECT_EQ(unit.ask("AS"), said({"AS", "SN\t0102030405060708"}));
    EXPECT_EQ(unit.ask("WD\t05\t1122"), said({"SN\t0102030405060708", "00\t00\t11220000"}));
    EXPECT_EQ(unit.hf.block(icode_a, 5, unit.now), "11220000");
    EXPECT_EQ(unit.ask("WD\t00\t11223344"), said({"SN\t0000000000000002"})) << "its number";
    EXPECT_EQ(unit.hf.block(icode_a, 0, unit.now), "08070605");
    EXPECT_EQ(unit.ask("WD\t02\tF0F3FFFF"), said({"SN\t0102030405060708", "00\t01\tF0F3FFFF"}));
    EXPECT_EQ(unit.ask("WD\t05\t55555555"), said({"SN\t0000000000000002"})) << "locked for ever";
    unit.device.inject("write_error", unit.now);
    EXPECT_EQ(unit.ask("WD\t06\t11223344"), said({"SN\t0000000000000002"}));
    EXPECT_EQ(unit.ask("WD\t06\t11223344"), said({"SN\t0102030405060708", "00\t02\t11223344"}));
    unit.ask("AP0");
    EXPECT_EQ(unit.ask("WD\t06\t11223344"), said({"SN\t0000000000000001"}));
    unit.ask("AP1");
    unit.hf.put("0102030405060709");
    unit.waits(500ms);
    EXPECT_EQ(unit.ask("WD\t06\t11223344"), said({"SN\t0000000000000001"})) << "two cannot be told apart";
    Unit reversed(Given{{"byte_order", "lsb"}});
    reversed.ask("SO");
    reversed.hf.put(tag_a);
    reversed.waits(500ms);
    EXPECT_NE(reversed.ask("WD\t05\t11223344").find("SN\t78563412000104E0"), std::string::npos);
}

TEST(DagprogDevice, SendsWhatTheTransmissionModeSays) {
    struct Case {
        std::string mode;
        bool number, data;
    };
    for (auto& [mode, number, data] :
         {Case{"0", false, false}, Case{"1", false, true}, Case{"4", true, false}, Case{"5", true, true}}) {
        Unit unit;
        unit.ask("SO");
        unit.ask("TX\t" + mode);
        unit.hf.put(tag_a);
        unit.ask("UR");
        auto text = unit.waits(500ms);
        EXPECT_EQ(text.find("SN\t") != std::string::npos, number) << mode;
        EXPECT_EQ(text.find("\x02"
                            "00\t") != std::string::npos,
                  data)
            << mode;
    }
    Unit several(icode1);
    several.ask("SO");
    several.hf.put(icode_a);
    several.ask("NB\t00001");
    several.ask("UR");
    EXPECT_NE(several.waits(500ms).find("\x02"
                                        "00\t00\t08070605\r\x02"
                                        "00\t00\t04030201\r"),
              std::string::npos);
    EXPECT_EQ(several.at_rest("BK\t00015"), unknown);
}

TEST(DagprogDevice, FaultsAreSwitchedOnFromOutside) {
    Unit unit;
    auto inject = [&](std::string_view word) { return unit.device.inject(word, unit.now).has_value(); };
    unit.ask("SO");
    EXPECT_TRUE(inject("truncate"));
    EXPECT_EQ(unit.ask("v?"), said({"V=\tV1.00A"}).substr(0, 5));
    EXPECT_TRUE(inject("duplicate"));
    EXPECT_EQ(unit.text(), said({"V=\tV1.00A"}));
    EXPECT_TRUE(inject("garbage"));
    EXPECT_EQ(unit.text().size(), 64u);
    EXPECT_TRUE(inject("error 1"));
    EXPECT_EQ(unit.text(), said({"ER\t1"}));
    EXPECT_TRUE(inject("silent on"));
    EXPECT_EQ(unit.ask("BK\t00004"), "");
    EXPECT_TRUE(inject("silent off"));
    EXPECT_EQ(unit.ask("bk"), said({"BK\t00004"})) << "it heard, and did not say";
    EXPECT_TRUE(inject("half_open on"));
    EXPECT_EQ(unit.ask("BK\t00006"), "");
    EXPECT_TRUE(inject("half_open off"));
    EXPECT_EQ(unit.ask("bk"), said({"BK\t00004"})) << "it did not hear";
    EXPECT_TRUE(inject("stuck_ack on"));
    EXPECT_EQ(unit.ask("BK\t00007"), "");
    EXPECT_EQ(unit.ask("bk"), said({"BK\t00007"}));
    EXPECT_TRUE(inject("stuck_ack off"));
    EXPECT_TRUE(inject("slow on"));
    EXPECT_EQ(unit.ask("bk"), "");
    EXPECT_EQ(unit.waits(1s), said({"BK\t00007"}));
    EXPECT_TRUE(inject("slow off"));
    unit.hf.put(tag_a, hex("0012341F"));
    unit.waits(500ms);
    EXPECT_TRUE(inject("antenna broken"));
    EXPECT_EQ(unit.ask("WD\t05\t11"), said({"SN\t0000000000000001"}));
    EXPECT_TRUE(inject("antenna good"));
    unit.ask("BK\t00000");
    unit.ask("RC");
    EXPECT_TRUE(inject("bad_crc"));
    EXPECT_TRUE(unit.waits(500ms).starts_with(said({"ER\t1", "SN\tE004010012345678"})));
    EXPECT_TRUE(inject("drop"));
    EXPECT_TRUE(unit.device.finished());
    for (auto wrong : {"nonsense", "error 3", "antenna", "slow maybe"})
        EXPECT_FALSE(inject(wrong)) << wrong;
}

}  // namespace gantry::dagprog::test
