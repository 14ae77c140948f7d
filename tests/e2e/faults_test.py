"""What goes wrong on request, for every make: with --fault from the start, and by a word during the run. What each does
to a driver is tested in memory; here it is what an operator sees of it."""

import json
import subprocess
import unittest
from datetime import datetime, timedelta, timezone

from gantry_e2e import EVERY_READ, EndToEnd, Process, run, wait_for

# By name of the section: make, settings of the virtual reader, of the section.
SITE = {
    "gate": ("silion", ["batch=200ms", "heartbeat=1s"], 'heartbeat = "1s"\n'),
    "dock": ("caen", ["clock=set"], ""),
    "arch": ("harting", ["clock=set"], ""),
    "desk": ("dagprog", [], 'alive = "1s"\nmode = "rc"\n'),
}
# Its last byte is the CRC8 of the others.
DESK_TAG = "epc,technology,user\nE004010012345678,iso15693,0012341F\n"


def time_of(text):
    return datetime.fromisoformat(text.replace("Z", "+00:00"))


class Site(EndToEnd):
    def begin(self, only=(), faults=(), heartbeat="1s"):
        """A virtual reader of every make, or of some, and a gateway that has read from them."""
        self.names, self.heartbeat = only or tuple(SITE), heartbeat
        home, places, toml = self.directory(), {}, ""
        (home / "desk.csv").write_text(DESK_TAG)
        gate = 'address = "silion-listen://127.0.0.1:0"\n'
        self.readers = {}
        for name in self.names:
            make, settings, _ = SITE[name]
            how = {"silion": None, "dagprog": ["--pty", home / name, "--tags", home / "desk.csv"]}.get(
                make, ["--listen", "127.0.0.1:0"])
            if how is None:
                continue
            self.readers[name] = self.emulate(name, faults, *how)
            places[name] = self.readers[name].wait_for_line("^listening on (.+)$")[1]
        for name in self.names:
            make, _, section = SITE[name]
            address = f'address = "{make}://{places[name]}"\n' if name in places else gate
            toml += f'[[reader]]\nname = "{name}"\n{address}{self.beating(section)}'
        self.running = self.gateway(toml + EVERY_READ)
        if "gate" in self.names:
            self.readers["gate"] = self.emulate("gate", faults, "--connect", f"127.0.0.1:{self.running.port}")

    def emulate(self, name, faults, *how):
        make, settings, _ = SITE[name]
        more = [word for each in settings for word in ("--set", self.beating(each))]
        more += [word for each in faults for word in ("--fault", each)]
        return self.under_way(Process(["emulate", make, "--name", name, *how, *more], stdin=subprocess.PIPE))

    def beating(self, text):
        """With the heartbeat that the test wants."""
        return text.replace("heartbeat=1s", f"heartbeat={self.heartbeat}").replace('heartbeat = "1s"', f'heartbeat = "{self.heartbeat}"')

    def say(self, word):
        for reader in self.readers.values():
            reader.say(word)

    def read_by_all(self):
        last = max((row["seq"] for row in self.running.events()), default=0)
        for name in self.names:
            wait_for(lambda: any(row["seq"] > last for row in self.running.events("tag.read", reader=name)),
                     lambda: f"{name} reads; {self.running.cli('reader', 'list').out}", 60)

    def state(self, name):
        """What the virtual reader says of itself."""
        before = len(self.readers[name].out.lines())
        self.readers[name].say("state")
        return json.loads(wait_for(lambda: self.readers[name].out.lines()[before:], "its state")[0])["state"]

    def counter(self, name, *counters):
        now = self.running.reader_info(name)["counters"]
        return sum(now[each] for each in counters)


