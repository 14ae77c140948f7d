#include "reader/tag_steps.hpp"

#include <gtest/gtest.h>

#include <map>
#include <utility>

#include "wire/cursor.hpp"

namespace gantry {

using Status = JobResult::Status;
using What = TagStep::What;
using Said = TagAnswer::What;

static event::TagId id(std::string_view text) {
    return event::TagId(*from_hex(text));
}
static const event::TagId old_id = id("300000000000000000000001"), new_id = id("300000000000000000000002");

static TagAccess access(std::uint8_t retries = 2) {
    TagAccess access;
    access.tag = old_id;
    access.retries = retries;
    return access;
}
static TagAnswer answer(Said what, std::string text = "no") {
    return {.what = what, .text = std::move(text), .data = {}};
}

// A Gen2 tag with an EPC bank and a user bank, and a list of troubles that come first.
struct Tag {
    Bytes epc_bank = *from_hex("12343000300000000000000000000001");
    Bytes user = Bytes(256);
    bool alive = true;
    std::vector<Said> troubles = {};  // said in place of the first answers
    bool troubles_do_it = false;      // and yet the step is done
    std::vector<What> did = {};
    std::vector<std::uint32_t> lengths = {};

    event::TagId now() const {
        return event::TagId(ByteView(epc_bank).subspan(4, std::size_t{epc_bank[2]} >> 3 << 1));
    }
    TagAnswer does(const TagStep& step, const Job& job) {
        did.push_back(step.what);
        lengths.push_back(step.length);
        if (!troubles.empty()) {
            auto trouble = troubles.front();
            troubles.erase(troubles.begin());
            if (troubles_do_it) really(step, job);
            return answer(trouble);
        }
        return really(step, job);
    }
    TagAnswer really(const TagStep& step, const Job& job) {
        if (!alive || !(step.tag == now())) return answer(Said::no_tag, "nobody");
        auto& bank = step.bank == Bank::epc ? epc_bank : user;
        auto at = bank.begin() + 2 * static_cast<std::ptrdiff_t>(step.offset);
        TagAnswer good;
        switch (step.what) {
            case What::read:
                good.data.assign(at, at + 2 * static_cast<std::ptrdiff_t>(step.length));
                break;
            case What::write:
                std::copy(step.data.begin(), step.data.end(), at);
                break;
            case What::program: {
                auto& to = std::get<ProgramTag>(job).new_id;
                std::copy(to.view().begin(), to.view().end(), epc_bank.begin() + 4);
                break;
            }
            case What::kill:
                alive = false;
                break;
            case What::look:
            case What::lock:
                break;
        }
        return good;
    }
};

static JobResult run(const Job& job, Tag& tag, bool again = false, TagSteps::Limits limits = {}) {
    TagSteps steps(job, again, limits);
    for (int i = 0; i < 1000; ++i) {
        auto step = steps.next();
        if (!step) return steps.result();
        EXPECT_EQ(step, steps.next()) << "the same until answered";
        steps.answered(tag.does(*step, job));
    }
    ADD_FAILURE() << "it never ends";
    return steps.result();
}

static WriteTag write_user(std::string_view data, bool verify = true) {
    WriteTag job;
    job.access = access();
    job.offset = 3;
    job.data = *from_hex(data);
    job.verify = verify;
    return job;
}

TEST(TagSteps, ReadsInPiecesAndGivesOneValue) {
    Tag tag;
    for (std::size_t i = 0; i < tag.user.size(); ++i)
        tag.user[i] = static_cast<std::uint8_t>(i);
    ReadTag job{.access = access(), .bank = Bank::user, .offset = 2, .length = 70};
    auto result = run(job, tag, false, {.unit = 2, .read = 32, .write = 32});
    EXPECT_EQ(result.status, Status::done);
    EXPECT_EQ(tag.lengths, (std::vector<std::uint32_t>{32, 32, 6}));
    EXPECT_EQ(*wire::find(result.values, "data"),
              wire::Value(Bytes(tag.user.begin() + 4, tag.user.begin() + 144)));
}

TEST(TagSteps, RefusesWhatNoReaderCouldDo) {
    Tag tag;
    EXPECT_EQ(run(ReadTag{.access = access(), .length = 0}, tag).status, Status::failed);
    EXPECT_EQ(run(ReadTag{.access = {}, .length = 1}, tag).status, Status::failed);
    EXPECT_EQ(run(write_user("AABBCC"), tag).status, Status::failed);
    EXPECT_EQ(run(write_user(""), tag).status, Status::failed);
    EXPECT_TRUE(tag.did.empty());
}

TEST(TagSteps, TriesAgainOnlyWhenTheTagDidNotAnswerOrHadTrouble) {
    Tag tag;
    tag.troubles = {Said::no_tag, Said::trouble};
    EXPECT_EQ(run(write_user("AABB", false), tag).status, Status::done);
    EXPECT_EQ(tag.did.size(), 3u);

    Tag away;
    away.troubles = {Said::no_tag, Said::no_tag, Said::no_tag};
    auto result = run(write_user("AABB", false), away);
    EXPECT_EQ(result.status, Status::failed);
    EXPECT_EQ(result.text, "no, after 3 tries");

    Tag locked;
    locked.troubles = {Said::refused};
    result = run(write_user("AABB"), locked);
    EXPECT_EQ(result.status, Status::failed);
    EXPECT_EQ(result.text, "no");
    EXPECT_EQ(locked.did.size(), 1u);

    Tag poor;
    poor.troubles = {Said::unsupported};
    EXPECT_EQ(run(write_user("AABB"), poor).status, Status::unsupported);
}

TEST(TagSteps, ReadsBackWhatItWroteAndWritesAgainWhenItDiffers) {
    Tag tag;
    EXPECT_EQ(run(write_user("AABBCCDD"), tag).status, Status::done);
    EXPECT_EQ(tag.did, (std::vector{What::write, What::read}));
    EXPECT_EQ(to_hex(ByteView(tag.user).subspan(6, 4)), "AABBCCDD");

    Job job = write_user("AABB");
    TagSteps steps(job, false, {});
    unsigned writes = 0;
    while (auto step = steps.next()) {
        TagAnswer stuck;
        if (step->what == What::read) stuck.data = Bytes(2);
        writes += step->what == What::write ? 1 : 0;
        steps.answered(stuck);
    }
    EXPECT_EQ(writes, 3u);
    EXPECT_EQ(steps.result().text, "read back 0000 after writing AABB");
}

TEST(TagSteps, AWriteThatCannotBeReadBackSaysThatItWasWritten) {
    Job job = write_user("AABB");
    TagSteps steps(job, false, {});
    steps.answered({});
    steps.answered(answer(Said::refused, "locked"));
    ASSERT_FALSE(steps.next());
    EXPECT_EQ(steps.result().text, "written, but it cannot be read back: locked");
}

TEST(TagSteps, AfterABrokenLinkAWriteLooksFirst) {
    Tag written;
    auto data = *from_hex("AABB");
    std::copy(data.begin(), data.end(), written.user.begin() + 6);
    auto result = run(write_user("AABB"), written, true);
    EXPECT_EQ(result.status, Status::done);
    EXPECT_EQ(written.did, (std::vector{What::read}));

    Tag untouched;
    EXPECT_EQ(run(write_user("AABB", false), untouched, true).status, Status::done);
    EXPECT_EQ(untouched.did, (std::vector{What::read, What::write}));

    Tag away;
    away.alive = false;
    EXPECT_EQ(run(write_user("AABB"), away, true).status, Status::unknown);
    for (auto what : away.did)
        EXPECT_EQ(what, What::read) << "nothing is written blindly";

    Tag locked;
    locked.troubles = {Said::refused};
    EXPECT_EQ(run(write_user("AABB"), locked, true).status, Status::unknown);
    EXPECT_EQ(locked.did.size(), 1u);
}

TEST(TagSteps, AWriteOfTheIdIsFollowedUnderTheNewId) {
    WriteTag job;
    job.access = access();
    job.bank = Bank::epc;
    job.offset = 2;
    job.data = *from_hex("300000000000000000000002");
    Tag tag;
    EXPECT_EQ(run(job, tag, false, {.unit = 2, .read = 64, .write = 2}).status, Status::done);
    EXPECT_EQ(tag.now(), new_id);
    Tag done;
    run(job, done);
    done.did.clear();
    EXPECT_EQ(run(job, done, true).status, Status::done);
    EXPECT_EQ(done.did, (std::vector{What::read}));
    Tag not_done;
    EXPECT_EQ(run(job, not_done, true).status, Status::done);
    EXPECT_EQ(not_done.did, (std::vector{What::read, What::read, What::write, What::read}));
}

TEST(TagSteps, TellsTheIdThatAWriteLeaves) {
    auto after = [](std::uint32_t word, std::string_view data) {
        return id_after_write(old_id, word, *from_hex(data));
    };
    EXPECT_EQ(after(7, "ABCD"), id("30000000000000000000ABCD"));
    EXPECT_EQ(after(1, "1000"), id("30000000")) << "word 1 is the PC: two words";
    EXPECT_EQ(after(1, "1000AAAABBBB"), id("AAAABBBB"));
    EXPECT_EQ(after(0, "00001000AAAABBBB"), id("AAAABBBB"));
    EXPECT_EQ(after(1, "3800"), std::nullopt) << "a seventh word that nobody knows";
    EXPECT_EQ(after(0, "FFFF"), old_id);
    EXPECT_EQ(after(20, "FFFF"), old_id);
}

TEST(TagSteps, ProgramIsSeenUnderTheNewId) {
    ProgramTag job{.access = access(), .new_id = new_id};
    Tag tag;
    EXPECT_EQ(run(job, tag).status, Status::done);
    EXPECT_EQ(tag.did, (std::vector{What::program, What::look}));

    Tag again;
    run(job, again);
    again.did.clear();
    EXPECT_EQ(run(job, again, true).status, Status::done);
    EXPECT_EQ(again.did, (std::vector{What::look}));

    Tag not_yet;
    EXPECT_EQ(run(job, not_yet, true).status, Status::done);
    EXPECT_EQ(not_yet.did, (std::vector{What::look, What::look, What::program, What::look}));

    Tag away;
    away.alive = false;
    EXPECT_EQ(run(job, away, true).status, Status::unknown);
}

TEST(TagSteps, AProgramWhoseAnswerWasTroubleIsLookedFor) {
    ProgramTag job{.access = access(), .new_id = new_id};
    Tag tag;
    tag.troubles = {Said::trouble};
    tag.troubles_do_it = true;
    EXPECT_EQ(run(job, tag).status, Status::done);
    EXPECT_EQ(tag.did.back(), What::look);

    Tag never;
    never.troubles = {Said::trouble, Said::trouble, Said::trouble};
    auto result = run(job, never);
    EXPECT_EQ(result.status, Status::failed);
    EXPECT_EQ(result.text, "no");
}

TEST(TagSteps, AKillLooksFirstAfterABrokenLinkAndNeverGuesses) {
    KillTag job{.access = access(), .kill_password = 7};
    Tag tag;
    EXPECT_EQ(run(job, tag, true).status, Status::done);
    EXPECT_EQ(tag.did, (std::vector{What::look, What::kill}));
    EXPECT_FALSE(tag.alive);
    EXPECT_EQ(run(job, tag, true).status, Status::unknown);

    Tag silent;
    silent.troubles = {Said::trouble};
    silent.troubles_do_it = true;
    EXPECT_EQ(run(job, silent).status, Status::unknown);

    Tag away;
    away.alive = false;
    EXPECT_EQ(run(job, away).status, Status::failed);
}

TEST(TagSteps, ALockIsSimplyRepeated) {
    LockTag job{.access = access(), .mask = 3, .action = 2, .address = {}};
    Tag tag;
    EXPECT_EQ(run(job, tag, true).status, Status::done);
    EXPECT_EQ(tag.did, (std::vector{What::lock}));
}

TEST(TagSteps, AShortAnswerIsAFailure) {
    ReadTag job{.access = access(), .length = 4};
    TagSteps steps(job, false, {});
    steps.answered({.what = Said::done, .text = {}, .data = Bytes(6)});
    EXPECT_FALSE(steps.next());
    EXPECT_EQ(steps.result().text, "the reader gave 6 bytes instead of 8");
}

TEST(TagSteps, AShortAnswerWhileItLooksLeavesItUnknown) {
    Job job = write_user("AABB");
    TagSteps again(job, true, {});
    again.answered({.what = Said::done, .text = {}, .data = Bytes(1)});
    EXPECT_FALSE(again.next());
    EXPECT_EQ(again.result().status, Status::unknown) << "it may have been written before the link broke";
    TagSteps verify(job, false, {});
    verify.answered({});
    verify.answered({.what = Said::done, .text = {}, .data = Bytes(1)});
    EXPECT_EQ(verify.result().status, Status::unknown);
    EXPECT_EQ(verify.result().text,
              "written, but it cannot be read back: the reader gave 1 bytes instead of 2");
}

TEST(TagSteps, AWriteThatStopsHalfWaySaysHowFarItCame) {
    Tag tag;
    Job job = write_user("AABBCCDDEEFF");
    TagSteps steps(job, false, {.unit = 2, .read = 64, .write = 1});
    steps.answered({});
    steps.answered({});
    for (int i = 0; i < 3; ++i)
        steps.answered(answer(Said::no_tag, "nobody"));
    ASSERT_FALSE(steps.next());
    EXPECT_EQ(steps.result().status, Status::failed);
    EXPECT_EQ(steps.result().text, "nobody, after 3 tries; the first 4 of 6 bytes were written");
}

TEST(TagSteps, ATagThatIsGoneAfterItWasWrittenLeavesItUnknown) {
    ProgramTag program{.access = access(), .new_id = new_id};
    for (const Job& job : {Job(write_user("AABB")), Job(program)}) {
        TagSteps steps(job, false, {});
        steps.answered({});
        while (steps.next())
            steps.answered(answer(Said::no_tag, "nobody"));
        EXPECT_EQ(steps.result().status, Status::unknown);
        EXPECT_EQ(steps.result().text, "done, but the tag does not answer afterwards: nobody");
    }
}

// A tag whose access password guards its reserved bank.
static JobResult run_guarded(const WriteTag& job, Bytes& reserved, bool again, bool trouble_first = false) {
    TagSteps steps(job, again, {});
    while (auto step = steps.next()) {
        auto real = static_cast<std::uint32_t>(wire::Reader(ByteView(reserved).subspan(4)).u32("password"));
        auto at = reserved.begin() + 2 * static_cast<std::ptrdiff_t>(step->offset);
        if (step->password != real) {
            steps.answered(answer(Said::trouble, "tag error"));
        } else if (step->what == What::write) {
            std::copy(step->data.begin(), step->data.end(), at);
            steps.answered(std::exchange(trouble_first, false) ? answer(Said::trouble) : TagAnswer{});
        } else {
            steps.answered({.what = Said::done,
                            .text = {},
                            .data = Bytes(at, at + 2 * static_cast<std::ptrdiff_t>(step->length))});
        }
    }
    return steps.result();
}

TEST(TagSteps, AfterAChangeOfTheAccessPasswordTheNewOneIsUsed) {
    WriteTag job{.access = access(), .bank = Bank::reserved, .offset = 2, .data = *from_hex("A1B2C3D4")};
    job.access.password = 0x01020304;
    for (bool trouble : {false, true}) {
        auto reserved = *from_hex("0000000001020304");
        auto result = run_guarded(job, reserved, false, trouble);
        EXPECT_EQ(result.status, Status::done) << result.text;
        EXPECT_EQ(to_hex(reserved), "00000000A1B2C3D4");
        EXPECT_EQ(run_guarded(job, reserved, true).status, Status::done) << "it was done before";
    }
    auto untouched = *from_hex("0000000001020304");
    EXPECT_EQ(run_guarded(job, untouched, true).status, Status::done);
    EXPECT_EQ(to_hex(untouched), "00000000A1B2C3D4");
    EXPECT_EQ(password_after_write(0x01020304, 0, *from_hex("AAAAAAAA")), 0x01020304u);
    EXPECT_EQ(password_after_write(0x01020304, 3, *from_hex("BBCC")), 0x0102BBCCu);
    EXPECT_EQ(password_after_write(0x01020304, 1, *from_hex("AAAABBCC")), 0xBBCC0304u);
}

TEST(TagSteps, PasswordsStayOutOfTheText) {
    Job job =
        WriteTag{.access = access(), .bank = Bank::reserved, .offset = 0, .data = *from_hex("A1B2C3D4")};
    TagSteps steps(job, false, {});
    while (auto step = steps.next()) {
        TagAnswer stuck;
        if (step->what == What::read) stuck.data = Bytes(4, 0x5A);
        steps.answered(stuck);
    }
    EXPECT_EQ(steps.result().status, Status::failed);
    EXPECT_EQ(steps.result().text, "what was read back is not what was written");
}

TEST(TagSteps, KnowsWhichJobsAreForTags) {
    EXPECT_EQ(TagSteps::access_of(GetInputs{}), nullptr);
    Job job = KillTag{.access = access()};
    ASSERT_NE(TagSteps::access_of(job), nullptr);
    EXPECT_EQ(TagSteps::access_of(job)->tag, old_id);
}

}  // namespace gantry
