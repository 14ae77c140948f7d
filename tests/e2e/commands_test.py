"""The commands that talk to a running gateway: readers, inputs and outputs, events, the socket."""

import contextlib
import csv
import io
import json
import re
import signal
import sqlite3
import subprocess
import unittest

from gantry_e2e import BINARY, EVERY_READ, READER, EndToEnd, run, wait_for
from silion import GET_INPUTS, SET_OUTPUTS, SilionReader, Tag, new_epc

SGTIN = "3074257BF7194E4000001A85"


class WithReader(EndToEnd):
    MORE = ""

    def setUp(self):
        self.running = self.gateway(READER + EVERY_READ + self.MORE)
        self.reader = self.connect("gate-1")

    def connect(self, name):
        reader = SilionReader(self.running.port, name)
        self.addCleanup(reader.close)
        reader.heartbeat()
        self.running.wait_for_events(1, "reader.connected", reader=name)
        return reader

    def begin(self, *arguments, **more):
        return self.under_way(self.running.begin(*arguments, **more))


class Readers(WithReader):
    def test_the_list_is_a_table(self):
        self.reader.upload(Tag(SGTIN, reads=7))
        done = self.assert_done(self.running.cli("reader", "list"))
        head, row = done.out.splitlines()
        self.assertEqual(["NAME", "MAKE", "READS", "FROM", "STATE"], head.split())
        self.assertRegex(row, r"^gate-1 +silion +7 +127\.0\.0\.1:\d+ +connected, last read .* ago$")

    def test_the_list_as_json_has_an_object_a_line(self):
        self.connect("gate-2").upload(SGTIN)
        rows = self.assert_done(self.running.cli("reader", "list", "--json")).json_lines()
        self.assertEqual([("gate-1", 0), ("gate-2", 1)], [(row["name"], row["reads"]) for row in rows])
        self.assertEqual({"silion"}, {row["make"] for row in rows})
        self.assertTrue(all(row["connected"] for row in rows))
        self.assertNotIn("last_read", rows[0])

    def test_states_are_true(self):
        state = lambda: self.running.reader_info("gate-1")["state"]
        self.assertEqual("connected, nothing read yet", state())
        self.reader.upload(SGTIN)
        self.assertRegex(state(), "^connected, last read .* ago$")
        self.reader.reset()
        wait_for(lambda: re.match("disconnected .* ago$", state()), "it is shown as disconnected")

    def test_a_configured_reader_shows_before_it_first_dials_in(self):
        gateway = self.gateway(READER.replace("gate-*", "dock"))
        self.assertEqual("never connected", gateway.reader_info("dock")["state"])

    def test_with_no_reader_the_list_says_what_to_do(self):
        done = self.assert_done(self.gateway("").cli("reader", "list"))
        self.assertIn("gantry config example", done.out)

    def test_info_tells_what_the_reader_told_of_itself(self):
        self.reader.upload(Tag(SGTIN, reads=7))
        info = self.running.reader_info("gate-1")
        self.assertEqual(("SLR1100", "10.0.0.0"), (info["model"], info["firmware"]))
        counters = info["counters"]
        self.assertEqual((2, 7, 1, 0, 0), tuple(counters[each] for each in
                                                ("frames", "reads", "acknowledged", "repeats", "resyncs")))
        text = self.assert_done(self.running.cli("reader", "info", "gate-1")).out
        self.assertRegex(text, r"(?m)^model +SLR1100$")
        self.assertRegex(text, r"(?m)^acknowledged +1$")

    def test_info_of_a_reader_that_does_not_exist(self):
        self.assert_refused(self.running.cli("reader", "info", "gate-9"), 'there is no reader "gate-9"', "gantry reader list")

    def test_the_list_mentions_who_was_turned_away(self):
        stranger = SilionReader(self.running.port, "stranger")
        self.addCleanup(stranger.close)
        stranger.heartbeat()
        wait_for(lambda: self.running.listener()["refused"] == 1, "the gateway turns it away")
        done = self.assert_done(self.running.cli("reader", "list"))
        self.assertEqual("1 connection was refused: see the gateway's log\n", done.err)
        self.assertNotIn("refused", done.out)
        done = self.assert_done(self.running.cli("reader", "list", "--json"))
        self.assertEqual(("", 1), (done.err, len(done.json_lines())))

    def test_without_a_gateway_they_say_so(self):
        nowhere = self.directory()
        for command in (["reader", "list"], ["reader", "info", "x"], ["gpio", "get", "x"]):
            self.assert_refused(run(*command, "--data-dir", nowhere), nowhere)


