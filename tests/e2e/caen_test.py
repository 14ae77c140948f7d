"""Readers that are dialled: virtual CAEN readers, a gateway that dials them, and every verb over it and without it."""

import json
import os
import pty
import re
import signal
import socket
import subprocess
import unittest

from gantry_e2e import BINARY, DEADLINE, Process, run, wait_for
from virtual_reader import ACCESS, KILL, OTHER, TAG, USER, WithVirtualReader

class Verbs:
    """What works over a gateway and without one; `cli` runs a command about the reader `dock`."""

    def tag(self, verb, *arguments, tag=TAG, **more):
        return self.cli("tag", verb, "dock", tag, *arguments, **more)

    def read(self, length=8, offset=0, bank="user", **more):
        return self.assert_done(self.tag("read", "--bank", bank, "--offset", offset, "--length", length, **more)).out

    def test_a_tag_is_read(self):
        self.assertEqual(USER + "\n", self.read())
        self.assertEqual("4455\n", self.read(length=1, offset=2))
        self.assertEqual(TAG + "\n", self.read(bank="epc", offset=2, length=6))

    def test_a_tag_is_read_as_json(self):
        job, = self.assert_done(self.tag("read", "--length", "2", "--json")).json_lines()
        self.assertEqual(("tag.read", "done", {"data": USER[:8]}), (job["op"], job["status"], job["values"]))

    def test_a_tag_is_written_and_read_back(self):
        done = self.assert_done(self.tag("write", "--data", "CAFE BABE", "--offset", "1"))
        self.assertRegex(done.out, "^done: tag write, ")
        self.assertEqual("0011CAFEBABE6677\n", self.read(length=4))
        self.assert_done(self.tag("write", "--data", "0000", "--no-verify"))
        self.assertEqual("0000\n", self.read(length=1))

    def test_half_a_word_is_refused(self):
        self.assert_refused(self.tag("write", "--data", "00112"), "--data", "hex digits", code=2)
        self.assert_refused(self.tag("write", "--data", "001122"), "whole words", code=2)

    def test_a_tag_that_is_not_there(self):
        self.assert_refused(self.tag("read", "--retries", "0", tag=OTHER), "failed", "tag not present")

    def test_a_tag_gets_another_id(self):
        self.assert_done(self.tag("program", OTHER))
        self.assertEqual(USER + "\n", self.read(tag=OTHER))
        self.assertEqual(1, self.tag("read", "--retries", "0").code)

    def test_what_is_locked_needs_the_password(self):
        self.assert_done(self.tag("lock", "--field", "user=locked", "--access-password", ACCESS))
        refused = self.tag("write", "--data", "FFFF")
        self.assert_refused(refused, "failed")
        self.assertNotIn(ACCESS, refused.err)
        secret = self.directory() / "secret"
        secret.write_text(ACCESS + "\n")
        self.assert_done(self.tag("write", "--data", "FFFF", "--access-password-file", secret))
        self.assertEqual("FFFF\n", self.read(length=1))
        self.assert_done(self.tag("lock", "--field", "user=open",
                                  env={**os.environ, "GANTRY_ACCESS_PASSWORD": ACCESS}))
        self.assert_done(self.tag("write", "--data", "AAAA"))

    def test_a_tag_is_killed(self):
        self.assert_refused(self.tag("kill", "--kill-password", "00000007", "--yes"), "failed")
        self.assert_done(self.tag("kill", "--kill-password", KILL, "--yes"))
        self.assertEqual(1, self.tag("read", "--retries", "0").code)

    def test_inputs_and_outputs(self):
        self.emulation.say("input 2=1")
        inputs = lambda: self.assert_done(self.cli("gpio", "get", "dock")).out.splitlines()
        wait_for(lambda: inputs()[:2] == ["input 1: off", "input 2: on"], "the input is seen")
        before = self.state()["outputs"]
        self.assert_done(self.cli("gpio", "set", "dock", "1=on"))
        self.assertNotEqual(before, self.state()["outputs"])

    def test_parameters(self):
        self.assertRegex(self.assert_done(self.cli("reader", "config", "get", "dock")).out, r"(?m)^Protocol +EPCC1G2$")
        self.assertEqual("Power  321 mW\n", self.assert_done(self.cli("reader", "config", "set", "dock", "Power", "321")).out)
        self.assertEqual(321, self.state()["power_mw"])
        get = ["reader", "config", "get", "dock", "Power"]
        self.assertEqual("Power  321 mW\n", self.assert_done(self.cli(*get)).out)
        job, = self.assert_done(self.cli(*get, "--json")).json_lines()
        self.assertEqual({"Power": 321}, job["values"])
        self.assert_refused(self.cli("reader", "config", "get", "dock", "Pwer"), "did you mean Power?")

    def exec(self, *arguments):
        return self.cli("reader", "exec", "dock", *arguments)

    def test_commands_by_their_names(self):
        self.assertRegex(self.assert_done(self.exec("SetPower", "PowerSet=432")).out, r"^ResultCode +success\n$")
        answer = self.assert_done(self.exec("GetPower")).out
        self.assertRegex(answer, r"(?m)^PowerGet +432 mW$")
        self.assertRegex(answer, r"(?m)^ResultCode +success$")
        self.assert_done(self.exec("SetSourceConfig", "SourceName=Source_0", "ConfigParameter=G2Session", "ConfigValue=1"))
        answer = self.assert_done(self.exec("GetSourceConfig", "SourceName=Source_0", "ConfigParameter=G2Session")).out
        self.assertRegex(answer, r"(?m)^ConfigValue +1$")
        answer = self.assert_done(self.exec("RawReadIDs", "SourceName=Source_0")).out
        self.assertRegex(answer, rf"(?m)^TagID +{TAG}$")
        job, = self.assert_done(self.exec("GetReaderInfo", "--json")).json_lines()
        self.assertEqual(["ResultCode", "success"], job["values"][-1])

    def test_what_a_reader_refuses_is_shown_all_the_same(self):
        done = self.exec("CheckReadPointStatus", "ReadPointName=Ant9")
        self.assertEqual(1, done.code)
        self.assertRegex(done.out, r"(?m)^ResultCode +bad read point$")
        self.assertRegex(done.err, r"(?m)^gantry reader exec: \S+: failed; bad read point \(123\)$")

    def test_commands_that_cannot_be(self):
        self.assert_refused(self.exec("GetPowr"), "did you mean GetPower?")
        self.assert_refused(self.exec("SetPower", "Power=7"), "fields of SetPower: PowerSet")
        self.assert_refused(self.exec("SetPower", "much"), "is no Field=value", code=2)

    def test_info(self):
        out = self.assert_done(self.cli("reader", "info", "dock")).out
        self.assertRegex(out, r"(?m)^make +caen$")
        self.assertRegex(out, r"(?m)^firmware +\d")
        self.assertRegex(out, r"(?m)^frames +[1-9]")

    def test_watch(self):
        rows = self.assert_done(self.cli("reader", "watch", "dock", "--for", "1200ms", "--json")).json_lines()
        self.assertEqual([True, True], [row["connected"] for row in rows])
        self.assertGreater(rows[1]["reads"], rows[0]["reads"])
        self.assertRegex(self.assert_done(self.cli("reader", "watch", "dock", "--for", "100ms")).out,
                         r"^\d{4}-\S+Z  connected.*   reads \d+")

    def test_what_the_make_lacks_is_unsupported(self):
        self.assert_refused(self.cli("reader", "restart", "dock"), "unsupported")


