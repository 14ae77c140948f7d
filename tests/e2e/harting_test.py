"""HARTING readers: a virtual RF-R400 and the gateway, in all ways of working, and every verb over it."""

import os
import random
import signal
import time
import tomllib
import unittest

from gantry_e2e import EVERY_READ, wait_for
from virtual_reader import ACCESS, KILL, OTHER, TAG, USER, WithVirtualReader, directly

SOON = 'valid_time = "100ms"\npoll = "20ms"\n'  # every read is a data set, and is fetched at once
NOTIFY = 'notify = "127.0.0.1:0"\nkeepalive = "1s"\n'


class WithHarting(WithVirtualReader):
    make = "harting"

    def say(self, line):
        self.emulation.say(line)

    def now(self, key):
        return self.state()[key]


# --- the ways of reading ---------------------------------------------------------------------------------------

class Ways(WithHarting):
    def reads(self, more, mode, *arguments):
        gateway = self.dialling(self.reader(*arguments), more)
        seen, *_ = gateway.wait_for_events(3, "tag.read", tag=TAG)
        self.assertEqual(("ANT1", "epc-gen2"), (seen["antenna"], seen["technology"]))
        self.assertLess(-90, seen["rssi_dbm"])
        self.assertEqual(mode, self.now("mode"))
        return gateway

    def test_host_commands(self):
        gateway = self.reads('mode = "host"\n' + SOON, "Host")
        self.assertGreater(self.now("inventory_tags"), 0)
        gateway.wait_for_events(1, "tag.observed", tag=TAG, zone="dock", antenna="ANT1")

    def test_pc_and_xpc(self):
        address = self.reader(tags=f"epc,xpc\n{TAG},8001\n{OTHER},\n")
        for mode in ("host", "buffered"):
            gateway = self.dialling(address, f'mode = "{mode}"\n' + SOON)
            seen = {tag: gateway.wait_for_events(1, "tag.observed", tag=tag)[0] for tag in (TAG, OTHER)}
            self.assertEqual(("3A00", "8001"), (seen[TAG]["pc"], seen[TAG]["xpc"]))
            self.assertEqual(("3000", None), (seen[OTHER]["pc"], seen[OTHER].get("xpc")))
            gateway.stop()

    def test_buffered_read(self):
        gateway = self.reads(SOON, "BufferedRead")
        wait_for(lambda: self.now("sets_cleared") > 2, "sets are cleared")
        info = self.assert_done(gateway.cli("reader", "info", "dock")).out
        self.assertRegex(info, r"CFG1\.MODE from Host to BufferedRead")  # it says what it changed

    def test_notification_with_acknowledgement(self):
        self.reads(NOTIFY + SOON, "Notification")
        wait_for(lambda: self.now("sets_acked") > 2 and self.now("keepalives") > 0, "acknowledged, and kept alive")

    def test_notification_without_acknowledgement(self):
        self.reads(NOTIFY + SOON + "acknowledge = false\n", "Notification", "--set", "keepalive=new")
        wait_for(lambda: self.now("keepalives") > 0, "kept alive")
        self.assertEqual(0, self.now("acks"))

    def test_a_reader_that_dials_in_with_notifications_alone(self):
        gateway = self.gateway('[[reader]]\nname = "dock"\naddress = "harting-listen://127.0.0.1:0"\nzone = "dock"\n' + EVERY_READ)
        config = "CFG1.MODE=Notification,CFG12.TRANSPONDER-VALID-TIME=1,CFG11.TR-DATA1=0xF1,CFG11.TR-DATA2=0x10"
        self.emulation = self.emulate("--tags", self.tags(), "--connect", f"127.0.0.1:{gateway.port}", "--set", f"config={config}")
        gateway.wait_for_events(3, "tag.read", reader="dock", tag=TAG, antenna="ANT1")
        wait_for(lambda: self.now("sets_acked") > 2, "acknowledged")
        self.assert_refused(gateway.cli("tag", "read", "dock", TAG), "unsupported")

    def test_scan_mode_over_a_serial_line(self):
        link = self.directory() / "ttyR0"
        self.emulation = self.emulate("--tags", self.tags(), "--pty", link, "--set", "byte_gap=2s")
        self.emulation.wait_for_line(f"^listening on {link}$")
        address = f"harting+serial://{link}"
        self.assertEqual(USER[:16] + "\n", self.assert_done(directly(address, "tag", "read", TAG, "--length", "4")).out)
        gateway = self.dialling(address, 'mode = "scan"\n')
        gateway.wait_for_events(2, "tag.read", tag=TAG)
        self.assertEqual("Scan", self.now("mode"))
        self.assertEqual(USER[:16] + "\n", self.assert_done(gateway.cli("tag", "read", "dock", TAG, "--length", "4")).out)
        last = gateway.status()["last_seq"]
        wait_for(lambda: any(row["seq"] > last for row in gateway.events("tag.read")), "it reads on")

    def test_data_blocks_and_input_events_come_with_the_tags(self):
        gateway = self.reads(SOON + 'data_bank = "user"\ndata_blocks = 3\ninput_events = "on"\n', "BufferedRead")
        read = gateway.wait_for_events(1, "tag.read", tag=TAG)[0]
        self.assertIn(USER[:12], read["data"])
        self.say("input 2=1")
        gateway.wait_for_events(1, "gpi.changed", input=2, state=1)

    def test_a_full_buffer_is_an_overflow_event(self):
        gateway = self.reads(SOON, "BufferedRead", "--set", "buffer=5")
        gateway.process.send_signal(signal.SIGSTOP)
        wait_for(lambda: self.now("overflow"), "the buffer is full")
        gateway.process.send_signal(signal.SIGCONT)
        gateway.wait_for_events(1, "overflow", reader="dock")

    def test_a_reader_that_restarts_is_set_up_again(self):
        gateway = self.reads(SOON, "BufferedRead", "--set", "boot=100ms")
        self.say("restart")
        wait_for(lambda: self.now("restarts") == 1 and self.now("mode") == "BufferedRead", "it is set up again")
        last = gateway.status()["last_seq"]
        wait_for(lambda: any(row["seq"] > last for row in gateway.events("tag.read")), "it reads on")


