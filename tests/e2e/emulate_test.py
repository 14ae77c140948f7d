"""gantry emulate: virtual readers against a gateway, over real TCP."""

import json
import re
import socket
import subprocess
import unittest

from gantry_e2e import EVERY_READ, READER, EndToEnd, Process, run, wait_for

ANY_NAME = READER.replace("gate-*", "*").replace('"60s"', '"10s"') + EVERY_READ


class Emulate(EndToEnd):
    def setUp(self):
        self.running = self.gateway(ANY_NAME)

    def emulate(self, *arguments):
        place = f"127.0.0.1:{self.running.port}"
        command = ["emulate", "silion", "--connect", place, "--set", "batch=100ms", *arguments]
        return self.under_way(Process(command, stdin=subprocess.PIPE))

    def connected(self, *names):
        for name in names:
            self.running.wait_for_events(1, "reader.connected", reader=name)

    def states(self, emulation, count=1):
        """What it answers to `state`: one line a reader."""
        before = len(emulation.out.lines())
        emulation.say("state")
        lines = wait_for(lambda: len(found := emulation.out.lines()[before:]) >= count and found, "its state")
        return [json.loads(line) for line in lines]

    def assert_books_balance(self, emulation):
        """What the virtual readers had acknowledged is stored, and nothing that they did not send."""
        self.assertEqual(0, emulation.end())
        last = {line["name"]: line["state"] for line in map(json.loads, emulation.out.lines())}
        for name, state in last.items():
            stored = sum(row["reads"] for row in self.running.events("tag.read", reader=name))
            self.assertGreater(state["reads_acked"], 0)
            self.assertLessEqual(state["reads_acked"], stored)
            self.assertLessEqual(stored, state["reads_sent"])


class Readers(Emulate):
    def test_several_at_once_each_with_its_name_and_tags(self):
        emulation = self.emulate("--count", "3")
        names = [f"virtual-silion-{i}" for i in (1, 2, 3)]
        self.connected(*names)
        for name in names:
            self.running.wait_for_events(1, "tag.observed", reader=name)
        tags = [{row["tag"] for row in self.running.events("tag.new", reader=name)} for name in names]
        self.assertFalse(tags[0] & tags[1] or tags[1] & tags[2] or tags[0] & tags[2], "readers share no tags")
        self.assertTrue(all(row["epc"].startswith("urn:epc:id:sgtin:") for row in self.running.events("tag.observed")))
        self.assert_books_balance(emulation)

    def test_a_name_of_ones_own(self):
        self.emulate("--name", "gate-7")
        self.connected("gate-7")

    def test_it_asks_for_acknowledgements_unless_told_not_to(self):
        self.emulate("--name", "with")
        self.emulate("--name", "without", "--no-ack")
        for name in ("with", "without"):
            self.running.wait_for_events(1, "tag.read", reader=name)
        wait_for(lambda: self.running.reader_info("with")["counters"]["acknowledged"] > 0, "an acknowledgement")
        self.assertEqual(0, self.running.reader_info("without")["counters"]["acknowledged"])

    def test_both_generations(self):
        for generation in ("1", "2"):
            name = f"generation-{generation}"
            emulation = self.emulate("--name", name, "--generation", generation)
            self.running.wait_for_events(1, "tag.read", reader=name)
            self.assertEqual(int(generation), self.states(emulation)[0]["state"]["generation"])

    def test_frames_with_a_crc(self):
        emulation = self.emulate("--set", "crc=true")
        self.running.wait_for_events(1, "tag.observed")
        wait_for(lambda: self.states(emulation)[0]["state"]["acks"] > 0, "an acknowledgement")
        self.assertEqual(0, self.running.reader_info("virtual-silion")["counters"]["bad_checksum"])

    def test_it_ends_by_itself_and_prints_its_state(self):
        done = self.assert_done(run("emulate", "silion", "--connect", f"127.0.0.1:{self.running.port}", "--for", "500ms"))
        line, = done.json_lines()
        self.assertEqual(("virtual-silion", 1), (line["name"], line["state"]["connects"]))

    def test_it_keeps_its_tags_while_the_gateway_is_away(self):
        emulation = self.emulate()
        self.running.wait_for_events(1, "tag.read")
        for again in (self.running.kill_and_restart, self.running.restart):
            again()
            last = self.running.status()["last_seq"]
            wait_for(lambda: any(row["seq"] > last for row in self.running.events("tag.read")), "reads again")
        self.assertEqual(0, self.states(emulation)[0]["state"]["dropped"])
        self.assert_books_balance(emulation)