class OverTheGateway(Verbs, WithVirtualReader):
    def setUp(self):
        self.running = self.dialling(self.reader())
        self.running.wait_for_events(1, "tag.read", tag=TAG)

    def cli(self, *arguments, **more):
        return self.running.cli(*arguments, **more)

    def test_a_command_is_missing(self):
        self.assert_refused(self.exec(), "COMMAND is missing", code=2)
        self.assert_refused(self.cli("tag", "read", "dock"), "TAG is missing", code=2)
        self.assert_refused(self.cli("gpio", "get"), "say which reader", code=2)

    def test_reading_stops_and_starts(self):
        self.assert_done(self.cli("reader", "stop", "dock"))
        wait_for(lambda: self.running.reader_info("dock").get("stopped"), "it is shown as stopped")
        self.running.wait_for_events(1, "tag.lost", tag=TAG)
        self.assert_done(self.cli("reader", "start", "dock"))
        self.running.wait_for_events(2, "tag.new" if self.running.events("tag.purged") else "tag.observed", tag=TAG)

    def test_jobs_are_listed_shown_and_cancelled(self):
        self.read(length=2)
        line, = [each for each in self.assert_done(self.cli("job", "list")).out.splitlines() if "tag.read" in each]
        self.assertRegex(line, r"^ +\d+  dock +tag\.read +done +\d{4}-\S+Z +\S")
        number = line.split()[0]
        shown = self.assert_done(self.cli("job", "show", number)).out
        self.assertRegex(shown, r"(?m)^status +done$")
        self.assert_refused(self.cli("job", "cancel", number), "had ended: done")
        self.assert_refused(self.cli("job", "show", "999999"), "there is no job 999999; see `gantry job list`")
        self.assert_refused(self.cli("job", "list", "--reader", "nope"), 'there is no reader "nope"')

    def waiting(self):
        """A command that waits for a reader that is away."""
        self.emulation.end()
        self.running.wait_for_events(1, "reader.disconnected")
        asking = self.under_way(self.running.begin("tag", "read", "dock", TAG, "--timeout", "60s"))
        find = lambda: [row for row in self.cli("job", "list", "--json").json_lines() if row["status"] == "queued"]
        return asking, wait_for(find, "the job waits")[0]

    def test_ctrl_c_takes_the_job_back(self):
        asking, job = self.waiting()
        self.assertEqual(130, asking.end(signal.SIGINT))
        self.assertRegex(asking.err.text(), "(?m)^gantry tag read: dock: cancelled; .*never sent")
        shown = json.loads(self.assert_done(self.cli("job", "show", job["id"], "--json")).out)
        self.assertEqual("cancelled", shown["status"])
        listed = self.assert_done(self.cli("job", "list")).out
        self.assertRegex(listed, r"(?m)^ +\d+  dock +tag\.read +cancelled .*\(.*never sent.*\)$")

    def test_the_id_is_read_without_asking_for_its_place(self):
        self.assertEqual(TAG + "\n", self.assert_done(self.tag("read", "--bank", "epc")).out)
        uri = "urn:epc:tag:sgtin-96:3.0614141.812345.6789"
        self.assertEqual(TAG + "\n", self.assert_done(self.tag("read", "--bank", "epc", tag=uri)).out)

    def test_tags_that_are_there_are_listed(self):
        head, row = self.assert_done(self.cli("tag", "list", "--reader", "do*")).out.splitlines()
        self.assertEqual(["TAG", "ZONE", "READER", "RSSI", "READS", "SINCE", "EPC"], head.split())
        self.assertRegex(row, rf"^{TAG}  dock  dock/Ant0 +-[\d.]+ dBm +\d+  .* urn:epc:id:sgtin:0614141\.812345\.6789$")
        tag, = self.assert_done(self.cli("tag", "list", "--zone", "dock", "--json")).json_lines()
        self.assertEqual((TAG, "dock", "dock", "Ant0"), tuple(tag[key] for key in ("tag", "zone", "reader", "antenna")))
        none = self.assert_done(self.cli("tag", "list", "--reader", "nope"))
        self.assertEqual("No tag is there now.\n", none.out)
        self.assertIn('the store knows no reader "nope"', none.err)
        none = self.assert_done(self.cli("events", "query", "--reader", "nope"))
        self.assertEqual("", none.out)
        self.assertIn('the store knows no reader "nope"', none.err)

    def test_what_was_done_is_said(self):
        self.assertEqual("output 1 on\n", self.assert_done(self.cli("gpio", "set", "dock", "1=on")).out)
        self.assertEqual("dock stopped: it stays so until `gantry reader start dock`\n",
                         self.assert_done(self.cli("reader", "stop", "dock")).out)
        self.assertEqual("dock reads\n", self.assert_done(self.cli("reader", "start", "dock")).out)
        locked = self.assert_done(self.tag("lock", "--field", "user=locked", "--field", "epc=locked", "--access-password", ACCESS))
        self.assertEqual(f"done: tag lock, tag {TAG}, user=locked, epc=locked\n", locked.out)
        info = self.assert_done(self.cli("reader", "info", "dock")).out
        self.assertEqual(1, len(re.findall(r"(?m)^reads ", info)))

    def test_a_job_that_waits_for_its_reader_is_cancelled(self):
        asking, job = self.waiting()
        self.assertIn("cancelled", self.assert_done(self.cli("job", "cancel", job["id"])).out)
        self.assertEqual(1, asking.wait())
        self.assertIn("dock: cancelled", asking.err.text())

    def test_no_password_is_kept(self):
        self.tag("lock", "--field", "user=locked", "--access-password", ACCESS)
        self.tag("kill", "--kill-password", KILL, "--yes")
        shown = self.cli("job", "list", "--json").out + self.cli("job", "list").out + self.running.log()
        self.assertNotIn(ACCESS, shown)
        self.assertNotIn(KILL, shown)
        self.running.stop()
        self.assertNotIn(KILL.encode(), self.running.db.read_bytes())

    def test_the_shell_asks_it_for_words(self):
        words = lambda *line: self.assert_done(run("completion", "words", "zsh", "--", *line)).out.split()
        place = ["--data-dir", str(self.running.data)]
        self.assertEqual(["dock"], words("reader", "info", *place, ""))
        self.assertEqual(["GetPower", "GetProtocol"], words("reader", "exec", *place, "dock", "GetP"))
        self.assertEqual(["Power"], words("reader", "config", "get", *place, "dock", "Po"))