# --- verbs -----------------------------------------------------------------------------------------------------

class Verbs:
    """What works over a gateway and without one; `cli` runs a command about the reader `dock`."""

    def tag(self, verb, *arguments, tag=TAG, **more):
        return self.cli("tag", verb, "dock", tag, *arguments, **more)

    def read(self, *arguments, **more):
        return self.assert_done(self.tag("read", *arguments, **more)).out.strip()

    def exec(self, *arguments):
        return self.cli("reader", "exec", "dock", *arguments)

    def test_tags_are_read_written_locked_programmed_and_killed(self):
        self.assertEqual(USER, self.read("--bank", "user", "--length", "8"))
        self.assert_done(self.tag("write", "--data", "CAFE BABE", "--offset", "1"))
        self.assertEqual("0011CAFEBABE6677", self.read("--length", "4"))
        self.assert_done(self.tag("lock", "--field", "user=locked", "--access-password", ACCESS))
        refused = self.tag("write", "--data", "FFFF", "--retries", "0")
        self.assert_refused(refused, "failed", "locked")
        self.assert_done(self.tag("write", "--data", "FFFF", "--access-password", ACCESS))
        self.assert_done(self.tag("program", OTHER))
        self.assertEqual("FFFF", self.read("--length", "1", tag=OTHER))
        self.assert_refused(self.tag("read", "--retries", "0"), "failed")
        self.assert_refused(self.tag("kill", "--kill-password", "00000007", "--yes", tag=OTHER), "failed")
        self.assert_done(self.tag("kill", "--kill-password", KILL, "--yes", tag=OTHER))
        self.assertEqual(1, self.tag("read", "--retries", "0", tag=OTHER).code)
        wait_for(lambda: self.now("mode") == self.mode, "it is back in its way of reading")

    def test_inputs_and_outputs(self):
        self.say("input 2=1")
        inputs = lambda: self.assert_done(self.cli("gpio", "get", "dock")).out.splitlines()
        wait_for(lambda: inputs()[:2] == ["input 1: off", "input 2: on"], "the input is seen")
        self.assert_done(self.cli("gpio", "set", "dock", "1=on", "3=on"))
        self.assertEqual("on off on", self.now("outputs"))

    def test_commands_by_their_names(self):
        out = self.assert_done(self.exec("GetReaderInfo", "MODE=0")).out
        self.assertRegex(out, r"(?m)^RX-BUF +2048")
        out = self.assert_done(self.exec("ReadConfiguration", "CFG-ADR=0x0C")).out
        self.assertRegex(out, r"(?m)^CFG.* 00")
        self.assert_refused(self.exec("GetReadrInfo"), "did you mean GetReaderInfo?")
        self.assert_refused(self.exec("InitializeBuffer"), "--yes", code=2)
        self.assert_done(self.exec("SetSystemTimer", "HOUR=12", "MINUTE=30", "MILLISECONDS=1500"))

    def config(self, verb, *arguments, **more):
        return self.cli("reader", "config", verb, "dock", *arguments, **more)

    def value(self, name, *arguments):
        return self.assert_done(self.config("get", name, *arguments)).out.split()[1]

    def test_a_parameter_has_a_value_at_work_and_a_stored_one(self):
        before = self.value("CFG20.RSSI-FILTER-2")
        self.assertEqual("0", before)
        self.assert_done(self.config("set", "CFG20.RSSI-FILTER-2", "70"))
        self.assertEqual(("70", "0"), (self.value("CFG20.RSSI-FILTER-2"), self.value("CFG20.RSSI-FILTER-2", "--permanent")))
        self.assert_done(self.config("set", "CFG20.RSSI-FILTER-3", "60", "--permanent"))
        self.assertEqual(("60", "60"), (self.value("CFG20.RSSI-FILTER-3"), self.value("CFG20.RSSI-FILTER-3", "--permanent")))
        # What is written to EEPROM leaves what is at work beside it.
        self.assertEqual("70", self.value("CFG20.RSSI-FILTER-2"))
        self.assertEqual(self.mode, self.now("mode"))
        self.say("power off")
        self.say("power on")
        wait_for(lambda: self.config("get", "CFG20.RSSI-FILTER-2", "--timeout", "1s").code == 0, "it is on again")
        self.assertEqual(("0", "60"), (self.value("CFG20.RSSI-FILTER-2"), self.value("CFG20.RSSI-FILTER-3")))
        self.assert_refused(self.config("set", "CFG1.COM-ADR", "255"), "CFG1.COM-ADR", "0 to 254")
        self.assert_refused(self.config("set", "CFG1.MODES", "Host"), "did you mean CFG1.MODE?")
        self.assert_refused(self.config("set", "CFG13.END-USER", "0x0D"), "CFG13.END-USER", "hex digits")
        self.assert_refused(self.config("get", "CFG0.PASSWORD"), "never read")

    def test_all_parameters_as_a_file(self):
        text = self.assert_done(self.config("dump")).out
        values = tomllib.loads(text)
        self.assertEqual(self.mode, values["CFG1"]["MODE"])
        self.assertNotIn("RAW", values["CFG1"])
        self.assertRegex(text, r"(?m)^# RAW = \"[0-9A-F]{28}\"")
        self.assertRegex(text, r"(?m)^# Left out, because it is secret: CFG0\.PASSWORD$")
        self.assertIn("RAW", values["CFG63"])  # nobody has published what is in it
        path = self.directory() / "dock.toml"
        path.write_text(text)
        self.assert_done(self.config("diff", path))
        changed = text.replace("RSSI-FILTER-4 = 0", "RSSI-FILTER-4 = 66").replace('BAUD = "38400"', "BAUD = 115200")
        changed = changed.replace('KEEPALIVE = "on"', "KEEPALIVE = false")
        path.write_text(changed)
        done = self.config("diff", path)
        self.assertEqual(1, done.code)
        self.assertRegex(done.out, r"(?m)^CFG20\.RSSI-FILTER-4 +0 +66$")
        self.assertRegex(done.out, r"(?m)^CFG1\.BAUD +38400 +115200$")
        self.assertRegex(done.out, r"(?m)^CFG41\.KEEPALIVE +on +off$")

    def test_a_file_is_applied_to_the_eeprom_and_the_reader_restarted(self):
        path = self.directory() / "dock.toml"
        path.write_text('[CFG1]\nTR-RESPONSE-TIME = 77\nCOM-ADR = 0\n[CFG63]\nRAW = "000102030405060708090A0B0C0D"\n'
                        '[CFG22]\nMASK = "E280"\nMASK-LENGTH = 0\n[CFG0]\nPASSWORD = "C0DEC0DE"\n')
        done = self.assert_done(self.config("apply", path, "--permanent"))
        self.assertRegex(done.out, r"(?m)^CFG1\.TR-RESPONSE-TIME: 30 -> 77$")
        self.assertRegex(done.out, r"(?m)^after `gantry reader restart`: CFG1\.TR-RESPONSE-TIME$")
        self.assertNotIn("C0DEC0DE", done.out + done.err)
        self.assertNotIn("COM-ADR", done.out)
        self.assertEqual("77", self.value("CFG1.TR-RESPONSE-TIME", "--permanent"))
        path.write_text("[CFG1]\nTR-RESPONSE-TIME = 78\n")
        done = self.assert_done(self.config("apply", path, "--permanent", "--restart"))
        self.assertIn("restarts, for CFG1.TR-RESPONSE-TIME", done.out)
        wait_for(lambda: self.now("restarts") == 1, "it restarts")
        wait_for(lambda: self.config("get", "CFG1.TR-RESPONSE-TIME").code == 0, "it is back")
        self.assertEqual("78", self.value("CFG1.TR-RESPONSE-TIME"))


