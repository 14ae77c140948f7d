"""Serial lines, for every make that has one: pseudo-terminals with a virtual reader at the other end."""

import fcntl
import json
import os
import pty
import select
import shutil
import signal
import struct
import subprocess
import threading
import time
import tty
import unittest
from pathlib import Path

from gantry_e2e import BINARY, DEADLINE, EVERY_READ, Done, EndToEnd, Process, Store, run, wait_for

# Scheme, and what the virtual reader needs; a slow machine must not look like a broken character.
MAKES = {
    "caen": ("caen+serial", []),
    "silion": ("silion+serial", ["--set", "batch=200ms", "--set", "heartbeat=1s"]),
    "harting": ("harting+serial", ["--set", "byte_gap=2s"]),
    "dagprog": ("dagprog", []),
}
NOBODY = 65534
AS_NOBODY = ["setpriv", "--reuid", str(NOBODY), "--regid", str(NOBODY), "--clear-groups"]
CAN_BE_NOBODY = os.geteuid() == 0 and shutil.which("setpriv")
TCGETS2 = 0x802C542A


def speed_of(line):
    """What the kernel was told, also where the speed has no constant."""
    terminal = os.open(line, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        *_, reads, writes = struct.unpack("4I20B2I", fcntl.ioctl(terminal, TCGETS2, bytes(44)))
    finally:
        os.close(terminal)
    return reads, writes


class Cable(threading.Thread):
    """Between a virtual reader's line and a line of its own: lets bytes through one by one, or in bundles as a USB
    adapter does that fills its packets."""

    def __init__(self, far, near, bundle=0.0):
        super().__init__(daemon=True)
        self._bundle, self._ending = bundle, threading.Event()
        self._far = os.open(far, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._far)
        self._near, self._kept = pty.openpty()
        tty.setraw(self._near)
        Path(near).symlink_to(os.ttyname(self._kept))
        self.start()

    def run(self):
        others = {self._far: self._near, self._near: self._far}
        while not self._ending.is_set():
            for end in select.select(list(others), [], [], 0.1)[0]:
                if self._bundle:
                    time.sleep(self._bundle)
                    os.write(others[end], os.read(end, 4096))
                else:
                    os.write(others[end], os.read(end, 1))

    def pull(self):
        self._ending.set()
        self.join(DEADLINE)
        for end in (self._far, self._near, self._kept):
            os.close(end)


class Lines(EndToEnd):
    def emulate(self, make, line, *arguments):
        emulation = self.under_way(Process(["emulate", make, "--pty", line, *arguments], stdin=subprocess.PIPE))
        emulation.wait_for_line(f"^listening on {line}$")
        return emulation

    def state(self, reader):
        before = len(reader.out.lines())
        reader.say("state")
        return json.loads(wait_for(lambda: reader.out.lines()[before:], "its state")[0])

    def emulate_all(self, home):
        return {make: self.emulate(make, home / make, *more) for make, (_, more) in MAKES.items()}

    def section(self, name, scheme, line, more=""):
        return f'[[reader]]\nname = "{name}"\naddress = "{scheme}://{line}"\n{more}'

    def reading(self, lines):
        return self.gateway("".join(self.section(make, MAKES[make][0], line) for make, line in lines.items()) + EVERY_READ)

    def read_by_all(self, gateway, after=0):
        for make in MAKES:
            wait_for(lambda: any(row["seq"] > after for row in gateway.events("tag.read", reader=make)),
                     lambda: f"{make} reads; {gateway.cli('reader', 'list').out}")


class NobodyThere(Lines):
    """Lines that open and stay silent, as when the cable is not in the reader."""

    def silent_line(self):
        master, line = pty.openpty()
        for end in (master, line):
            tty.setraw(end)
            self.addCleanup(os.close, end)
        return os.ttyname(line)

    def test_a_command_says_that_nobody_answers(self):
        for scheme, _ in MAKES.values():
            for command in (["reader", "info"], ["gpio", "get"]):
                done = run(*command, "--address", f"{scheme}://{self.silent_line()}", "--timeout", "1s")
                if "has no" in done.err or "cannot" in done.err:  # nothing that this make has
                    self.assertNotEqual(["reader", "info"], command, done.err)
                    continue
                self.assert_refused(done, "nobody answers on the line")

    def test_a_gateway_counts_it_as_not_connected(self):
        gateway = self.reading({make: self.silent_line() for make in MAKES})
        for make in ("dagprog", "harting"):
            gateway.wait_for_message(f"{make}: it takes the connection and says nothing")
        self.assertEqual([], gateway.events("reader.connected"))
        self.assertEqual([False] * len(MAKES), [gateway.reader_info(make)["connected"] for make in MAKES])


class OneLineOneReader(Lines):
    def test_a_line_in_use_is_not_taken(self):
        line = self.directory() / "line"
        first = self.emulate("caen", line)
        self.assert_refused(run("emulate", "caen", "--pty", line, "--for", "1s"), f"the link {line}", "which is in use")
        self.assertTrue(line.is_symlink())
        self.assertEqual(0, first.end())
        self.assertFalse(line.is_symlink())

    def test_what_one_has_left_that_was_killed_is_replaced(self):
        line = self.directory() / "line"
        self.emulate("caen", line).end(signal.SIGKILL)
        wait_for(lambda: line.is_symlink() and not line.exists(), "its terminal is gone")
        self.emulate("caen", line)
        self.assertTrue(line.exists())


class EveryMake(Lines):
    def test_what_happens_once_waits_for_whoever_opens_the_line(self):
        home = self.directory()
        faults = ["--fault", "garbage 64", "--fault", "reboot"]
        readers = {make: self.emulate(make, home / make, *more, *faults) for make, (_, more) in MAKES.items()}
        for reader in readers.values():
            state = self.state(reader)
            self.assertEqual((False, 0, 0), (state["connected"], state["state"]["connects"], state["state"]["restarts"]))
        gateway = self.reading({make: home / make for make in MAKES})
        for make, reader in readers.items():
            signs = lambda: gateway.reader_info(make)["counters"]
            wait_for(lambda: signs()["skipped_bytes"] + signs()["malformed"] + signs()["unknown_code"] > 0, f"{make} saw garbage")
            wait_for(lambda: self.state(reader)["state"]["restarts"] == 1, f"{make} has restarted")
            self.assertTrue(self.state(reader)["connected"])
        self.read_by_all(gateway, gateway.status()["last_seq"])
        gateway.stop()
        for reader in readers.values():
            wait_for(lambda: not self.state(reader)["connected"], "nobody has the line open any more")

    def test_a_line_that_is_pulled_out_comes_back_by_its_id(self):
        home = self.directory()
        readers = self.emulate_all(home)
        by_id = home / "by-id"
        by_id.mkdir()
        lines = {make: by_id / f"usb-{make}" for make in MAKES}
        for make, line in lines.items():
            line.symlink_to(f"../{make}")
        gateway = self.reading(lines)
        self.read_by_all(gateway)
        for reader in readers.values():
            reader.end()
        for make in MAKES:
            self.assertIn("the serial line is gone",
                          gateway.wait_for_events(1, "reader.disconnected", reader=make)[0]["reason"])
        wait_for(lambda: gateway.cli("reader", "list").out.count("there is no such device") == len(MAKES),
                 "each says what is missing")
        last = gateway.status()["last_seq"]
        self.emulate_all(home)
        for make in MAKES:
            gateway.wait_for_events(2, "reader.connected", reader=make)
        self.read_by_all(gateway, last)

    def through_cables(self, bundle):
        home = self.directory()
        self.emulate_all(home)
        lines = {make: home / f"{make}-near" for make in MAKES}
        for make, line in lines.items():
            self.addCleanup(Cable(home / make, line, bundle).pull)
        self.read_by_all(self.reading(lines))

    def test_bytes_that_drip_in_one_by_one(self):
        self.through_cables(0.0)

    def test_an_adapter_that_holds_bytes_back(self):
        self.through_cables(0.016)

    def test_a_second_program_is_told_who_has_the_line(self):
        home = self.directory()
        self.emulate_all(home)
        gateway = self.reading({make: home / make for make in MAKES})
        self.read_by_all(gateway)
        for make, (scheme, _) in MAKES.items():
            done = run("reader", "info", "--address", f"{scheme}://{home / make}")
            self.assert_refused(done, "it is busy", f"gantry (process {gateway.process.pid}) has it")

    def test_at_an_odd_speed(self):
        home = self.directory()
        for make, (_, more) in MAKES.items():
            self.emulate(make, home / make, "--baud", "14400", *more)
        toml = "".join(self.section(make, MAKES[make][0], f"{home / make}?baud=14400&parity=odd") for make in MAKES)
        self.read_by_all(self.gateway(toml + EVERY_READ))
        self.assertEqual({(14400, 14400)}, {speed_of(home / make) for make in MAKES})

    def test_the_usual_speed_of_each(self):
        home = self.directory()
        self.emulate_all(home)
        self.read_by_all(self.reading({make: home / make for make in MAKES}))
        speeds = {make: speed_of(home / make)[1] for make in MAKES}
        self.assertEqual({"caen": 115200, "silion": 115200, "harting": 38400, "dagprog": 38400}, speeds)

    def test_a_drop_pulls_the_line_out(self):
        home = self.directory()
        readers = self.emulate_all(home)
        gateway = self.reading({make: home / make for make in MAKES})
        self.read_by_all(gateway)
        for reader in readers.values():
            reader.say("drop")
        for make in MAKES:
            gone, = gateway.wait_for_events(1, "reader.disconnected", reader=make)
            self.assertIn("the serial line is gone", gone["reason"])
            gateway.wait_for_events(2, "reader.connected", reader=make)
        self.read_by_all(gateway, gateway.status()["last_seq"])


@unittest.skipUnless(CAN_BE_NOBODY, "only root can become another user")
class WithoutPermission(Lines):
    def setUp(self):
        self.home = self.directory()
        os.chmod(self.home, 0o755)
        self.emulate_all(self.home)
        for make in MAKES:
            os.chmod(self.home / make, 0o600)
        self.binary = self.home / "gantry"
        shutil.copy(BINARY, self.binary)  # where anybody can run it
        os.chmod(self.binary, 0o755)

    def test_a_command_says_what_to_do(self):
        for make, (scheme, _) in MAKES.items():
            line = self.home / make
            command = [*AS_NOBODY, self.binary, "reader", "info", "--address", f"{scheme}://{line}"]
            ended = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False, cwd="/")
            self.assert_refused(Done(ended.returncode, ended.stdout, ended.stderr), f"cannot open {line}: permission denied",
                                f"sudo chgrp dialout {line}", "sudo usermod -aG dialout nobody")

    def test_a_gateway_says_what_to_do_and_begins_when_it_may(self):
        data = self.home / "data"
        data.mkdir()
        os.chown(data, NOBODY, NOBODY)
        config = self.home / "gantry.toml"
        config.write_text(f'[gateway]\nid = "nobody"\ndata_dir = "{data}"\n{EVERY_READ}' + "".join(
            self.section(make, scheme, self.home / make) for make, (scheme, _) in MAKES.items()))
        gateway = self.under_way(Process(["run", "-c", config], cwd="/", command=[*AS_NOBODY, self.binary]))
        gateway.wait_for_line("^ready$")
        for make in MAKES:
            wait_for(lambda: f"cannot open {self.home / make}: permission denied; it is for no group" in gateway.err.text(),
                     lambda: f"{make} says it; {gateway.err.text()}")
            os.chmod(self.home / make, 0o666)
        store = Store(data / "gantry.db")
        self.addCleanup(store.close)
        for make in MAKES:
            wait_for(lambda: store.number("SELECT count(*) FROM events WHERE type = 'tag.read' AND reader = ?", make),
                     f"{make} reads")
        self.assertEqual(0, gateway.end())