class InputsAndOutputs(WithReader):
    def set(self, *arguments):
        """What goes over the wire for `gpio set gate-1 …`, answered well."""
        asking = self.begin("gpio", "set", "gate-1", *arguments)
        command = self.reader.next_command()
        self.reader.answer(command)
        self.assertEqual(0, asking.wait(), asking.err.text())
        self.assertEqual(SET_OUTPUTS, command.code)
        return command.data.hex(" ")

    def test_get_prints_each_input(self):
        asking = self.begin("gpio", "get", "gate-1")
        command = self.reader.next_command()
        self.assertEqual((GET_INPUTS, b""), (command.code, command.data))
        self.reader.answer(command, bytes([4, 1, 1, 2, 0, 3, 1, 4, 0]))
        self.assertEqual(0, asking.wait())
        self.assertEqual(["input 1: on", "input 2: off", "input 3: on", "input 4: off"], asking.out.lines())

    def test_get_as_json(self):
        asking = self.begin("gpio", "get", "gate-1", "--json")
        self.reader.answer(self.reader.next_command(), bytes([1, 1, 1]))
        self.assertEqual(0, asking.wait())
        result = json.loads(asking.out.text())
        self.assertEqual(("gate-1", "done"), (result["reader"], result["status"]))
        inputs = [(each["input"], bool(each["state"])) for each in result["values"]["inputs"]]
        self.assertEqual([(1, True)], inputs)

    def test_set_holds_a_state(self):
        self.assertEqual("01 01 01 00", self.set("1=on"))

    def test_set_for_a_while(self):
        self.assertEqual("01 01 01 07", self.set("1=on", "--for", "7s"))

    def test_set_takes_several_outputs(self):
        self.assertEqual("03 01 01 00 02 00 00 04 01 00", self.set("1=1", "2=off", "4=on"))

    def test_what_the_reader_refuses_is_told_with_its_reason(self):
        asking = self.begin("gpio", "set", "gate-1", "5=on")
        self.reader.answer(self.reader.next_command(), status=7)
        self.assertEqual(1, asking.wait())
        self.assertIn("gate-1: failed; the reader answered 7: invalid parameter", asking.err.text())

    def test_the_older_coding_of_a_status_means_the_same(self):
        asking = self.begin("gpio", "set", "gate-1", "1=on", "--json")
        self.reader.answer(self.reader.next_command(), status=100_016)
        self.assertEqual(1, asking.wait())
        self.assertIn("operation already running", json.loads(asking.out.text())["text"])

    def test_a_reader_that_does_not_answer(self):
        done = self.running.cli("gpio", "set", "gate-1", "1=on", "--timeout", "300ms")
        self.assert_refused(done, "gate-1: timed_out", "what it did is not known")
        self.assertEqual(1, self.running.reader_info("gate-1")["counters"]["timeouts"])

    def test_a_reader_that_goes_away_before_it_answers(self):
        asking = self.begin("gpio", "get", "gate-1", "--timeout", "3s")
        self.reader.next_command()
        self.reader.reset()
        self.assertEqual(1, asking.wait())
        self.assertIn("gate-1: unknown; the link", asking.err.text())

    def test_tags_flow_while_a_command_waits(self):
        asking = self.begin("gpio", "get", "gate-1")
        command = self.reader.next_command()
        self.reader.upload(SGTIN)
        self.reader.answer(command, bytes([1, 1, 0]))
        self.assertEqual(0, asking.wait())

    def test_a_reader_that_is_not_connected(self):
        self.reader.reset()
        self.running.wait_for_events(1, "reader.disconnected")
        self.assert_refused(self.running.cli("gpio", "get", "gate-1", "--timeout", "300ms"), "gate-1: cancelled", "not connected")

    def test_a_reader_that_does_not_exist(self):
        self.assert_refused(self.running.cli("gpio", "get", "gate-9"), 'there is no reader "gate-9"')

    def test_outputs_that_cannot_be(self):
        for arguments, why in ((["9=on"], "there is no output 9"), (["1=on", "1=off"], "named twice"),
                               (["1=on", "--for", "1500ms"], "whole seconds"), (["1=on", "--for", "1h"], "254 s")):
            self.assert_refused(self.running.cli("gpio", "set", "gate-1", *arguments), "unsupported", why)

    def test_arguments_that_make_no_sense(self):
        for arguments in (["1"], ["on"], ["1=maybe"], ["0=on"], ["1=on", "--for", "soon"], ["1=on", "--timeout", "soon"]):
            done = self.running.cli("gpio", "set", "gate-1", *arguments)
            self.assert_refused(done, "; write ", "; see gantry gpio set --help", code=2)