class OverTheGateway(Verbs, WithHarting):
    mode = "BufferedRead"

    def setUp(self):
        self.running = self.dialling(self.reader("--set", "boot=100ms"), SOON)
        self.running.wait_for_events(1, "tag.read", tag=TAG)

    def cli(self, *arguments, **more):
        return self.running.cli(*arguments, **more)

    def test_no_password_is_kept(self):
        self.assert_done(self.config("set", "CFG0.PASSWORD", "DEADBEEF"))
        self.tag("kill", "--kill-password", KILL, "--yes")
        shown = self.cli("job", "list", "--json").out + self.cli("job", "list").out + self.running.log()
        for secret in ("DEADBEEF", KILL):
            self.assertNotIn(secret, shown)
        self.running.stop()
        self.assertFalse([path for path in self.running.data.iterdir() if path.is_file() and b"DEADBEEF" in path.read_bytes()])

    def test_reading_stops_and_starts(self):
        self.assert_done(self.cli("reader", "stop", "dock"))
        wait_for(lambda: self.now("mode") == "Host", "it rests")
        self.assert_done(self.cli("reader", "start", "dock"))
        wait_for(lambda: self.now("mode") == "BufferedRead", "it reads")


class Directly(Verbs, WithHarting):
    """The reader works for somebody else meanwhile, and goes on with that."""
    mode = "Notification"

    def setUp(self):
        self.address = self.reader("--set", "boot=100ms", "--set", "config=CFG1.MODE=Notification")

    def cli(self, *arguments, **more):
        return directly(self.address, *arguments, **more)