class Silion(Lines):
    def test_every_way_to_compute_a_checksum(self):
        home = self.directory()
        toml = ""
        ways = {  # reader, gateway
            "found-modbus": ("modbus", "auto"), "found-swapped": ("modbus-swapped", "auto"),
            "found-ccitt": ("ccitt", "auto"), "given-ccitt": ("ccitt", "ccitt"), "wrong": ("ccitt", "modbus"),
        }
        readers = {}
        for name, (sent, expected) in ways.items():
            # Generation 2 reads the checksum of what it gets, so an answer shows that ours is right, too.
            readers[name] = self.emulate("silion", home / name, "--set", f"crc={sent}", *MAKES["silion"][1])
            toml += self.section(name, "silion+serial", home / name, f'crc = "{expected}"\n')
        gateway = self.gateway(toml + EVERY_READ)
        for name in ways:
            if name == "wrong":
                gateway.wait_for_message("wrong: .* checksums were wrong")
                continue
            gateway.wait_for_events(3, "tag.read", reader=name)
            self.assert_done(gateway.cli("gpio", "set", name, "1=on"))
        self.assertEqual([], gateway.events("tag.read", reader="wrong"))

    def test_a_reader_that_restarts_does_not_take_the_line_with_it(self):
        home = self.directory()
        reader = self.emulate("silion", home / "line", "--name", "anything", *MAKES["silion"][1])
        gateway = self.gateway(self.section("desk", "silion+serial", home / "line") + EVERY_READ)
        gateway.wait_for_events(1, "tag.read", reader="desk")  # the section's name, not the reader's own
        wait_for(lambda: gateway.reader_info("desk").get("firmware"), "heartbeats")
        # Their count shows a restart by being lower than before.
        wait_for(lambda: self.state(reader)["state"]["heartbeats"] > 3, "some heartbeats")
        reader.say("reboot")
        gateway.wait_for_events(1, "reader.fault", reader="desk")
        last = gateway.status()["last_seq"]
        gateway.wait_for_events(1, "tag.read", reader="desk")
        wait_for(lambda: any(row["seq"] > last for row in gateway.events("tag.read")), "it reads on")
        self.assertEqual([], gateway.events("reader.disconnected"))


if __name__ == "__main__":
    unittest.main()