class Directly(Verbs, WithVirtualReader):
    def setUp(self):
        self.address = self.reader()

    def cli(self, *arguments, **more):
        return run(*arguments, "--address", self.address, **more)

    def test_the_name_may_be_left_out(self):
        self.assertEqual("0011\n", self.assert_done(self.cli("tag", "read", TAG)).out)
        self.assertIn("PowerGet", self.assert_done(self.cli("reader", "exec", "GetPower")).out)
        self.assert_done(self.cli("reader", "exec", "SetPower", "PowerSet=400"))
        self.assertEqual("Power  400 mW\n", self.assert_done(self.cli("reader", "config", "get", "Power")).out)
        self.assert_done(self.cli("reader", "config", "set", "Power", "500"))
        self.assert_done(self.cli("gpio", "set", "1=on"))
        self.assert_done(self.cli("reader", "info"))

    def test_settings_of_the_make(self):
        self.assert_done(self.cli("reader", "exec", "GetPower", "--set", "power_mw=250"))
        self.assertEqual(250, self.state()["power_mw"])
        self.assert_refused(self.cli("reader", "exec", "GetPower", "--set", "powr_mw=250"), "--set powr_mw=250",
                            "power_mw")

    def test_a_reader_that_is_not_there(self):
        self.emulation.end()
        self.assert_refused(self.cli("gpio", "get"), self.address.removeprefix("caen://"), "connection refused")

    def test_an_address_that_is_none(self):
        self.assert_refused(run("gpio", "get", "--address", "cean://127.0.0.1"), "--address", 'did you mean "caen://"?')

    def test_one_that_does_not_answer(self):
        with socket.create_server(("127.0.0.1", 0)) as deaf:
            address = f"caen://127.0.0.1:{deaf.getsockname()[1]}"
            done = run("reader", "exec", "GetPower", "--address", address, "--timeout", "500ms")
            self.assert_refused(done, address)

    def test_ctrl_c_ends_the_wait(self):
        with socket.create_server(("127.0.0.1", 0)) as deaf:
            address = f"caen://127.0.0.1:{deaf.getsockname()[1]}"
            asking = self.under_way(Process(["reader", "exec", "GetPower", "--address", address, "--timeout", "60s"]))
            taken, _ = deaf.accept()
            with taken:
                taken.recv(1)
                self.assertEqual(130, asking.end(signal.SIGINT))
        self.assertRegex(asking.err.text(), r"(?m)^gantry reader exec: caen://\S+: (cancelled|unknown); \w")


