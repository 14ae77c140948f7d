"""N8: the gateway's wall clock is set while it works."""

import struct
import time
from datetime import timedelta

from .. import ledger
from ..measure import seconds
from ..processes import built, wait_for
from ..site import Site

TITLE = "the gateway's clock jumps: hours, years, a second, there and back"
PASS = ("no read is lost, doubled or out of order; numbers have no gaps; no link is given up and no tag is lost because of it; a read's "
        "time is what the clock said, its reader_time what the reader's said; nothing stored becomes old")
READERS = {"silion": 4, "silion-plain": 2, "harting": 4, "caen": 2}
HOUR, YEAR = timedelta(hours=1), timedelta(days=365)
JUMPS = (HOUR, -HOUR, timedelta(seconds=1), timedelta(seconds=-1), 10 * YEAR, -10 * YEAR, timedelta(days=1), -HOUR,
         timedelta(milliseconds=-500), 40 * YEAR)
MOST_APART = 10  # seconds; less than the jumps that matter


def options(parser):
    parser.add_argument("--jumps", type=int, help="how many (default 200, quick 20)")
    parser.add_argument("--rate", type=float, default=500, help="reads a second in all (default 500)")


class Clock:
    """See tests/e2e/wall_clock.c."""

    def __init__(self, build, file, steady):
        self._file, self.ahead = file, timedelta(0)
        file.write_bytes(struct.pack("<q", 0))
        self.environment = {"LD_PRELOAD": built("libgantry_wall_clock.so", build), "GANTRY_WALL_CLOCK": str(file),
                            "ASAN_OPTIONS": "verify_asan_link_order=0"}
        if steady:
            self.environment["GANTRY_STEADY_CLOCK"] = "1"

    def jump(self, by):
        self.ahead += by
        with open(self._file, "r+b") as file:
            file.write(struct.pack("<q", self.ahead // timedelta(microseconds=1) * 1000))


def run(proof):
    given = proof.options
    jumps = given.jumps or (20 if given.quick else 200)
    more = '[presence]\nlose_after = "1h"\n[store]\nkeep = "30d"\n'
    with Site(given.build, ("files",), READERS, given.rate / sum(READERS.values()), more=more, keep=given.keep) as site:
        clock = Clock(given.build, site.home / "ahead", steady=given.bite)
        site.start(env=clock.environment)
        site.wait_for_flow()
        begun, worst = time.monotonic(), 0.0
        for number in range(jumps):
            by = JUMPS[number % len(JUMPS)]
            if clock.ahead + by > 100 * YEAR:
                by = -clock.ahead
            clock.jump(abs(by) if given.bite else by)
            site.wait_for_flow(20)
            # What was on its way when the clock was set bears the time before.
            if not given.bite:
                wait_for(lambda: newest(site, clock) < MOST_APART, "reads bear the new time")
            worst = max(worst, newest(site, clock))
        proof.figure("jumps", jumps, f"in {time.monotonic() - begun:.0f} s")
        store = site.store()
        ended = store.execute("SELECT count(*) FROM events WHERE type = 'reader.disconnected'").fetchone()[0]
        gone = store.execute("SELECT count(*) FROM events WHERE type IN ('tag.lost', 'tag.purged')").fetchone()[0]
        first = store.execute("SELECT min(seq) FROM events").fetchone()[0]
        blamed = store.execute("SELECT count(*) FROM events WHERE type = 'clock.jumped'").fetchone()[0]
        store.close()
        proof.must_be_zero("links given up", ended, loss=True)
        proof.must_be_zero("tags lost before their hour was over", gone, loss=True)
        proof.must_be_zero("readers whose clock is said to have jumped", blamed)
        proof.must_be_zero("events deleted as too old", first - 1, loss=True)
        proof.figure("a read's time and the clock, most apart", worst, "s")
        if not given.bite:
            clock.jump(-clock.ahead)
            ledger.check(proof, site, site.finish())


def newest(site, clock):
    """How far the time of the newest read is from what the clock says now, in seconds."""
    recent = site.ask("/api/v1/status")["last_seq"] - 100  # the view is slow for all of them
    store = site.store()
    times = store.execute("SELECT time FROM events WHERE seq > ? AND type = 'tag.read' ORDER BY seq", (recent,)).fetchall()
    store.close()
    return abs(time.time() + clock.ahead.total_seconds() - seconds(times[-1][0])) if times else float("inf")