class Events(WithReader):
    MORE = '[presence]\nglimpse_timeout = "1h"\nlose_after = "1h"\n'  # so that no event comes by itself

    def setUp(self):
        super().setUp()
        self.tags = [SGTIN, new_epc(), new_epc()]
        self.reader.upload(*(Tag(tag, antenna=i) for i, tag in enumerate(self.tags, 1)))
        self.other = self.connect("gate-2")
        self.other.upload(self.tags[0])
        self.running.wait_for_events(3, "tag.observed")

    def seqs(self, *arguments):
        return [row["seq"] for row in self.running.query(*arguments)]

    def expected(self, condition):
        return [row["seq"] for row in self.running.events() if condition(row)]

    def test_filters_do_what_they_say(self):
        rows = self.running.events()
        middle = rows[len(rows) // 2]
        cases = {
            (): lambda row: True,
            ("--type", "tag.new"): lambda row: row["type"] == "tag.new",
            ("--type", "tag.new", "--type", "tag.read"): lambda row: row["type"] in ("tag.new", "tag.read"),
            ("--type", "tag.*"): lambda row: row["type"].startswith("tag."),
            ("--type", "reader.*", "--type", "tag.new"): lambda row: row["type"].startswith("reader.") or row["type"] == "tag.new",
            ("--reader", "gate-2"): lambda row: row["reader"] == "gate-2",
            ("--reader", "*-1"): lambda row: row["reader"] == "gate-1",
            ("--zone", "gate"): lambda row: row.get("zone") == "gate",
            ("--tag", SGTIN): lambda row: row.get("tag") == SGTIN,
            ("--tag", SGTIN[:20].lower()): lambda row: row.get("tag", "").startswith(SGTIN[:20]),
            ("--after", middle["seq"]): lambda row: row["seq"] > middle["seq"],
            ("--since", middle["time"]): lambda row: row["time"] >= middle["time"],
            ("--until", middle["time"]): lambda row: row["time"] < middle["time"],
            ("--since", "1h"): lambda row: True,
            ("--until", "1h"): lambda row: False,
            ("--reader", "gate-1", "--type", "tag.read", "--tag", self.tags[1]):
                lambda row: (row["type"], row["reader"], row.get("tag")) == ("tag.read", "gate-1", self.tags[1]),
        }
        for arguments, condition in cases.items():
            self.assertEqual(self.expected(condition), self.seqs(*arguments), arguments)

    def test_newest_first_and_limit(self):
        seqs = self.seqs()
        self.assertEqual(seqs[::-1], self.seqs("--newest-first"))
        self.assertEqual(seqs[:2], self.seqs("--limit", "2"))
        self.assertEqual(seqs[:-3:-1], self.seqs("--limit", "2", "--newest-first"))

    def test_for_people_an_event_is_a_line(self):
        lines = self.assert_done(self.running.cli("events", "query", "--type", "tag.observed")).out.splitlines()
        self.assertEqual(3, len(lines))
        self.assertRegex(lines[0], rf"tag\.observed +gate-1/Ant1 in gate +{SGTIN}  \(01\)80614141123458\(21\)6789  -50\.0 dBm  1 read$")

    def test_a_stopped_gateway_can_still_be_asked(self):
        before = self.running.query()
        self.running.stop()
        rows = self.running.query("--db", self.running.db)
        self.assertEqual(before, rows[:len(before)])
        self.assertEqual(["reader.disconnected"] * 2, [row["type"] for row in rows[len(before):]])

    def test_export_writes_the_same_lines(self):
        file = self.running.home / "out.jsonl"
        done = self.assert_done(self.running.cli("events", "export", "-o", file))
        self.assertEqual("", done.out)
        rows = [json.loads(line) for line in file.read_text().splitlines()]
        self.assertEqual(self.running.query(), rows)

    def test_export_as_csv(self):
        done = self.assert_done(self.running.cli("events", "export", "--format", "csv", "--type", "tag.observed"))
        rows = list(csv.DictReader(io.StringIO(done.out)))
        expected = self.running.events("tag.observed")
        self.assertEqual(len(expected), len(rows))
        for row, event in zip(rows, expected):
            for key in ("id", "seq", "type", "time", "reader", "antenna", "zone", "tag", "epc", "gs1", "rssi_dbm", "reads",
                        "first_seen", "last_seen", "pc", "xpc"):
                self.assertEqual(str(event.get(key, "")), row[key], key)

    def test_export_to_where_nothing_can_be_written(self):
        self.assert_refused(self.running.cli("events", "export", "-o", "/nowhere/out.jsonl"), "/nowhere/out.jsonl")
        done = self.running.cli("events", "export", "-o", "/dev/full")
        self.assert_refused(done, "cannot write")

    def test_a_time_that_is_none(self):
        done = self.running.cli("events", "query", "--since", "yesterday")
        self.assert_refused(done, "--since: yesterday", "2026-", code=2)

    def test_a_type_that_is_none(self):
        done = self.running.cli("events", "query", "--type", "tag.nwe")
        self.assert_refused(done, "--type: tag.nwe is not known; did you mean tag.new?", code=2)

    def test_a_store_that_is_not_there(self):
        nowhere = self.directory()
        self.assert_refused(run("events", "query", "--data-dir", nowhere), nowhere / "gantry.db", "-c FILE or --data-dir DIR")

    def test_a_file_of_another_program_is_no_store(self):
        other = self.directory() / "other.db"
        with contextlib.closing(sqlite3.connect(other)) as db:
            db.execute("CREATE TABLE notes(text)")
        self.assert_refused(run("events", "query", "--db", other), other, "of another program; give the data directory")

    def test_tail_follows(self):
        tail = self.begin("events", "tail", "--json", "-n", "2")
        tail.wait_for_line(r"\{")
        tags = [new_epc() for _ in range(5)]
        for tag in tags:
            self.reader.upload(tag)
            tail.wait_for_line(rf'"type":"tag.observed".*"tag":"{tag}"')
        self.assertEqual(0, tail.end())
        seqs = [json.loads(line)["seq"] for line in tail.out.lines()]
        last = self.running.events()[-1]["seq"]
        self.assertEqual(list(range(seqs[0], last + 1)), seqs, "each once, in order")
        self.assertEqual(2 + 15, len(seqs))

    def test_tail_follows_only_what_was_asked_for(self):
        tail = self.begin("events", "tail", "--type", "gpi.changed", "-n", "0")
        # It begins at what was there when it opened the store, and that is seen only by what it prints.
        def toggle():
            self.reader.inputs(1)
            self.reader.inputs(0)
            return tail.out.lines()
        wait_for(toggle, "it follows")
        self.reader.upload(new_epc())
        before = len(tail.out.lines())
        self.reader.inputs(1)
        wait_for(lambda: len(tail.out.lines()) > before, "the next one")
        self.assertEqual(0, tail.end(signal.SIGINT))
        for line in tail.out.lines():
            self.assertIn("input 1 = ", line)

    def test_tail_goes_on_over_a_restart_of_the_gateway(self):
        tail = self.begin("events", "tail", "--json")
        tail.wait_for_line(r"\{")
        self.running.kill_and_restart()
        tag = new_epc()
        self.reader.port = self.running.port
        self.reader.connect().upload(tag)
        tail.wait_for_line(rf'"type":"tag.observed".*"tag":"{tag}"')
        self.assertEqual(0, tail.end())

    def test_tail_ends_when_nobody_reads_it(self):
        tail = self.begin("events", "tail", "--json")
        tail.wait_for_line(r"\{")
        tail.close_output()
        wait_for(lambda: not tail.running(), "it ends, though nothing happens any more")
        self.assertEqual((0, ""), (tail.wait(), tail.err.text()))

    def test_a_pipe_that_nobody_reads_to_its_end_is_no_failure(self):
        self.reader.upload(*(new_epc() for _ in range(400)))  # more than a pipe holds
        place = f"--data-dir {self.running.data}"
        for command in (f"events query {place}", f"events tail -n 1000 {place}", f"events export {place}"):
            line = f"{BINARY} {command} | head -n 1 > /dev/null; echo ${{PIPESTATUS[0]}}"
            done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60, check=False)
            self.assertEqual(("0\n", ""), (done.stdout, done.stderr), command)


