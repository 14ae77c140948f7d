#include <csignal>
#include <filesystem>
#include <fstream>

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "cli/tests/ran.hpp"

namespace gantry::cli {
namespace {

struct Slip {
    std::vector<std::string> arguments;
    std::string command, error;
};

void expect_refused(const Slip& slip) {
    auto ran = gantry(slip.arguments);
    EXPECT_EQ(ran.code, wrong_usage) << slip.error;
    EXPECT_EQ(ran.out, "");
    EXPECT_EQ(ran.err, fmt::format("gantry {0}: {1}; see gantry {0} --help\n", slip.command, slip.error));
}

TEST(OptionValues, ASlipNamesTheOptionTheValueAndTheRightForm) {
    auto make = make_names().front();
    std::vector<std::string> emulate = {"emulate", make, "--connect", "127.0.0.1:1"};
    auto with = [&](std::vector<std::string> more) {
        more.insert(more.begin(), emulate.begin(), emulate.end());
        return more;
    };
    for (auto& slip : std::vector<Slip>{
             {{"demo", "--for", "2x"}, "demo", "--for: 2x is no duration; write it like 500ms, 10s or 5min"},
             {{"demo", "--for", "0s"}, "demo", "--for: 0s is no duration; write it like 500ms, 10s or 5min"},
             {with({"--for", "2x"}), "emulate", "--for: 2x is no duration; write it like 500ms, 10s or 5min"},
             {with({"--set", "batch"}), "emulate", "--set: batch has no value; write --set name=value"},
             {with({"--seed", "-1"}), "emulate", "--seed: -1 cannot be; write a whole number, 0 or more"},
             {{"emulate", make, "--connect", "foo"},
              "emulate",
              "--connect: \"foo\" is no address with a port: the port is missing; write it as "
              "192.168.0.5:9055, [fe80::1]:9055, dock-1:9055 or :9055"},
             {{"gpio", "get", "gate-1", "--timeout", "x"},
              "gpio get",
              "--timeout: x is no duration; write it like 500ms, 10s or 5min"},
             {{"gpio", "set", "gate-1", "on"},
              "gpio set",
              "OUTPUT=STATE: on is no output and state; write 1=on or 1=off"},
             {{"gpio", "set", "gate-1", "1=on", "2=maybe"},
              "gpio set",
              "OUTPUT=STATE: 2=maybe is no output and state; write 1=on or 1=off"},
             {{"events", "query", "--since", "yesterday"},
              "events query",
              "--since: yesterday is no time; write 2026-11-21T23:04:00Z, or 10min for ten minutes ago"},
             {{"job", "show", "abc"}, "job show", "ID: abc cannot be; write a whole number, 1 or more"},
             {{"events", "query", "--limit", "0"},
              "events query",
              "--limit: 0 cannot be; write a whole number, 1 or more"},
             {{"events", "query", "--limit", "-1"},
              "events query",
              "--limit: -1 cannot be; write a whole number, 1 or more"},
             {{"events", "query", "--after", "all"},
              "events query",
              "--after: all cannot be; write a whole number, 0 or more"},
             {{"events", "tail", "-n", "-1"},
              "events tail",
              "--last: -1 cannot be; write a whole number, 0 or more"},
             {{"events", "tail", "--tag", "zz"},
              "events tail",
              "--tag: zz is not hex; write how the tag's hex begins, like 3034"},
             {{"events", "query", "--type", "tag.new", "--type", "tag.nwe"},
              "events query",
              "--type: tag.nwe is not known; did you mean tag.new?"},
         })
        expect_refused(slip);
}

class NoStore : public ::testing::Test {
protected:
    void SetUp() override {
        auto pattern = (std::filesystem::temp_directory_path() / "gantry-usage-XXXXXX").string();
        ASSERT_NE(mkdtemp(pattern.data()), nullptr);
        home_ = pattern;
    }
    void TearDown() override { std::filesystem::remove_all(home_); }

    std::string file(const std::string& name, const std::string& content) {
        auto path = home_ / name;
        std::ofstream(path, std::ios::binary) << content;
        return path.string();
    }
    // What `events query` says of it.
    std::string refusal(const std::string& option, const std::string& value) {
        auto ran = gantry({"events", "query", option, value});
        EXPECT_EQ(ran.code, failed);
        EXPECT_EQ(ran.out, "");
        return ran.err;
    }

    std::filesystem::path home_;
};

TEST_F(NoStore, AFileThatIsNoneIsNamedWithWhatToGiveInstead) {
    for (auto& path : {file("text", "some lines\nof text, longer than a header\n"), file("empty", ""),
                       file("short", "SQLite")})
        EXPECT_EQ(
            refusal("--db", path),
            fmt::format("gantry events query: --db: {} is not a Gantry store; give the file gantry.db in "
                        "the data directory of a gateway\n",
                        path));
    EXPECT_EQ(
        refusal("--db", (home_ / "none").string()),
        fmt::format("gantry events query: --db: there is no file {}; give the file gantry.db in the data "
                    "directory of a gateway\n",
                    (home_ / "none").string()));
    EXPECT_EQ(
        refusal("--db", home_.string()),
        fmt::format("gantry events query: --db: {} is a directory; a directory is given with --data-dir\n",
                    home_.string()));
}

TEST_F(NoStore, WhereThereIsNoneYetTheHintSaysHowToNameThePlace) {
    EXPECT_EQ(
        refusal("--data-dir", home_.string()),
        fmt::format("gantry events query: there is no store {}; name the gateway's place with -c FILE or "
                    "--data-dir DIR; `gantry run` makes the store\n",
                    (home_ / "gantry.db").string()));
}

TEST(EpcUsage, AnElementStringWithoutThePrefixLengthNamesTheOption) {
    auto ran = gantry({"epc", "encode", "(01)80614141123458(21)6789"});
    EXPECT_EQ(ran.code, failed);
    EXPECT_EQ(
        ran.err,
        "gantry epc encode: (01)80614141123458(21)6789 does not say how long its company prefix is; give "
        "the number of its digits with --prefix-digits, 6 to 12\n");
}

// A pipe whose reading end is closed, as `| head` leaves it.
class ClosedPipe {
public:
    ClosedPipe() {
        int ends[2];
        if (::pipe2(ends, O_CLOEXEC) != 0) return;
        out.open(fmt::format("/proc/self/fd/{}", ends[1]));
        ::close(ends[0]);
        fd = ends[1];
    }
    ~ClosedPipe() {
        out.close();
        ::close(fd);
    }
    ClosedPipe(const ClosedPipe&) = delete;
    ClosedPipe& operator=(const ClosedPipe&) = delete;

    std::ofstream out;
    int fd = -1;
};

TEST(Output, AReaderThatHasGoneIsNoFailure) {
    auto before = ::signal(SIGPIPE, SIG_IGN);
    std::string make = make_names().front();
    for (auto& [arguments, given] : std::vector<std::pair<std::vector<std::string>, std::string>>{
             {{"config", "schema"}, ""},
             {{"decode", "-p", make, "-d", "to-host"}, "00\n00\n"},
             {{"epc", "decode", "-"}, "3074257BF7194E4000001A85\n"},
         }) {
        std::istringstream in(given);
        std::ostringstream err;
        ClosedPipe pipe;
        ASSERT_TRUE(pipe.out.is_open());
        Context context{in, pipe.out, err, {}};
        context.out_fd = pipe.fd;
        EXPECT_EQ(run(arguments, context), done) << arguments.front();
        EXPECT_EQ(err.str(), "") << arguments.front();
    }
    ::signal(SIGPIPE, before);
}

}  // namespace
}  // namespace gantry::cli