class Confirmation(WithVirtualReader):
    def setUp(self):
        self.address = self.reader()

    def test_without_a_terminal_it_needs_a_word(self):
        place = ["--address", self.address]
        for command in (["kill", TAG, "--kill-password", KILL], ["lock", TAG, "--field", "epc=permanently_locked"],
                        ["lock", TAG, "--block", "20"]):
            self.assert_refused(run("tag", *command, *place), "cannot be undone", "add --yes", code=2)
        # A number is no reader's address.
        self.assert_refused(run("tag", "lock", "dock", TAG, "--address", "20"), "cannot be undone", "add --yes", code=2)
        self.assert_done(run("tag", "read", TAG, *place))

    def answer(self, word):
        """What comes of a kill when somebody types the word."""
        master, slave = pty.openpty()
        self.addCleanup(os.close, master)
        asking = self.under_way(Process(["tag", "kill", TAG, "--kill-password", KILL, "--address", self.address], stdin=slave))
        os.close(slave)
        wait_for(lambda: "[y/N]" in asking.err.text(), "it asks")
        self.assertIn(f"Kill tag {TAG} for ever?", asking.err.text())
        os.write(master, word.encode() + b"\n")
        return asking

    def test_at_a_terminal_it_asks(self):
        asking = self.answer("n")
        self.assertEqual(1, asking.wait())
        self.assertIn("nothing was done", asking.err.text())
        self.assert_done(run("tag", "read", TAG, "--address", self.address))
        self.assertEqual(0, self.answer("y").wait())
        self.assertEqual(1, run("tag", "read", TAG, "--retries", "0", "--address", self.address).code)

    def test_a_kill_needs_its_password(self):
        self.assert_refused(run("tag", "kill", TAG, "--yes", "--address", self.address), "kill password",
                            "GANTRY_KILL_PASSWORD", code=2)

    def test_a_wrong_password_is_not_repeated(self):
        done = run("tag", "read", TAG, "--access-password", "hunter2", "--address", self.address)
        self.assert_refused(done, "--access-password", "8 hex digits", code=2)
        self.assertNotIn("hunter2", done.err)