class Socket(WithReader):
    def problem(self, status, *request, **more):
        answer = self.running.ask(*request, **more)
        self.assertEqual((status, "application/problem+json"), (answer.status, answer.kind), answer.body)
        body = answer.json()
        self.assertEqual(status, body["status"])
        self.assertTrue(body["title"])
        return body

    def test_status_tells_how_it_goes(self):
        self.reader.upload(Tag(SGTIN, reads=7))
        wait_for(lambda: self.running.status()["events"] >= 4, "the figures are of now")
        status = self.running.status()
        self.assertEqual(("e2e", 7, 1), (status["id"], status["reads"], status["tags_present"]))
        self.assertEqual(len(self.running.events()), status["last_seq"])
        self.assertEqual([("silion-listen", f"127.0.0.1:{self.running.port}", 1)],
                         [(each["scheme"], each["address"], each["connections"]) for each in status["listeners"]])
        self.assertNotIn("store_trouble", status)

    def test_errors_are_problem_documents(self):
        self.problem(404, "GET", "/")
        self.problem(404, "GET", "/api/v1/nothing")
        self.problem(404, "GET", "/api/v1/readers/gate-9")
        self.problem(405, "DELETE", "/api/v1/readers")
        self.problem(405, "DELETE", "/api/v1/jobs")

    def test_a_job_that_makes_no_sense_is_refused(self):
        for body in ("", "{", "[]", "7", '"text"', {}, {"reader": "gate-1"}, {"reader": 7, "op": "gpio.get"},
                     {"reader": "gate-1", "op": "explode"}, {"reader": "gate-1", "op": "gpio.set"},
                     {"reader": "gate-1", "op": "gpio.set", "outputs": []},
                     {"reader": "gate-1", "op": "gpio.set", "outputs": [{"output": 0, "state": True}]},
                     {"reader": "gate-1", "op": "gpio.set", "outputs": [{"output": 1, "state": "on"}]},
                     {"reader": "gate-1", "op": "gpio.set", "outputs": [{"output": 1, "state": True, "for_ms": -1}]},
                     {"reader": "gate-1", "op": "gpio.get", "timeout_ms": 0},
                     {"reader": "gate-1", "op": "gpio.get", "timeout_ms": "10s"}):
            self.problem(400, "POST", "/api/v1/jobs", body)
        self.problem(404, "POST", "/api/v1/jobs", {"reader": "gate-9", "op": "gpio.get"})
        self.problem(413, "POST", "/api/v1/jobs", b"x" * (2 << 20))
        self.reader.upload(SGTIN)

    def test_a_head_without_end_is_refused(self):
        answer = self.running.ask("GET", "/healthz", headers={"X-Long": "x" * 60_000})
        self.assertEqual(431, answer.status)
        self.assertEqual({"status": "ok"}, self.running.ask("GET", "/healthz").json())

    def test_a_reader_name_in_a_path_is_decoded(self):
        for strange in ("../../x", "a%2Fb", "%00", "\u00e9"):
            quoted = "".join(f"%{byte:02X}" for byte in strange.encode())
            self.problem(404, "GET", f"/api/v1/readers/{quoted}")


if __name__ == "__main__":
    unittest.main()
