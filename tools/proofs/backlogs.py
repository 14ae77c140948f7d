"""A destination that comes back finds millions of events waiting: how long a start takes with them, how fast they go out
beside live readers, and whether their order holds."""

import json
import tempfile
import time
from pathlib import Path

from .end_to_end import EVERY_READ, READER, STAY, Gateway
from .numbered_readers import NumberedReaders, identity

LIVE_READERS, LIVE_RECORDS, LIVE_FRAMES = 20, 50, 10  # 10,000 reads a second
TAGS = 500  # in front of each reader


def backlog(rows, tags=TAGS, say=lambda text: None):
    figures = {"rows": 0, "live_rate": LIVE_READERS * LIVE_RECORDS * LIVE_FRAMES}
    readers = NumberedReaders(LIVE_READERS, 200, tags=tags)
    with tempfile.TemporaryDirectory(prefix="gantry-backlog-") as home:
        archive = Path(home) / "archive"
        archive.mkdir()
        gateway = Gateway(READER + EVERY_READ + STAY)
        try:
            since = time.monotonic()
            readers.connect(gateway.start().port)
            readers.wait(lambda: readers.acknowledged() >= rows, 3600)
            readers.drain()
            readers.disconnect()
            figures["rows"], figures["fill_rate"] = readers.acknowledged(), round(readers.acknowledged() / (time.monotonic() - since))
            say(f"{figures['rows']:,} reads stored, {figures['fill_rate']:,} a second")
            gateway.kill()
            gateway.toml += f'[[sink]]\nname = "archive"\ntype = "jsonl"\ndir = "{archive}"\nstart = "oldest"\n'
            since = time.monotonic()
            gateway.start()
            figures["ready_ms"] = round((time.monotonic() - since) * 1000)
            say(f"ready after {figures['ready_ms']} ms")
            drain(gateway, readers, figures, say)
            readers.drain()
            caught_up(gateway, readers)
            gateway.stop()
            figures.update(vars(readers.check(tags_in(archive))))
        finally:
            readers.close()
            gateway.dispose()
    return figures


def sink(gateway):
    return gateway.ask("GET", "/api/v1/sinks").json()["sinks"][0]


def caught_up(gateway, readers):
    return readers.wait(lambda: sink(gateway)["behind"] == 0, 3600)


def drain(gateway, readers, figures, say):
    """With live readers beside it, until nothing waits."""
    for reader in readers.readers:
        reader.records = LIVE_RECORDS
    readers.pace(LIVE_FRAMES)
    before, since = sink(gateway), time.monotonic()
    live_before = readers.acknowledged()
    readers.connect(gateway.port)
    readers.wait(lambda: sink(gateway)["behind"] < figures["live_rate"], 3600)
    seconds = time.monotonic() - since
    figures["drain_rate"] = round((sink(gateway)["delivered"] - before["delivered"]) / seconds)
    figures["live_reached"] = round((readers.acknowledged() - live_before) / seconds)
    say(f"drained at {figures['drain_rate']:,} events a second beside {figures['live_reached']:,} live reads a second")


def tags_in(archive):
    for file in sorted(archive.glob("archive-*.jsonl")):
        with file.open() as text:
            for line in text:
                event = json.loads(line)
                if event["type"] == "tag.read":
                    yield identity(event["tag"], event.get("data"))
