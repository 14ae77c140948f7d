"""The store's schema goes down and up again with a backlog in it, and whoever does it is killed in the middle: it is of
the one version or of the other, and holds what it held."""

import contextlib
import hashlib
import random
import signal
import sqlite3
import time

from .end_to_end import EVERY_READ, READER, STAY, Gateway, Process
from .numbered_readers import NumberedReaders, stored_tags

OLDEST = 1


def version(db):
    with contextlib.closing(sqlite3.connect(f"file:{db}?mode=ro", uri=True, timeout=20)) as store:
        return store.execute("PRAGMA user_version").fetchone()[0]


def content(gateway):
    """Of all events, as they are told."""
    done = gateway.cli("events", "query", "--json", deadline=300)
    if done.code != 0:
        raise AssertionError(done.err)
    return hashlib.sha256(done.out.encode()).hexdigest()


class Upgrades:
    def __init__(self, rows, seed=1):
        self.dice, self.rows = random.Random(seed), rows
        self.gateway, self.readers = Gateway(READER + EVERY_READ + STAY), NumberedReaders(4, 200)
        self.figures = {"kills": 0, "upgrades_killed_before": 0, "upgrades_killed_after": 0, "downgrades_killed": 0, "troubles": []}
        self.took = 1.0

    def fill(self):
        self.readers.connect(self.gateway.start().port)
        self.readers.wait(lambda: self.readers.acknowledged() >= self.rows, 600)
        self.readers.drain()
        self.readers.disconnect()
        self.gateway.stop()
        self.newest, self.content = version(self.gateway.db), content(self.gateway)

    def close(self):
        self.readers.close()
        self.gateway.dispose()

    def note(self, text):
        self.figures["troubles"].append(text)

    def kill_within(self, process, longest):
        time.sleep(self.dice.uniform(0, longest))  # every instant must be possible, so this is a time and no condition
        process.end(signal.SIGKILL)
        self.figures["kills"] += 1
        found = version(self.gateway.db)
        if found not in (OLDEST, self.newest):
            self.note(f"it is of version {found}")
        return found

    def is_whole(self, when):
        """Brings it up to date; only this version's program can read it."""
        self.gateway.start()
        self.gateway.stop()
        if version(self.gateway.db) != self.newest:
            self.note(f"{when}: a start does not bring it up to date")
        if content(self.gateway) != self.content:
            self.note(f"{when}: its content is another")

    def downgrade(self):
        # With --yes: what the oldest version has no place for, the fixtures do not have.
        return Process(["store", "downgrade", "--to", OLDEST, "--yes", "--data-dir", self.gateway.data])

    def one_kill(self, number):
        if number % 2 == 0:
            self.kill_within(self.downgrade(), self.took)
            self.figures["downgrades_killed"] += 1
            self.is_whole(f"downgrade {number}")
            return
        since = time.monotonic()
        done = self.downgrade()
        if done.wait(300) != 0:
            return self.note(f"no way down: {done.out.text()}{done.err.text()}")
        self.took = time.monotonic() - since
        found = self.kill_within(self.gateway.launch(), self.took)
        self.gateway.process = None
        self.figures["upgrades_killed_before" if found == OLDEST else "upgrades_killed_after"] += 1
        self.is_whole(f"upgrade {number}")


def upgrades(kills, rows, say=lambda text: None):
    site = Upgrades(rows)
    try:
        site.fill()
        say(f"{site.readers.acknowledged():,} reads in a store of version {site.newest}")
        for number in range(1, kills + 1):
            site.one_kill(number)
        checked = site.gateway.cli("store", "check", deadline=300)
        if checked.code != 0:
            site.note("the store is damaged: " + checked.out + checked.err)
        site.figures.update(vars(site.readers.check(stored_tags(site.gateway.db))))
        return site.figures
    finally:
        site.close()