class DuringARun(Site):
    def test_a_drop_is_a_link_that_ends_and_comes_back(self):
        self.begin()
        self.read_by_all()
        self.say("drop")
        for name in self.names:
            self.running.wait_for_events(1, "reader.disconnected", reader=name)
            self.running.wait_for_events(2, "reader.connected", reader=name)
        self.read_by_all()

    def test_a_link_that_is_half_open_is_given_up(self):
        self.begin()
        self.read_by_all()
        self.say("half-open")
        for name in self.names:
            self.running.wait_for_events(1, "reader.disconnected", reader=name, deadline=60)
        self.readers["desk"].say("half-open off")  # a line does not end with the program at its other end
        self.read_by_all()

    def test_what_makes_no_sense_is_counted_and_skipped(self):
        self.begin()
        self.read_by_all()
        signs = ("skipped_bytes", "bad_checksum", "bad_length", "malformed", "resyncs", "timeouts", "unknown_code")
        for word in ("garbage 64", "truncated"):
            before = {name: self.counter(name, *signs) for name in self.names}
            self.say(word)
            for name in self.names:
                wait_for(lambda: self.counter(name, *signs) != before[name], f"{name} has seen it")
            self.read_by_all()
        for name in ("gate", "arch", "desk"):
            before = self.counter(name, "bad_checksum")
            self.readers[name].say("bad-crc")
            wait_for(lambda: self.counter(name, "bad_checksum") > before, f"{name} has seen it")
        self.running.wait_for_events(1, "reader.fault", reader="desk", text="the CRC8 of a tag's block is wrong")
        self.read_by_all()

    def test_a_clock_that_jumps_is_told_and_moves_only_the_readers_own_times(self):
        self.begin(only=("dock", "arch"))
        self.read_by_all()
        for name in self.names:
            wait_for(lambda: self.read_for(name) > timedelta(seconds=3), "its reads are live")
        for word, by, hour in (("clock-jump", "+1h", 1), ("clock-jump -1h", "-1h", 0)):
            self.say(word)
            for name in self.names:
                jumps = wait_for(lambda: [row for row in self.running.events("clock.jumped", reader=name)
                                          if row["by"][0] == by[0]], f"{name}: {by}")
                self.assertEqual(1, len(jumps), jumps)
                wait_for(lambda: abs(self.ahead(name) - timedelta(hours=hour)) < timedelta(minutes=1), "its times moved")
        now = datetime.now(timezone.utc)
        times = [time_of(row["time"]) for row in self.running.events()]
        self.assertLess(max(times) - now, timedelta(minutes=1))

    def timed(self, name):
        return [row for row in self.running.events("tag.read", reader=name) if "reader_time" in row]

    def read_for(self, name):
        rows = self.timed(name)
        return time_of(rows[-1]["time"]) - time_of(rows[0]["time"]) if rows else timedelta()

    def ahead(self, name):
        """Of the last read: the reader's own time less ours."""
        last = self.timed(name)[-1]
        return time_of(last["reader_time"]) - time_of(last["time"])

    def test_a_buffer_that_is_full_is_told_each_time(self):
        self.begin(only=("arch",))
        self.read_by_all()
        for told in (1, 2):
            self.say("buffer-full")
            rows = self.running.wait_for_events(told, "overflow", reader="arch")
            self.assertEqual("reader buffer", rows[-1]["scope"])
            self.assertIsNone(rows[-1].get("count"), "how much is lost the reader does not say")
            wait_for(lambda: not self.state("arch")["overflow"], "its buffer was cleared")
            self.read_by_all()
        self.assertEqual(2, len(self.running.events("overflow")))


class FromTheStart(Site):
    def test_a_drop_ends_the_first_link(self):
        self.begin(faults=("drop",))
        self.read_by_all()
        for name in self.names:
            wait_for(lambda: self.state(name)["connects"] >= 2, f"{name} was connected twice")

    def test_a_reader_that_is_slow_is_only_late(self):
        self.begin(faults=("slow 500ms",), heartbeat="10s")
        self.read_by_all()
        self.assertEqual([], self.running.events("reader.disconnected"))

    def test_a_broken_antenna_hears_nothing_until_it_is_whole(self):
        self.begin(faults=("antenna-broken 1",))
        for name in self.names:
            self.running.wait_for_events(1, "reader.connected", reader=name)
        self.say("antenna-broken off")
        self.read_by_all()

    def test_a_broken_antenna_is_told_once_and_by_a_reader_that_is_there(self):
        self.begin(only=("gate",), faults=("antenna-broken 1",))
        self.running.wait_for_events(1, "reader.fault", reader="gate")
        wait_for(lambda: self.counter("gate", "frames") > 4, "more heartbeats and errors")
        fault, = self.running.events("reader.fault")
        self.assertEqual((9, "alarm: high return loss"), (fault["code"], fault["text"]))
        connected, = self.running.events("reader.connected")
        self.assertLessEqual(time_of(connected["time"]), time_of(fault["time"]))

    def test_what_a_make_cannot_have_is_refused_with_the_reason(self):
        for make, how, word, why in (
                ("silion", ["--connect", "127.0.0.1:9"], "clock-jump", "its frames carry no time"),
                ("caen", [], "bad-crc", "its messages have no checksum"),
                ("caen", [], "stuck-ack on", "nothing that it sends is acknowledged"),
                ("dagprog", ["--pty", self.directory() / "desk"], "clock-jump +1h", "a unit has no clock"),
                ("dagprog", ["--pty", self.directory() / "desk"], "buffer-full", "a unit keeps no tags")):
            word_alone = word.split(" ", maxsplit=1)[0]
            self.assert_refused(run("emulate", make, *how, "--fault", word),
                                f'--fault {word}: a reader of this make cannot have the fault "{word_alone}": {why}', code=2)


if __name__ == "__main__":
    unittest.main()
