"""gantry demo: the main job with no hardware, as a newcomer sees it."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import time
import unittest

from gantry_e2e import BINARY, EndToEnd, Process, Store, complaint_of_a_sanitizer, run, wait_for


class Headless(EndToEnd):
    def test_it_ends_by_itself_with_a_summary(self):
        begun = time.monotonic()
        done = self.assert_done(run("demo", "--for", "5s", "--headless", deadline=60))
        self.assertGreaterEqual(time.monotonic() - begun, 5)
        said = [line.split()[0] for line in done.out.splitlines()]
        self.assertEqual(["7", "caen:", "dagprog:", "harting:", "silion:", "events:", "lost:"], said, "the summary and nothing else")
        self.assertIn("the cable of", done.err, "what happened is in the log")
        self.assertRegex(done.out, r"(?m)^lost: 0; every acknowledged read is in the store$")
        self.assertRegex(done.out, r"(?m)^  caen: .* none acknowledged: this protocol has no acknowledgement$")
        told = re.search(r"^7 virtual readers sent (\d+) tag reads in .*; the store holds (\d+) of them", done.out)
        sent, stored = map(int, told.groups())
        makes = [tuple(map(int, each)) for each in re.findall(r"(?m)^  \w+: (\d+) sent, (\d+) stored", done.out)]
        self.assertEqual((sent, stored), tuple(map(sum, zip(*makes))), "the sums are right")
        acknowledged = int(re.search(r"silion: .* (\d+) acknowledged", done.out)[1])
        self.assertGreater(acknowledged, 0)
        self.assertLessEqual(acknowledged, makes[3][1])
        self.assertGreater(int(re.search(r"harting: .* (\d+) acknowledged", done.out)[1]), 0)
        self.assertLessEqual(stored, sent)
        self.add_up(done.out)
        self.assertRegex(done.out, r"(?m)^events: .*tag\.new \d+")

    def add_up(self, summary):
        """The number of events is the sum of its parts."""
        total, parts = re.search(r"(?m)^events: (\d+); (.*)$", summary).groups()
        counts = dict(re.findall(r"(\S+) (\d+)", parts))
        self.assertEqual(int(total), sum(map(int, counts.values())))
        return int(total)

    def test_a_second_run_in_the_same_place_counts_only_itself(self):
        directory = self.directory() / "demo"
        again = ["demo", "--for", "1s", "--headless", "--dir", directory]
        totals = [self.add_up(self.assert_done(run(*again, deadline=60)).out) for _ in range(2)]
        store = Store(directory / "gantry.db")
        self.addCleanup(store.close)
        self.assertEqual(sum(totals), store.number("SELECT count(*) FROM events"))

    def test_its_data_stay_where_they_are_wanted(self):
        directory = self.directory() / "demo"
        self.assert_done(run("demo", "--for", "1s", "--headless", "--dir", directory, deadline=60))
        store = Store(directory / "gantry.db")
        self.addCleanup(store.close)
        self.assertGreater(store.number("SELECT count(*) FROM events WHERE type = 'tag.read'"), 0)

    def test_without_a_directory_nothing_stays(self):
        directory = self.directory()
        self.assert_done(run("demo", "--for", "500ms", "--headless", env={**os.environ, "TMPDIR": str(directory)}, deadline=60))
        self.assertEqual([], list(directory.iterdir()))

    def test_a_second_one_runs_beside_it(self):
        both = [self.under_way(Process(["demo", "--for", "1s", "--headless"])) for _ in range(2)]
        self.assertEqual([0, 0], [each.wait(60) for each in both])

    def test_a_duration_that_is_none(self):
        self.assert_refused(run("demo", "--for", "soon"), "--for: soon is no duration", code=2)


class PlainLines(EndToEnd):
    def test_with_no_terminal_it_prints_lines(self):
        done = self.assert_done(run("demo", "--for", "2s", deadline=60))
        self.assertNotIn("\x1b", done.out)
        self.assertRegex(done.out, r"(?m)^\d{4}-\S+Z  reader\.connected +dock")
        self.assertRegex(done.out, r"(?m)^\d{4}-\S+Z  tag\.observed +\w+/\S+ in \S+ .* dBm")
        self.assertRegex(done.out, r"(?m)^lost: 0;")

    def test_it_ends_when_nobody_reads_it(self):
        demo = self.under_way(Process(["demo"]))
        demo.wait_for_line("tag.observed")
        demo.close_output()
        self.assertEqual(0, demo.wait(60))
        self.assertNotIn("cannot write", demo.err.text())

    def test_ctrl_c_ends_it_with_its_summary(self):
        demo = self.under_way(Process(["demo"]))
        demo.wait_for_line("tag.observed")
        self.assertEqual(0, demo.end(signal.SIGINT, 60))
        self.assertRegex(demo.out.text(), r"(?m)^lost: 0;")


class Terminal:
    """A pseudo-terminal with the demo in it, and what was drawn so far."""

    def __init__(self, rows, columns, *arguments, kind="xterm"):
        self.master, slave = pty.openpty()
        self.resize(rows, columns)
        self.process = subprocess.Popen([BINARY, "demo", *arguments], stdin=slave, stdout=slave, stderr=subprocess.PIPE,
                                        env={**os.environ, "TERM": kind}, start_new_session=True)
        os.close(slave)
        self.data = b""

    def resize(self, rows, columns):
        fcntl.ioctl(self.master, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def text(self):
        while select.select([self.master], [], [], 0)[0]:
            try:
                self.data += os.read(self.master, 65536)
            except OSError:  # the other end is closed
                break
        return self.data.decode("utf-8", "replace")

    def frames(self):
        """Whole pictures, each as its lines without colours."""
        pictures = self.text().split("\x1b[H")[1:-1]
        return [re.split(r"\r*\n", re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", each)) for each in pictures]

    def wait(self):
        """Its exit code. Somebody has to read, or it could not write."""
        wait_for(lambda: (self.text(), self.process.poll() is not None)[1], "it ends", 60)
        self.text()
        return self.process.returncode

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.process.stderr.close()
        os.close(self.master)


class InATerminal(EndToEnd):
    def terminal(self, rows, columns, *arguments, **more):
        terminal = Terminal(rows, columns, *arguments, **more)
        self.addCleanup(terminal.close)
        return terminal

    def assert_fits(self, frame, rows, columns):
        self.assertLessEqual(len(frame), rows)
        self.assertLessEqual(max(map(len, frame)), columns, "\n".join(frame))

    def test_it_draws_a_table(self):
        terminal = self.terminal(40, 120)
        # A reader of the first generation lets up to five seconds pass before it speaks.
        full = lambda frame: "".join(frame).count(" connected,") >= 7 and "dBm" in "".join(frame)
        frame = wait_for(lambda: next(filter(full, terminal.frames()), None), lambda: f"a full table: {terminal.text()}")
        text = "\n".join(line.rstrip() for line in frame)
        self.assertRegex(text, r"(?m)^READER +MAKE +READS/S +STATE$")
        for make, names in {"silion": ("dock", "conveyor", "shelf"), "caen": ("portal", "counter"), "harting": ("gate",),
                            "dagprog": ("desk",)}.items():
            for name in names:
                self.assertRegex(text, rf"(?m)^{name} +{make} +\d+ +connected")
        self.assertRegex(text, r"(?m)^TAGS PRESENT: \d+ +ZONE +RSSI +READS +SINCE$")
        self.assertRegex(text, r"(?m)^sgtin:\S+ +\S+ +-\d+ dBm +\d+ +\S+")
        self.assert_fits(frame, 40, 120)

    def test_nothing_is_cut_in_a_terminal_of_24_by_80(self):
        terminal = self.terminal(24, 80)
        full = lambda frame: "dBm" in "".join(frame)
        frame = wait_for(lambda: next(filter(full, terminal.frames()), None), "a table of tags")
        head, tags = frame[0], [line for line in frame if " dBm " in line]
        present = re.fullmatch(r"Gantry demo: 7 virtual readers, \d+ events stored safely, (\d+) tags present", head.rstrip())[1]
        self.assertRegex("\n".join(frame), rf"(?m)^TAGS PRESENT: {present} ")
        for line in tags:
            self.assertRegex(line, r"^sgtin:\d+\.\d+\.\d+ +\S+ +-\d+ dBm +\d+  .*\w$")
        self.assertNotIn("…", "".join(frame[:-6]), "above what happened lately")
        self.assert_fits(frame, 24, 80)

    def test_it_adapts_to_the_size(self):
        terminal = self.terminal(24, 80)
        wait_for(lambda: len(terminal.frames()) >= 2, "two pictures")
        self.assert_fits(terminal.frames()[-1], 24, 80)
        for rows, columns in ((12, 40), (50, 200), (3, 10)):
            terminal.resize(rows, columns)
            drawn = len(terminal.frames())
            wait_for(lambda: len(terminal.frames()) >= drawn + 3, "pictures of the new size")
            self.assert_fits(terminal.frames()[-1], rows, columns)

    def leaves_it_clean(self, terminal):
        self.assertEqual(0, terminal.wait())
        text = terminal.text()
        self.assertEqual((1, 1), (text.count("\x1b[?1049h"), text.count("\x1b[?25l")))
        drawn, left = text.rsplit("\x1b[?1049l", 1)
        self.assertTrue(drawn.endswith("\x1b[?25h"), "the cursor is back")
        self.assertNotIn("\x1b", left)
        self.assertRegex(left, "lost: 0;")
        self.assertEqual("", complaint_of_a_sanitizer(terminal.process.stderr.read().decode()))

    def test_it_leaves_the_terminal_clean(self):
        self.leaves_it_clean(self.terminal(24, 80, "--for", "2s"))

    def test_it_leaves_the_terminal_clean_when_it_is_told_to_end(self):
        terminal = self.terminal(24, 80)
        wait_for(lambda: terminal.frames(), "a picture")
        terminal.process.send_signal(signal.SIGTERM)
        self.leaves_it_clean(terminal)

    def test_the_key_q_ends_it(self):
        terminal = self.terminal(24, 80)
        wait_for(lambda: terminal.frames(), "a picture")
        self.assertIn("q or Ctrl-C ends it.", "".join(terminal.frames()[0]))
        before = termios.tcgetattr(terminal.master)
        self.assertFalse(before[3] & (termios.ICANON | termios.ECHO))
        os.write(terminal.master, b"q")
        self.leaves_it_clean(terminal)
        self.assertTrue(termios.tcgetattr(terminal.master)[3] & termios.ICANON, "the keyboard is as it was")

    def test_a_terminal_that_can_do_nothing_gets_lines(self):
        terminal = self.terminal(24, 80, "--for", "1s", kind="dumb")
        self.assertEqual(0, terminal.wait())
        self.assertNotIn("\x1b", terminal.text())
        self.assertIn("lost: 0;", terminal.text())


if __name__ == "__main__":
    unittest.main()
