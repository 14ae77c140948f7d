"""The gateway's wall clock is set while it works: timers and order do not care, events say what each clock said."""

import struct
import time
import unittest
from datetime import datetime, timedelta, timezone
from pathlib import Path

from gantry_e2e import BINARY, EVERY_READ, READER, EndToEnd, Process, wait_for
from reader_ledger import Books, NumberedReader
from silion import SilionReader, new_epc

PRELOAD = Path(BINARY).resolve().parent / "libgantry_wall_clock.so"
HOUR, YEAR = timedelta(hours=1), timedelta(days=365)
JUMPS = (HOUR, -HOUR, timedelta(seconds=1), timedelta(seconds=-1), 10 * YEAR, -10 * YEAR, timedelta(days=1), -HOUR,
         timedelta(milliseconds=-500), 50 * YEAR)


def time_of(text):
    return datetime.fromisoformat(text.replace("Z", "+00:00"))


class WallClock:
    """That of one gateway, ahead of the machine's."""

    def __init__(self, file):
        self._file, self.ahead = file, timedelta(0)
        self.jump(timedelta(0))
        self.environment = {"LD_PRELOAD": str(PRELOAD), "GANTRY_WALL_CLOCK": str(file),
                            "ASAN_OPTIONS": "verify_asan_link_order=0"}

    def jump(self, by):
        self.ahead += by
        with open(self._file, "r+b" if self._file.exists() else "wb") as file:
            file.write(struct.pack("<q", self.ahead // timedelta(microseconds=1) * 1000))

    def now(self):
        return datetime.now(timezone.utc) + self.ahead


class SetClock(EndToEnd):
    def setUp(self):
        self.clock = WallClock(self.directory() / "ahead")

    def site(self, toml):
        return self.gateway(toml, env=self.clock.environment)


class Jumps(SetClock):
    def test_reads_keep_their_order_and_say_what_the_clock_said(self):
        gateway, books = self.site(READER + EVERY_READ), Books()
        reader = NumberedReader(books, 1, gateway.port)
        self.addCleanup(reader.close)
        for by in JUMPS * 2:
            self.clock.jump(by)
            before = self.clock.now()
            for _ in range(5):
                reader.exchange()
            times = [time_of(row["time"]) for row in gateway.events("tag.read")[-25:]]
            for each in times:
                self.assertLessEqual(before - timedelta(seconds=1), each)
                self.assertLessEqual(each, self.clock.now() + timedelta(seconds=1))
        balance = books.balance(gateway.store())
        self.assertTrue(balance.is_clean(), balance)
        self.assertEqual(balance.sent, balance.stored)
        rows = gateway.store().rows("SELECT seq FROM events ORDER BY seq")
        self.assertEqual(list(range(1, len(rows) + 1)), [row["seq"] for row in rows])
        self.assertEqual(1, len(gateway.events("reader.connected")), "no link was given up")

    def test_who_stands_there_never_left_and_who_is_gone_is_lost_in_time(self):
        gateway = self.site(READER + '[presence]\nlose_after = "2s"\npurge_after = "1h"\n')
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        staying = new_epc()
        for by in JUMPS:
            going = new_epc()
            reader.upload(staying, going)
            self.clock.jump(by)
            begun = time.monotonic()
            lost = lambda tag=going: gateway.store().number(
                "SELECT count(*) FROM events WHERE type = 'tag.lost' AND tag = ?", tag)
            while not lost():
                self.assertLess(time.monotonic() - begun, 20)
                reader.upload(staying)
            self.assertGreater(time.monotonic() - begun, 1.5, "not before its time either")
        self.assertEqual(["tag.new", "tag.observed"], [row["type"] for row in gateway.events(tag=staying)])
        self.assertEqual([], gateway.events("tag.purged"))

    def test_a_clock_that_jumps_ahead_does_not_make_what_is_stored_old(self):
        gateway = self.site(READER + EVERY_READ + '[store]\nkeep = "5s"\n')
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        tag, begun = new_epc(), time.monotonic()
        reader.upload(tag)
        self.clock.jump(10 * YEAR)
        wait_for(lambda: gateway.reads_of(tag) == 0, "it goes when it is old")
        self.assertGreater(time.monotonic() - begun, 5)


class BothTimes(SetClock):
    def test_a_readers_own_time_is_told_beside_ours_and_its_clock_is_not_blamed(self):
        reader = self.under_way(Process(["emulate", "caen", "--listen", "127.0.0.1:0", "--set", "clock=set", "--set", "round=20ms"]))
        place = reader.wait_for_line("^listening on (.*)$")[1]
        gateway = self.site(f'[[reader]]\nname = "dock"\naddress = "caen://{place}"\n' + EVERY_READ)
        newest = lambda: gateway.store().rows("SELECT seq, time, reader_time FROM events WHERE type = 'tag.read' "
                                              "AND reader_time IS NOT NULL ORDER BY seq DESC LIMIT 1")
        wait_for(newest, "it reads")
        for by in (HOUR, -2 * HOUR, 10 * YEAR):
            self.clock.jump(by)
            last = newest()[0]["seq"]
            row = wait_for(lambda: (rows := newest()) and rows[0]["seq"] > last + 20 and rows[0], "it reads on")
            self.assertLess(abs(time_of(row["time"]) - self.clock.now()), timedelta(seconds=20))
            self.assertLess(abs(time_of(row["reader_time"]) - datetime.now(timezone.utc)), timedelta(seconds=20))
        self.assertEqual([], gateway.events("clock.jumped"))
        self.assertEqual(1, len(gateway.events("reader.connected")))


if __name__ == "__main__":
    unittest.main()