SCENE = """
[scenario]
name = "two"
[[reader]]
name = "left"
make = "silion"
connect = "GATEWAY"
settings = { batch = "100ms" }
[[reader.antenna]]
position = [-2, 0, 1]
towards = [0, 0, 1]
[[reader]]
name = "right"
make = "caen"
listen = "127.0.0.1:0"
[[reader.antenna]]
position = [2, 0, 1]
towards = [0, 0, 1]
[[tags]]
name = "between"
count = 4
position = [-0.2, 0, 1]
axis = [0, 1, 0]
"""


class AScenario(Emulate):
    def scene(self, text=SCENE):
        path = self.directory() / "scene.toml"
        path.write_text(text.replace("GATEWAY", f"127.0.0.1:{self.running.port}"))
        return str(path)

    def test_readers_of_two_makes_see_the_same_tags(self):
        emulation = self.under_way(Process(["emulate", "any", "--scenario", self.scene()], stdin=subprocess.PIPE))
        place = wait_for(lambda: emulation.out.lines(), "where it listens")[0].removeprefix("listening on ")
        self.running.wait_for_events(4, "tag.new", reader="left")
        seen = {row["tag"] for row in self.running.events("tag.new", reader="left")}
        inventory = run("reader", "exec", "--address", f"caen://{place}", "RawReadIDs", "SourceName=Source_0", "--json")
        self.assert_done(inventory)
        self.assertTrue(any(tag in inventory.out for tag in seen), inventory.out)
        self.assert_books_balance_of("left", emulation)

    def assert_books_balance_of(self, name, emulation):
        self.assertEqual(0, emulation.end())
        states = {line["name"]: line["state"] for line in map(json.loads, emulation.out.lines()[1:])}
        stored = sum(row["reads"] for row in self.running.events("tag.read", reader=name))
        self.assertLessEqual(states[name]["reads_acked"], stored)

    def test_one_reader_of_it_faster_than_it_is(self):
        self.under_way(Process(["emulate", "silion", "--scenario", self.scene(), "--reader", "left", "--speed", "5"]))
        self.running.wait_for_events(4, "tag.observed", reader="left")

    def test_what_is_wrong_with_it_is_told_with_its_place(self):
        path = self.scene(SCENE.replace("batch = \"100ms\"", "batsch = \"1s\""))
        refused = run("emulate", "silion", "--scenario", path)
        self.assertEqual(1, refused.code)
        self.assertRegex(refused.err, r"scene\.toml:8:\d+: .*batsch.*did you mean")


class AHandAtTheDevice(Emulate):
    def setUp(self):
        super().setUp()
        self.emulation = self.emulate("--name", "gate-1")
        self.running.wait_for_events(1, "tag.observed")

    def test_an_error(self):
        self.emulation.say("error 11")
        fault = self.running.wait_for_events(1, "reader.fault")[0]
        self.assertEqual(("gate-1", 11), (fault["reader"], fault["code"]))
        self.assertIn("alarm: no antennas connected", fault["text"])

    def test_an_input(self):
        self.emulation.say("input 1=1")
        self.running.wait_for_events(1, "gpi.changed", input=1, state=1)
        inputs = self.assert_done(self.running.cli("gpio", "get", "gate-1")).out.splitlines()
        self.assertEqual("input 1: on", inputs[0])

    def test_an_output_that_the_gateway_switches(self):
        self.assert_done(self.running.cli("gpio", "set", "gate-1", "2=on"))
        self.assertEqual("01000", self.states(self.emulation)[0]["state"]["outputs"])
        self.assert_done(self.running.cli("gpio", "set", "gate-1", "2=off", "5=on"))
        self.assertEqual("00001", self.states(self.emulation)[0]["state"]["outputs"])

    def test_an_output_goes_back_by_itself(self):
        self.assert_done(self.running.cli("gpio", "set", "gate-1", "1=on", "--for", "1s"))
        self.assertEqual("1", self.states(self.emulation)[0]["state"]["outputs"][0])
        wait_for(lambda: self.states(self.emulation)[0]["state"]["outputs"][0] == "0", "it is off again")

    def test_a_cut_cable(self):
        self.emulation.say("drop")
        self.running.wait_for_events(1, "reader.disconnected")
        self.running.wait_for_events(2, "reader.connected")
        self.assertEqual(2, self.states(self.emulation)[0]["state"]["connects"])

    def test_acknowledgements_that_do_not_arrive(self):
        self.emulation.say("stuck_ack on")
        resent = lambda: self.states(self.emulation)[0]["state"]["resent"] >= 1
        wait_for(resent, "the reader sends again")
        self.emulation.say("stuck_ack off")
        wait_for(lambda: self.running.reader_info("gate-1")["counters"]["repeats"] >= 1, "the repeat is recognised")
        wait_for(lambda: self.states(self.emulation)[0]["state"]["reads_acked"] > 0, "an acknowledgement got through")
        self.assert_books_balance(self.emulation)

    def test_a_word_for_one_of_several(self):
        several = self.emulate("--name", "wall", "--count", "2")
        self.connected("wall-1", "wall-2")
        several.say("wall-2: drop")
        self.running.wait_for_events(2, "reader.connected", reader="wall-2")
        self.assertEqual([], self.running.events("reader.disconnected", reader="wall-1"))
        several.say("wall-3: drop")
        wait_for(lambda: 'there is no virtual reader \\"wall-3\\"' in several.err.text(), "it says so")

    def test_words_that_it_does_not_know(self):
        self.emulation.say("explode")
        wait_for(lambda: "there is no fault" in self.emulation.err.text(), "it says so")
        self.assertTrue(self.emulation.running())
        self.emulation.say("help")
        self.emulation.wait_for_line(r"^  half-open on\|off +nothing comes out")


