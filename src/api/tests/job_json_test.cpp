#include "api/job_json.hpp"

#include <gtest/gtest.h>
#include <boost/json.hpp>

#include "gateway/tests/toy_dial.hpp"

namespace gantry::api {
namespace {

namespace json = boost::json;
using gateway::test::ding;

Result<Job> parse(std::string_view text) {
    return job_from_json(json::parse(text).as_object(), ding);
}

template <class T>
T job(std::string_view text) {
    auto parsed = parse(text);
    EXPECT_TRUE(parsed) << text << ": " << (parsed ? "" : parsed.error().text());
    if (!parsed || !std::holds_alternative<T>(*parsed)) {
        ADD_FAILURE() << "another job: " << text;
        return {};
    }
    return std::get<T>(*parsed);
}

TEST(JobJson, EveryOpBecomesItsJob) {
    job<GetInputs>(R"({"op":"gpio.get"})");
    job<RestartReader>(R"({"op":"restart","reader":"r","timeout_ms":5,"wait":false})");
    job<StartReading>(R"({"op":"reader.start"})");
    job<StopReading>(R"({"op":"reader.stop"})");
    auto outputs = job<SetOutputs>(
        R"({"op":"gpio.set","outputs":[{"output":1,"state":true,"for_ms":7000},{"output":2,"state":false}]})");
    ASSERT_EQ(outputs.changes.size(), 2u);
    EXPECT_EQ(outputs.changes[0].output, 1);
    EXPECT_TRUE(outputs.changes[0].state);
    EXPECT_EQ(outputs.changes[0].for_ms, 7000u);
    EXPECT_FALSE(outputs.changes[1].state);
}

TEST(JobJson, ACommandThatCannotBeUndoneIsConfirmedLikeTheJobThatDoesTheSame) {
    auto refused = parse(R"({"op":"exec","command":"Kill"})");
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().text(),
              "Kill cannot be undone, and nobody has confirmed it; add \"confirm\":true");
    EXPECT_EQ(job<Execute>(R"({"op":"exec","command":"Kill","confirm":true})").command.name, "Kill");
    job<Execute>(R"({"op":"exec","command":"Ping"})");
}

TEST(JobJson, TagJobsCarryWhatIsSaidAndSensibleDefaults) {
    auto read = job<ReadTag>(R"({"op":"tag.read","tag":"e200 1122"})");
    EXPECT_EQ(to_hex(read.access.tag.view()), "E2001122");
    EXPECT_EQ(read.access.technology, event::Technology::epc_gen2);
    EXPECT_EQ(read.access.antenna, std::nullopt);
    EXPECT_EQ(read.access.password, 0u);
    EXPECT_EQ(read.access.retries, 2);
    EXPECT_EQ(read.bank, Bank::user);
    EXPECT_EQ(read.offset, 0u);
    EXPECT_EQ(read.length, 1u);
    read = job<ReadTag>(R"({"op":"tag.read","tag":"E2","bank":"tid","offset":2,"length":4,"antenna":"Ant3",)"
                        R"("access_password":"C0FFEE01","retries":0,"technology":"iso18000-6b"})");
    EXPECT_EQ(read.bank, Bank::tid);
    EXPECT_EQ(read.offset, 2u);
    EXPECT_EQ(read.length, 4u);
    EXPECT_EQ(read.access.antenna, 3);
    EXPECT_EQ(read.access.password, 0xC0FFEE01u);
    EXPECT_EQ(read.access.retries, 0);
    EXPECT_EQ(read.access.technology, event::Technology::iso18000_6b);

    auto write = job<WriteTag>(R"({"op":"tag.write","tag":"E2","data":"00112233","verify":false})");
    EXPECT_EQ(to_hex(write.data), "00112233");
    EXPECT_FALSE(write.verify);
    auto program = job<ProgramTag>(R"({"op":"tag.program","tag":"E2","new_tag":"E3","numbering_system":5})");
    EXPECT_EQ(to_hex(program.new_id.view()), "E3");
    EXPECT_EQ(program.numbering_system, 5);
    EXPECT_TRUE(program.verify);
    auto kill = job<KillTag>(R"({"op":"tag.kill","tag":"E2","kill_password":"1","confirm":true})");
    EXPECT_EQ(kill.kill_password, 1u);
}

TEST(JobJson, LocksAreTheStandardsBits) {
    auto lock = job<LockTag>(R"({"op":"tag.lock","tag":"E2","fields":{"user":"locked"}})");
    EXPECT_EQ(lock.mask, 0b11);
    EXPECT_EQ(lock.action, 0b10);
    lock = job<LockTag>(
        R"({"op":"tag.lock","tag":"E2","confirm":true,"fields":{"kill":"permanently_locked","access":"open",)"
        R"("epc":"locked","tid":"permanently_open"}})");
    EXPECT_EQ(lock.mask, 0b1111111100);
    EXPECT_EQ(lock.action, 0b1100100100);
    lock = job<LockTag>(R"({"op":"tag.lock","tag":"E2","mask":3,"action":2})");
    EXPECT_EQ(lock.mask, 3);
    EXPECT_EQ(lock.action, 2);
    lock = job<LockTag>(R"({"op":"tag.lock","tag":"E2","address":9,"confirm":true})");
    EXPECT_EQ(lock.address, 9u);
}

TEST(JobJson, WhatCannotBeUndoneWantsToBeConfirmed) {
    for (auto* text : {R"({"op":"tag.kill","tag":"E2","kill_password":"1"})",
                       R"({"op":"tag.kill","tag":"E2","kill_password":"1","confirm":false})",
                       R"({"op":"tag.lock","tag":"E2","fields":{"epc":"permanently_open"}})",
                       R"({"op":"tag.lock","tag":"E2","mask":1,"action":1})",
                       R"({"op":"tag.lock","tag":"E2","address":9})"}) {
        auto refused = parse(text);
        ASSERT_FALSE(refused) << text;
        EXPECT_EQ(refused.error().hint, "add \"confirm\":true");
    }
    // A permanent bit that the mask leaves out does nothing.
    EXPECT_TRUE(parse(R"({"op":"tag.lock","tag":"E2","mask":2,"action":3})"));
}

TEST(JobJson, ParametersAndCommandsAreThoseOfTheMake) {
    EXPECT_EQ(job<GetParameter>(R"({"op":"config.get"})").name, "");
    EXPECT_EQ(job<GetParameter>(R"({"op":"config.get","parameter":"Serial"})").name, "Serial");
    EXPECT_EQ(job<SetParameter>(R"({"op":"config.set","parameter":"Power","value":500})").value, "500");
    EXPECT_EQ(job<SetParameter>(R"({"op":"config.set","parameter":"Mode","value":"fast"})").value, "fast");
    EXPECT_FALSE(job<GetParameter>(R"({"op":"config.get","parameter":"Serial"})").permanent);
    EXPECT_TRUE(job<GetParameter>(R"({"op":"config.get","permanent":true})").permanent);
    EXPECT_TRUE(
        job<SetParameter>(R"({"op":"config.set","parameter":"Power","value":5,"permanent":true})").permanent);
    auto exec = job<Execute>(R"({"op":"exec","command":"SetPower","fields":{"PowerSet":5}})");
    EXPECT_EQ(exec.command.name, "SetPower");
    EXPECT_EQ(*wire::find(exec.command.fields, "PowerSet"), wire::Value(5));
    exec = job<Execute>(R"({"op":"exec","command":"Ping","fields":[["A",1],["A",2]]})");
    EXPECT_EQ(exec.command.fields.size(), 2u);
}

TEST(JobJson, WhatIsWrongIsSaid) {
    struct Case {
        std::string_view request, error;
    };
    for (auto& [request, error] : std::vector<Case>{
             {R"({})",
              "a job needs \"op\"; one of: gpio.get, gpio.set, restart, reader.start, reader.stop, tag.read, "
              "tag.write, tag.program, tag.lock, tag.kill, config.get, config.set, …"},
             {R"({"op":"tag.raed"})", "there is no job \"tag.raed\"; did you mean tag.read?"},
             {R"({"op":"gpio.set"})",
              "gpio.set needs \"outputs\"; a list of {\"output\":1,\"state\":true,\"for_ms\":7000}"},
             {R"({"op":"gpio.set","outputs":[{"output":0,"state":true}]})",
              "an output must be {\"output\":1 to 255,\"state\":true or false}; \"output\" must be a whole "
              "number from 1 to 255"},
             {R"({"op":"tag.read"})", "the job needs \"tag\"; \"tag\":\"3074257BF7194E4000001A85\""},
             {R"({"op":"tag.read","tag":"E"})", "\"tag\" is not hex; two digits a byte: \"3074257B\""},
             {R"({"op":"tag.read","tag":""})", "\"tag\" must have 1 to 62 bytes"},
             {R"({"op":"tag.read","tag":5})", "\"tag\" must be text"},
             {R"({"op":"tag.read","tag":"E2","bnak":"tid"})", "tag.read has no \"bnak\"; did you mean bank?"},
             {R"({"op":"tag.read","tag":"E2","bank":"usr"})",
              "there is no bank \"usr\"; reserved, epc, tid or user"},
             {R"({"op":"tag.read","tag":"E2","length":0})",
              "\"length\" must be a whole number from 1 to 65535"},
             {R"({"op":"tag.read","tag":"E2","length":1.5})",
              "\"length\" must be a whole number from 1 to 65535"},
             {R"({"op":"tag.read","tag":"E2","antenna":"Port1"})",
              "ding readers have no antenna \"Port1\"; theirs are called Ant1, Ant2, …"},
             {R"({"op":"tag.read","tag":"E2","technology":"epc-gen3"})",
              "there is no technology \"epc-gen3\"; did you mean epc-gen2?"},
             {R"({"op":"tag.write","tag":"E2"})", "the job needs \"data\"; \"data\":\"00112233\""},
             {R"({"op":"tag.write","tag":"E2","data":"001122"})",
              "\"data\" must be whole words for this tag: an even number of bytes"},
             {R"({"op":"tag.lock","tag":"E2"})",
              "tag.lock needs one of \"fields\", \"mask\" with \"action\", and \"address\"; "
              "\"fields\":{\"user\":\"locked\"}"},
             {R"({"op":"tag.lock","tag":"E2","fields":{"usr":"locked"}})",
              "there is no lock for \"usr\"; did you mean user?"},
             {R"({"op":"tag.lock","tag":"E2","fields":{"user":"loked"}})",
              "user: \"loked\" is no state of a lock; did you mean locked?"},
             {R"({"op":"config.set","parameter":"Power","value":5000})", "Power = 5000 is outside 1 to 2000"},
             {R"({"op":"config.set","parameter":"Serial","value":"x"})", "Serial can only be read"},
             {R"({"op":"config.set","parameter":"Mode","value":"fastt"})",
              "Mode cannot be \"fastt\"; did you mean fast?"},
             {R"({"op":"config.get","parameter":"Powr"})",
              "ding readers have no parameter \"Powr\"; did you mean Power?"},
             {R"({"op":"exec","command":"SetPowr"})",
              "ding has no command \"SetPowr\"; did you mean SetPower?"},
             {R"({"op":"exec","command":"Ping","fields":5})",
              "\"fields\" must be a list of [\"Name\", value] pairs"},
         }) {
        auto result = parse(request);
        ASSERT_FALSE(result) << request;
        EXPECT_EQ(result.error().text(), error) << request;
    }
}

TEST(JobJson, AWrongPasswordIsNotRepeatedInTheError) {
    for (auto* text : {R"({"op":"tag.read","tag":"E2","access_password":"hunter2"})",
                       R"({"op":"tag.read","tag":"E2","access_password":"C0FFEE0123"})",
                       R"({"op":"tag.kill","tag":"E2","confirm":true,"kill_password":"hunter2"})"}) {
        auto refused = parse(text);
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().text().find("hunter2"), std::string::npos);
        EXPECT_EQ(refused.error().text().find("C0FFEE"), std::string::npos);
    }
}

TEST(JobJson, AJobIsShownWithWhatThereIsToSay) {
    gateway::JobStatus status;
    status.id = 7;
    status.reader = "dock-1";
    status.op = "tag.read";
    status.detail = "tag E2, user 0 to 0";
    status.state = gateway::JobState::done;
    status.values = {{"data", Bytes{0, 17}}};
    status.created = *parse_rfc3339("2026-11-21T23:04:00Z");
    status.deadline = status.created + 10s;
    status.ended = status.created + 1s;
    EXPECT_EQ(json::serialize(job_to_json(status)),
              R"({"id":7,"reader":"dock-1","op":"tag.read","detail":"tag E2, user 0 to 0","status":"done",)"
              R"("created":"2026-11-21T23:04:00.000000Z","deadline":"2026-11-21T23:04:10.000000Z",)"
              R"("ended":"2026-11-21T23:04:01.000000Z","values":{"data":"0011"}})");
    status.op = "exec";
    status.values = {{"A", 1}, {"A", 2}};
    EXPECT_EQ(json::serialize(job_to_json(status).at("values")), R"([["A",1],["A",2]])");
}

}  // namespace
}  // namespace gantry::api