# --- nothing is lost -------------------------------------------------------------------------------------------

class Kills(WithHarting):
    """The reader's own books against the store's, while the gateway is killed at random instants."""

    def site(self, more, **others):
        tags = "epc\n" + "".join(f"3074257BF7194E40000{number:05X}\n" for number in range(8))
        address = self.reader("--set", "redial=50ms", "--set", "repeat=200ms", tags=tags)
        return self.dialling(address, more + SOON, **others)

    def kill(self, gateway):
        """After the kill: what the reader has forgotten, and what is in the store."""
        time.sleep(random.uniform(0, 0.4))  # the instant is the point
        gateway.kill()
        state = self.state()
        return state["sets_cleared"], gateway.reads_of()

    def books_agree(self, more):
        gateway = self.site(more)
        gateway.wait_for_events(8, "tag.read")
        for _ in range(8):
            forgotten, stored = self.kill(gateway)
            self.assertLessEqual(forgotten, stored)
            gateway.start()
        self.say("antenna 1=bad")  # it hears nothing any more
        settled = lambda: (state := self.state())["buffered"] == 0 and not state["waiting_for_ack"] and state
        state = wait_for(settled, "all is taken")
        self.assertEqual(0, state["sets_overflowed"])
        self.assertEqual(state["sets_stored"], state["sets_cleared"])
        self.assertEqual(state["sets_stored"], gateway.reads_of())

    def would_be_noticed(self, more):
        gateway = self.site(more, env={"GANTRY_FAILPOINT": "ack_before_commit,slow_commit"})
        gateway.wait_for_events(1, "tag.read")
        for _ in range(30):
            forgotten, stored = self.kill(gateway)
            if forgotten > stored:
                return
            gateway.start()
        self.fail("thirty kills, and nothing was lost")

    def test_what_was_cleared_is_in_the_store_once(self):
        self.books_agree("")

    def test_what_was_acknowledged_is_in_the_store_once(self):
        self.books_agree(NOTIFY)

    @unittest.skipUnless(os.environ.get("GANTRY_FAILPOINTS"), "needs a build with failpoints")
    def test_a_clear_before_the_commit_would_be_noticed(self):
        self.would_be_noticed("")

    @unittest.skipUnless(os.environ.get("GANTRY_FAILPOINTS"), "needs a build with failpoints")
    def test_an_acknowledgement_before_the_commit_would_be_noticed(self):
        self.would_be_noticed(NOTIFY)


if __name__ == "__main__":
    unittest.main()