class Emulate(WithVirtualReader):
    def test_each_of_several_says_where_it_listens(self):
        emulation = self.emulate("--count", "3")
        lines = wait_for(lambda: len(found := emulation.out.lines()) >= 3 and found, "three lines")
        self.assertEqual(3, len({re.fullmatch(r"listening on (127\.0\.0\.1:\d+)", line)[1] for line in lines}))

    def test_ports_count_up_from_the_one_that_was_given(self):
        def begun():
            with socket.create_server(("127.0.0.1", 0)) as any_port:
                first = any_port.getsockname()[1]
            emulation = self.emulate("--count", "2", "--listen", f"127.0.0.1:{first}", "--json")
            wait_for(lambda: len(emulation.out.lines()) >= 2 or not emulation.running(), "they listen, or not")
            return first, [json.loads(line)["listening"] for line in emulation.out.lines()[:2]]
        # Somebody else may have taken the second.
        first, places = wait_for(lambda: (found := begun()) and len(found[1]) == 2 and found, "two free ports")
        self.assertEqual([f"127.0.0.1:{first}", f"127.0.0.1:{first + 1}"], places)

    def test_ways_that_it_cannot_go(self):
        self.assert_refused(run("emulate", "caen", "--connect", "127.0.0.1:1"), "--listen HOST:PORT", code=2)
        self.assert_refused(run("emulate", "caen", "--listen", "127.0.0.1:65535", "--count", "2"), "65535", code=2)
        self.assert_refused(run("emulate", "caen", "--model", "R9999"), "--model R9999", code=2)

    def test_a_model(self):
        address = self.reader("--model", "R4300P")
        self.assertIn("R4300P", self.assert_done(run("reader", "info", "--address", address)).out)

    def test_a_gateway_reads_it_and_reads_on_after_it_was_away(self):
        gateway = self.dialling(self.reader())
        gateway.wait_for_events(1, "tag.observed", tag=TAG, antenna="Ant0", zone="dock")
        self.emulation.say("drop")
        gateway.wait_for_events(1, "reader.disconnected")
        gateway.wait_for_events(2, "reader.connected")
        last = gateway.status()["last_seq"]
        wait_for(lambda: any(row["seq"] > last for row in gateway.events("tag.read")), "reads again")

    def test_pc_and_xpc_reach_the_store(self):
        sensor, plain = TAG, OTHER
        tags = f"epc,user,xpc\n{sensor},{USER},0800\n{plain},,\n"
        for more in ("", 'mode = "inventory"\nsources = "Source_0"\n', "compact = true\n"):
            with self.subTest(more):
                gateway = self.dialling(self.reader("--model", "R1260I", tags=tags), "xpc = true\npc = true\n" + more)
                for kind in ("tag.read", "tag.observed"):
                    seen = {tag: gateway.wait_for_events(1, kind, tag=tag)[0] for tag in (sensor, plain)}
                    # User memory and XPC have their bits in the PC; a tag that sends no XPC has none.
                    self.assertEqual(("3600", "0800"), (seen[sensor]["pc"], seen[sensor]["xpc"]))
                    self.assertEqual(("3000", None), (seen[plain]["pc"], seen[plain].get("xpc")))
                    self.assertEqual(seen[sensor], gateway.query("--type", kind, "--tag", sensor)[0])
                there = {row["tag"]: (row["pc"], row.get("xpc")) for row in gateway.present()}
                self.assertEqual({sensor: ("3600", "0800"), plain: ("3000", None)}, there)
                listed = {row["tag"]: row.get("xpc") for row in
                          self.assert_done(gateway.cli("tag", "list", "--json")).json_lines()}
                self.assertEqual({sensor: "0800", plain: None}, listed)
                self.assertRegex(self.assert_done(gateway.cli("events", "query", "--tag", sensor)).out, "  pc 3600  xpc 0800  ")
                gateway.stop()
                self.emulation.end()
        gateway = self.dialling(self.reader(tags=tags))
        seen, *_ = gateway.wait_for_events(1, "tag.observed", tag=sensor)
        self.assertNotIn("pc", seen)  # nobody asked

    def test_a_serial_line(self):
        link = self.directory() / "ttyR0"
        emulation = self.emulate("--tags", self.tags(), "--pty", link)
        emulation.wait_for_line(f"^listening on {link}$")
        address = f"caen+serial://{link}?baud=115200"
        self.assertEqual(USER[:16] + "\n", self.assert_done(run("tag", "read", TAG, "--length", "4", "--address", address)).out)
        gateway = self.dialling(address)
        gateway.wait_for_events(1, "tag.observed", tag=TAG)
        gateway.stop()
        self.assertEqual(0, emulation.end())
        self.assertFalse(link.is_symlink())