class TagFiles(Emulate):
    HEAD = "epc,user,antenna,rssi_dbm\n"

    def file(self, text):
        path = self.directory() / "tags.csv"
        path.write_text(text)
        return path

    def test_the_tags_of_a_file_stand_in_front_of_their_antennas(self):
        self.emulate("--tags", self.file(self.HEAD + "3074257BF7194E4000001A85,,1,-40\n30 74 25 7B F7 19 4E 40 00 00 1A 86,,3,\n"))
        self.running.wait_for_events(2, "tag.observed")
        rows = {row["tag"]: row for row in self.running.events("tag.new")}
        self.assertEqual({"3074257BF7194E4000001A85": "Ant1", "3074257BF7194E4000001A86": "Ant3"},
                         {tag: row["antenna"] for tag, row in rows.items()})
        self.assertAlmostEqual(-40, rows["3074257BF7194E4000001A85"]["rssi_dbm"], delta=6)

    def test_user_memory_is_read_when_it_is_asked_for(self):
        self.emulate("--set", "bank_words=2", "--tags", self.file(self.HEAD + "3074257BF7194E4000001A85,DEADBEEF,1,\n"))
        read = self.running.wait_for_events(1, "tag.read")[0]
        self.assertEqual({"user": "DEADBEEF"}, json.loads(read["data"]))

    def test_errors_name_line_and_column(self):
        for text, words in (("epd\n3074\n", "1: .*epd.*epc"), (self.HEAD + "30ZZ,,1,\n", "2: .*epc.*30ZZ"),
                            (self.HEAD + "3074,,1,\n3074,,none,\n", "3: .*antenna.*none"),
                            (self.HEAD + "AB" * 64 + ",,1,\n", "2: .*epc")):
            path = self.file(text)
            done = run("emulate", "silion", "--connect", "127.0.0.1:1", "--tags", path)
            self.assertEqual((1, ""), (done.code, done.out))
            self.assertRegex(done.err, rf"gantry emulate: {re.escape(str(path))}:[^ ]*{words}")

    def test_a_file_that_is_not_there(self):
        self.assert_refused(run("emulate", "silion", "--connect", "127.0.0.1:1", "--tags", "/nowhere.csv"), "/nowhere.csv")


