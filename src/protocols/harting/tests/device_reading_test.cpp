#include "protocols/harting/tests/device_support.hpp"

namespace gantry::harting::device_test {
namespace {

// A reader in buffered read mode with more configuration.
std::string buffered(std::string_view config = "") {
    return fmt::format("config=CFG1.MODE=BufferedRead,CFG11.TR-DATA1=0x11{}{}", config.empty() ? "" : ",",
                       config);
}

// --- the buffer --------------------------------------------------------------------------------------------

TEST(HartingDeviceBuffer, SetsStayUntilTheyAreReadAndCleared) {
    Bench reader(buffered("CFG12.TRANSPONDER-VALID-TIME=600"));
    reader.starts();
    EXPECT_EQ(reader.status(Command::read_buffer, "0001"), Status::no_valid_data);
    EXPECT_EQ(reader.status(Command::clear_data_buffer), Status::no_valid_data);
    EXPECT_EQ(reader.status(Command::read_buffer, "0000"), Status::parameter_range);
    for (auto tag : {tag_1, tag_2, tag_3}) {
        reader.places(tag);
        reader.waits(1s);
    }
    EXPECT_EQ(to_hex(reader.ask(Command::read_data_buffer_info).data), "06A400000003");
    auto two = records_of(reader.ask(Command::read_buffer, "0002"));
    EXPECT_EQ(two.ids(), (std::vector<std::string>{std::string(tag_1), std::string(tag_2)}));
    EXPECT_EQ(records_of(reader.ask(Command::read_buffer, "0002")).ids(), two.ids());
    EXPECT_EQ(reader.status(Command::clear_data_buffer), Status::ok);
    EXPECT_EQ(reader.status(Command::clear_data_buffer), Status::no_valid_data) << "nothing was read since";
    auto rest = records_of(reader.ask(Command::read_buffer, "FFFF"));
    EXPECT_EQ(rest.ids(), std::vector<std::string>{std::string(tag_3)});
    EXPECT_EQ(to_hex(reader.ask(Command::read_data_buffer_info).data), "06A400020001");
    EXPECT_EQ(reader.status(Command::initialize_buffer), Status::ok);
    EXPECT_EQ(reader.status(Command::clear_data_buffer), Status::no_valid_data);
    reader.waits(1s);
    EXPECT_EQ(records_of(reader.ask(Command::read_buffer, "FFFF")).tags.size(), 3u) << "all are new again";
    EXPECT_EQ(reader.state("sets_stored"), 6);
    EXPECT_EQ(reader.state("sets_sent"), 6);
    EXPECT_EQ(reader.state("sets_cleared"), 2);
    EXPECT_EQ(reader.state("sets_initialized"), 1);
    reader.does("restart");
    EXPECT_EQ(reader.state("sets_lost_at_reset"), 3);
    EXPECT_EQ(reader.state("buffered"), 0);
}

TEST(HartingDeviceBuffer, AFullBufferLosesTheNewAndSaysSo) {
    Bench reader(buffered("CFG12.TRANSPONDER-VALID-TIME=0"));
    for (int i = 0; i < 100; ++i)
        reader.places(fmt::format("{:024X}", 0x1000 + i));
    reader.starts();
    reader.waits(10s);
    EXPECT_EQ(reader.state("buffered"), 1700);
    EXPECT_GT(reader.state("sets_overflowed"), 0);
    EXPECT_EQ(reader.status(Command::read_data_buffer_info), Status::buffer_overflow);
    auto reply = reader.ask(Command::read_buffer, "FFFF");
    EXPECT_EQ(reply.status, Status::buffer_overflow);
    auto records = records_of(reply);
    EXPECT_LE(reply.data.size() + min_reply, 2048u) << "TX-BUF";
    EXPECT_EQ(reader.status(Command::clear_data_buffer), Status::ok);
    EXPECT_EQ(reader.ask(Command::read_buffer, "FFFF").status, Status::more_data);
    EXPECT_EQ(reader.state("sets_cleared"), static_cast<std::int64_t>(records.walked.records));
    EXPECT_EQ(reader.state("sets_stored"), reader.state("buffered") + reader.state("sets_cleared"));
    reader.does("overflow");
    EXPECT_EQ(reader.ask(Command::read_buffer, "0001").status, Status::buffer_overflow);
}

TEST(HartingDeviceBuffer, RecordsHaveThePartsThatTheConfigurationAsksFor) {
    struct Row {
        std::string_view config, record;
    };
    const std::string idd = "84000E3000" + std::string(tag_1), mac = "024841000003";
    for (auto& row : std::initializer_list<Row>{
             {"CFG11.TR-DATA1=0x01", "0100010013I"},
             {"CFG11.TR-DATA1=0x13,CFG11.DB-ADR=1,CFG11.DB-N=2", "130001001BI0002020203040501"},
             {"CFG11.TR-DATA1=0x0B,CFG11.DB-N=2", "0B0001001AI00020201000302"},
             {"CFG11.TR-DATA1=0x03,CFG11.DB-N=1,CFG11.BANK=tid", "0300010018I000102E280"},
             {"CFG11.TR-DATA1=0x03,CFG11.COMPLETE-BANK=1",
              "0300010026I000802000102030405060708090A0B0C0D0E0F"},
             {"CFG11.TR-DATA1=0x81,CFG11.TR-DATA2=0x03", "81030001001BI0201M"},
             {"CFG11.TR-DATA1=0x61", "610001001CI0000....1400010100"},
         }) {
        Bench reader(buffered(row.config));
        reader.places(tag_1);
        reader.does("input 2=1");
        reader.starts();
        auto data = to_hex(reader.ask(Command::read_buffer, "0001").data);
        std::string expected;
        for (auto letter : row.record)
            expected += letter == 'I' ? idd : letter == 'M' ? mac : std::string(1, letter);
        ASSERT_EQ(data.size(), expected.size()) << row.config << " " << data;
        for (std::size_t i = 0; i < data.size(); ++i)
            if (expected[i] != '.') {
                EXPECT_EQ(data[i], expected[i]) << row.config << " " << data;
            }
    }
}

TEST(HartingDeviceBuffer, ATagIsReportedOnceInItsValidTime) {
    struct Row {
        std::string_view config;
        std::size_t records;
    };
    for (auto& row : std::initializer_list<Row>{
             {"CFG12.TRANSPONDER-VALID-TIME=600", 2},
             {"CFG12.TRANSPONDER-VALID-TIME=50", 4},
             {"CFG12.TRANSPONDER-VALID-TIME=0", 200},  // each round of 100 ms, two tags
             // Both tags have the same data: they are one.
             {"CFG12.TRANSPONDER-VALID-TIME=600,CFG12.TR-ID=DataBlock,CFG12.TR-ID-DB-N=2", 1},
             // Each antenna for itself, or all as one.
             {"CFG12.TRANSPONDER-VALID-TIME=600,CFG15.ENABLE=1,CFG15.ANTENNAS=2", 3},
             {"CFG12.TRANSPONDER-VALID-TIME=600,CFG15.ENABLE=1,CFG15.ANTENNAS=2,CFG11.ANTENNA-POOL=1", 2},
             // Sessions: once, or whenever the reader wakes the tag.
             {"CFG12.TRANSPONDER-VALID-TIME=0,CFG5.SESSION=S2", 2},
             {"CFG12.TRANSPONDER-VALID-TIME=0,CFG5.SESSION=S3,CFG16.ENABLE=1,CFG16.TIME-1=30", 8},
             {"CFG12.TRANSPONDER-VALID-TIME=600,CFG11.TR-DATA1=0x03,CFG11.DB-ADR=100", 0},
         }) {
        Bench reader(buffered(row.config));
        for (auto tag : {tag_1, tag_2})
            reader.places(tag);
        reader.places(tag_1, 2);
        reader.device.power_on(reader.now);
        reader.waits(10s);
        EXPECT_NEAR(static_cast<double>(reader.state("sets_stored")), static_cast<double>(row.records),
                    row.records > 100 ? 2 : 0)
            << row.config;
    }
}

TEST(HartingDeviceBuffer, InAPoolOneRecordSaysAllAntennas) {
    Bench reader(
        buffered("CFG11.TR-DATA1=0x91,CFG11.TR-DATA2=0x10,CFG15.ENABLE=1,CFG15.ANTENNAS=3,"
                 "CFG11.ANTENNA-POOL=1"));
    reader.places(tag_1, 1);
    reader.places(tag_1, 3);
    reader.starts();
    auto reply = reader.ask(Command::read_buffer, "0001");
    auto records = records_of(reply);
    EXPECT_EQ(records.walked.records, 1u);
    ASSERT_EQ(records.tags.size(), 2u);
    EXPECT_EQ(records.tags[0].antenna, 1);
    EXPECT_EQ(records.tags[1].antenna, 3);
    EXPECT_NEAR(records.tags[0].rssi, -500, 30);
    reader.does("antenna 2=bad");
    EXPECT_EQ(reader.ask(Command::read_buffer, "0001").status, Status::rf_warning);
}

TEST(HartingDeviceBuffer, AReadDrivesTheOutputsOfItsAntenna) {
    Bench reader(buffered("CFG9.OUT1-ANTENNA=1,CFG9.OUT2-ANTENNA=2,CFG2.OUT1-SETTING-TIME=20"));
    reader.starts();
    EXPECT_EQ(reader.state_text("outputs"), "off off off");
    reader.places(tag_1);
    reader.waits(1s);
    EXPECT_EQ(reader.state_text("outputs"), "on off off");
    reader.waits(3s);
    EXPECT_EQ(reader.state_text("outputs"), "off off off")
        << "the tag is valid still, so there is no new event";
}

// --- the trigger -------------------------------------------------------------------------------------------

TEST(HartingDeviceTrigger, ItReadsWhileInput1IsOnAndForTheHoldTimeAfter) {
    Bench reader(
        buffered("CFG12.TRANSPONDER-VALID-TIME=0,CFG10.ENABLE=1,CFG10.IN1-HOLD-TIME=20,"
                 "CFG11.TR-DATA1=0x81,CFG11.TR-DATA2=0x01,CFG12.TRIGGER-EVENT=1,CFG12.TIMEOUT-EVENT=1,"
                 "CFG12.IN2-EVENT=1"));
    reader.places(tag_1);
    reader.starts();
    auto took = [&] {
        auto reply = reader.ask(Command::read_buffer, "FFFF");
        if (reply.data.empty()) return Records{};
        EXPECT_EQ(reader.status(Command::clear_data_buffer), Status::ok);
        return records_of(reply);
    };
    EXPECT_TRUE(took().tags.empty());
    reader.does("input 1=1");
    reader.waits(1s);
    auto first = took();
    EXPECT_NEAR(static_cast<double>(first.tags.size()), 10, 1);
    ASSERT_GE(first.events.size(), 1u);
    EXPECT_EQ(first.events[0].inputs, 1);
    EXPECT_EQ(first.events[0].status, 1);
    reader.does("input 1=0");
    reader.waits(1900ms);
    EXPECT_NEAR(static_cast<double>(took().tags.size()), 19, 1) << "the hold time";
    reader.waits(200ms);
    auto end = took();
    ASSERT_FALSE(end.events.empty());
    EXPECT_EQ(end.events.back().status, 2) << "over";
    reader.does("input 2=1");
    reader.waits(1s);
    auto other = took();
    EXPECT_TRUE(other.tags.empty());
    ASSERT_EQ(other.events.size(), 1u);
    EXPECT_EQ(other.events[0].inputs, 2);
    reader.does("config CFG10.UNLIMITED=1");
    reader.reconnects();
    reader.does("input 1=1");
    reader.does("input 1=0");
    reader.waits(10s);
    EXPECT_EQ(reader.state("reading"), 1);
}

// --- scan mode: the four examples of the manual, section 5.5.1 ---------------------------------------------

TEST(HartingDeviceScan, ItSendsWhatTheExamplesOfTheManualShow) {
    struct Row {
        std::string_view config;
        int tags;
        std::string_view block;
    };
    const std::string line =
        "serial=true round=200ms config=CFG1.MODE=Scan,CFG12.TRANSPONDER-VALID-TIME=600,";
    for (auto& row : std::initializer_list<Row>{
             // UID and data of one tag, then of two; UID or data alone of three.
             {"CFG11.TR-DATA1=0x03,CFG11.DB-N=2,CFG11.D-LGT=4", 1, "300833B2DDD9014035050001,00010203\r"},
             {"CFG11.TR-DATA1=0x01", 3,
              "300833B2DDD9014035050001\r300833B2DDD9014035050002\r300833B2DDD9014035050003\r"},
             {"CFG11.TR-DATA1=0x02,CFG11.DB-N=2,CFG11.D-LGT=4", 3, "00010203\r00010203\r00010203\r"},
             {"CFG11.TR-DATA1=0x03,CFG11.DB-N=2,CFG11.D-LGT=4", 2,
              "300833B2DDD9014035050001,00010203\r300833B2DDD9014035050002,00010203\r"},
             // Its own prefix, separator and end; a part of the data; the bus address; raw bytes.
             {"CFG11.TR-DATA1=0x03,CFG11.DB-N=2,CFG11.D-START=1,CFG11.D-LGT=2,CFG13.HEADER-USER=3C3C,"
              "CFG13.HEADER-USER-N=2,CFG13.SEP-USER=0x3B,CFG13.END-USER=0D0A,CFG13.END-USER-N=2",
              2, "<<300833B2DDD9014035050001;0102\r\n300833B2DDD9014035050002;0102\r\n"},
             {"CFG11.TR-DATA1=0x02,CFG11.DB-N=1,CFG11.D-LGT=2,CFG11.BUS-ADDRESS-PREFIX=1,CFG13.END-CHAR=0,"
              "CFG1.COM-ADR=10",
              1, "0A0001"},
             {"CFG11.TR-DATA1=0x02,CFG11.DB-ADR=5,CFG11.DB-N=1,CFG11.D-LGT=2,CFG13.DB-FORMAT=0,CFG13.END-"
              "CHAR=0",
              1, "\n\v"},
             {"CFG11.TR-DATA1=0x03,CFG11.DB-ADR=90,CFG11.DB-N=2", 1, ""},  // what cannot be read is not sent
         }) {
        Bench reader(line + std::string(row.config));
        for (int i = 0; i < row.tags; ++i)
            reader.places(std::array{tag_1, tag_2, tag_3}[static_cast<std::size_t>(i)]);
        reader.device.power_on(reader.now);
        reader.device.start(reader.now);
        reader.waits(200ms);
        auto said = taken(reader.device);
        auto text = std::string(as_text(said));
        // Who is heard first is chance: sorted by tag.
        EXPECT_EQ(text.size(), row.block.size()) << text;
        if (row.tags == 1) {
            EXPECT_EQ(text, row.block);
        }
        auto pieces = [](std::string_view all, std::string_view end) {
            std::multiset<std::string> out;
            if (all.starts_with("<<")) all.remove_prefix(2);
            while (!all.empty()) {
                auto size = std::min(all.find(end), all.size());
                out.emplace(all.substr(0, size));
                all.remove_prefix(std::min(size + end.size(), all.size()));
            }
            return out;
        };
        auto end = row.block.ends_with("\r\n") ? "\r\n" : "\r";
        EXPECT_EQ(pieces(text, end), pieces(row.block, end));
        reader.waits(30s);
        EXPECT_TRUE(reader.device.output().empty()) << "locked for the valid time";
        reader.waits(40s);
        EXPECT_EQ(taken(reader.device).size(), row.block.size());
    }
}

TEST(HartingDeviceScan, OverTcpThereIsNone) {
    Reader reader("config=CFG1.MODE=Scan");
    reader.waits(10s);
    EXPECT_TRUE(reader.device.output().empty());
    EXPECT_GT(reader.state("scans_lost"), 0);
    EXPECT_EQ(reader.status(Command::get_input), Status::ok);
}

}  // namespace
}  // namespace gantry::harting::device_test