class Completion(WithVirtualReader):
    """No reader needs to be there: its address says which make it is."""

    def words(self, *line):
        return self.assert_done(run("completion", "words", "fish", "--", *line)).out.split()

    def exec(self, *line):
        return self.words("reader", "exec", "--address", "caen://127.0.0.1:1", *line)

    def test_commands_fields_and_values(self):
        self.assertEqual(["GetPower", "GetProtocol"], self.exec("GetP"))
        self.assertEqual(["GetPower", "GetProtocol"], self.exec("dock", "GetP"))
        self.assertEqual(["SourceName=", "ConfigParameter=", "ConfigValue="], self.exec("SetSourceConfig", ""))
        self.assertEqual(["ConfigParameter=", "ConfigValue="], self.exec("SetSourceConfig", "SourceName=Source_0", ""))
        self.assertIn("ConfigParameter=G2Session", self.exec("SetSourceConfig", "ConfigParameter=G2"))

    def test_parameters(self):
        config = ["reader", "config", "set", "--address=caen://127.0.0.1:1"]
        self.assertEqual(["Power"], self.words(*config, "Po"))
        self.assertIn("EPCC1G2", self.words(*config, "Protocol", ""))

    def test_nobody_is_there_and_nothing_is_offered(self):
        nowhere = self.directory()
        self.assertEqual([], self.words("reader", "info", "--data-dir", nowhere, ""))
        self.assertEqual([], self.words("reader", "exec", "--data-dir", nowhere, "dock", ""))

    def test_bash_itself(self):
        script = run("completion", "bash").out
        line = "gantry reader exec --address caen://127.0.0.1:1 SetSourceConfig ConfigParameter=G2S"
        # bash cuts at = and :
        words = ["gantry", "reader", "exec", "--address", "caen", ":", "//127.0.0.1", ":", "1", "SetSourceConfig",
                 "ConfigParameter", "=", "G2S"]
        quoted = " ".join(f"'{word}'" for word in [BINARY, *words[1:]])
        script += (f"\nCOMP_LINE='{line}'; COMP_POINT={len(line)}; COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; "
                   "_gantry; printf '%s\\n' \"${COMPREPLY[@]}\"")
        done = subprocess.run(["bash", "--norc", "-u", "-c", script], capture_output=True, text=True, check=True,
                              timeout=DEADLINE)
        self.assertEqual("", done.stderr)
        self.assertIn("G2Session ", done.stdout.splitlines())


if __name__ == "__main__":
    unittest.main()