class NoGateway(EndToEnd):
    """A newcomer's first try: nothing listens there, or the gateway does not know the reader."""

    def emulate(self, port, *arguments):
        return run("emulate", "silion", "--connect", f"127.0.0.1:{port}", "--set", "redial=100ms", *arguments)

    def messages(self, done):
        lines = [line for line in done.err.splitlines() if line.startswith("{")]
        return [each["message"] for each in map(json.loads, lines) if each["level"] == "warn"]

    def said(self, done):
        return [line for line in done.err.splitlines() if not line.startswith("{")]

    def closed_port(self):
        with socket.socket() as listener:
            listener.bind(("127.0.0.1", 0))
            return listener.getsockname()[1]

    def test_it_says_that_it_cannot_connect_and_fails_when_it_never_did(self):
        port = self.closed_port()
        done = self.emulate(port, "--for", "1s")
        self.assertEqual(1, done.code)
        warning, = self.messages(done)  # though it has tried several times
        self.assertEqual(f"virtual-silion: cannot connect to 127.0.0.1:{port}: connection refused; it keeps trying", warning)
        line, = self.said(done)
        self.assertIn(f"gantry emulate: 1 of 1 virtual reader never got through to 127.0.0.1:{port} (cannot connect", line)

    def test_it_says_that_the_gateway_turned_it_away(self):
        gateway = self.gateway()  # takes gate-* only
        done = self.emulate(gateway.port, "--generation", "2", "--for", "1s")
        self.assertEqual(1, done.code)
        warning, = self.messages(done)
        self.assertIn(f"virtual-silion: connected to 127.0.0.1:{gateway.port}, and at once closed by the gateway", warning)
        self.assertIn("never got through", self.said(done)[0])

    def test_who_ends_it_earlier_gets_no_failure(self):
        emulation = self.under_way(Process(["emulate", "silion", "--connect", f"127.0.0.1:{self.closed_port()}"]))
        wait_for(lambda: "it keeps trying" in emulation.err.text(), "it says that it cannot connect")
        self.assertEqual(0, emulation.end())


class Usage(EndToEnd):
    def test_a_reader_that_dials_out_must_be_told_where(self):
        self.assert_refused(run("emulate", "silion"), "a silion reader dials out", "--connect HOST:PORT", code=2)

    def test_settings_that_do_not_exist(self):
        base = ["emulate", "silion", "--connect", "127.0.0.1:1", "--log-level", "off"]
        for arguments, words in ((["--set", "bacth=1s"], '--set bacth=1s: there is no setting "bacth"; did you mean "batch"?'),
                                 (["--set", "batch"], "--set: batch has no value; write --set name=value"),
                                 (["--generation", "7"], '--generation 7: generation = "7" is none of: 1, 2'),
                                 (["--fault", "explode"], "--fault explode: there is no fault"),
                                 (["--fault", "drop 5"], '--fault drop 5: "drop 5" is not understood; "drop" stands alone'),
                                 (["--fault", "wall-1: drop"], 'there is no virtual reader "wall-1"'),
                                 (["--baud", "9600"], "--baud is for a serial line, and there is none; add --pty FILE"),
                                 (["--fault", "clock-jump"],
                                  'make cannot have the fault "clock-jump": its frames carry no time; known: error N, '),
                                 (["--for", "2x"], "--for: 2x is no duration; write it like 500ms"),
                                 (["--connect", "nowhere"], '--connect: "nowhere" is no address with a port')):
            self.assert_refused(run(*base, *arguments), words, "; see gantry emulate --help", code=2)

    def test_faults_are_looked_at_before_anybody_is_dialled(self):
        with socket.create_server(("127.0.0.1", 0)) as gateway:
            place = f"127.0.0.1:{gateway.getsockname()[1]}"
            self.assert_refused(run("emulate", "silion", "--connect", place, "--fault", "explode"), "there is no fault", code=2)
            gateway.setblocking(False)
            self.assertRaises(BlockingIOError, gateway.accept)

    def test_a_speed_without_a_line_in_the_scenario(self):
        scene = self.directory() / "scene.toml"
        scene.write_text(SCENE.replace("GATEWAY", "127.0.0.1:1"))
        self.assert_refused(run("emulate", "any", "--scenario", scene, "--baud", "9600"), "--baud is for a serial line", code=2)

    def test_what_ends_it_with_a_failure_is_said(self):
        text = " ".join(self.assert_done(run("emulate", "--help")).out.split())
        self.assertIn("with --connect, that no gateway was reached by then is a failure", text)
        self.assert_done(run("emulate", "caen", "--for", "100ms"))
        self.assert_done(run("emulate", "caen", "--pty", self.directory() / "line", "--for", "100ms"))

    def test_faults_are_listed_with_a_line_each(self):
        everything = self.assert_done(run("emulate", "any", "--fault", "help")).out
        for make in ("silion", "caen", "harting", "dagprog"):
            listed = self.assert_done(run("emulate", make, "--fault", "help")).out
            self.assertIn(f"{make}:\n{listed}", everything)
            self.assertRegex(listed, r"(?m)^  slow TIME\|off +all that it sends comes so much later")
        self.assertNotIn("bad-crc", self.assert_done(run("emulate", "caen", "--fault", "help")).out)


if __name__ == "__main__":
    unittest.main()
