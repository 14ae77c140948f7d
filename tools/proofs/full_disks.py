"""The disk of the store is full, and then it is not: nothing is acknowledged meanwhile, and afterwards all goes on by
itself; with sinks, of which one is away while the disk is full, so that nothing can make room."""

import contextlib
import json
import subprocess
import tempfile
import time
from pathlib import Path

from . import end_to_end
from .end_to_end import EVERY_READ, LEAVE, READER, Gateway
from .numbered_readers import NumberedReaders

DISK_MIB = 8
KILL_EACH = 5  # in one round of so many the gateway is killed while the disk is full
SETTINGS = '[store]\nmax_size = "4MiB"\n' + LEAVE
QUICK = 'start = "oldest"\nretry_min = "50ms"\nretry_max = "500ms"\n'


class Receiver(end_to_end.Receiver):
    """Keeps the tags, each event once, in order of the first time."""

    def __init__(self):
        self.tags = {}
        super().__init__()

    def take(self, events):
        status = super().take(events)
        if status == 200:
            for event in events:
                if event["type"] == "tag.read":
                    self.tags.setdefault(event["id"], event["tag"])
        return status


@contextlib.contextmanager
def small_disk(at):
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MIB}m", "tmpfs", at], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise OSError(f"a file system in memory cannot be mounted here: {done.stderr.strip()}")
    try:
        yield Path(at)
    finally:
        subprocess.run(["umount", "-l", at], check=False)


def why_not():
    try:
        with tempfile.TemporaryDirectory() as at, small_disk(at):
            return ""
    except OSError as error:
        return str(error)


def fill(ballast):
    with ballast.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        for size in (65536, 4096, 1):
            with contextlib.suppress(OSError):
                while file.write(b"\0" * size):
                    pass


def lines(directory):
    """Each event once: what was under way at a kill is there again, under the same id."""
    ids = set()
    for file in sorted(directory.glob("archive-*.jsonl")):
        with file.open() as text:
            for line in text:
                event = json.loads(line)
                if event["id"] not in ids:
                    ids.add(event["id"])
                    yield event


def full_disks(rounds, env=None, kill_each=KILL_EACH, frames=10, say=lambda text: None):
    figures = {"rounds": 0, "kills": 0, "acknowledged_while_full": 0, "longest_return_ms": 0.0, "troubles": []}
    receiver, readers = Receiver(), NumberedReaders(4, 10, frames_per_second=frames)
    with tempfile.TemporaryDirectory(prefix="gantry-full-") as home, small_disk(tempfile.mkdtemp(dir=home)) as disk:
        archive = Path(home) / "archive"
        archive.mkdir()
        gateway = Gateway(READER + EVERY_READ + SETTINGS +
                          f'[[sink]]\nname = "hook"\ntype = "webhook"\nurl = "{receiver.url}"\n{QUICK}'
                          f'[[sink]]\nname = "archive"\ntype = "jsonl"\ndir = "{archive}"\n{QUICK}', env=env)
        gateway.data = disk / "data"
        try:
            readers.connect(gateway.start().port)
            for number in range(rounds):
                kill = number % kill_each == kill_each - 1
                one_round(number, gateway, readers, receiver, disk / "ballast", figures, say, kill)
            if not readers.drain():
                figures["troubles"].append("not all is acknowledged at the end")
            receiver.status = 200
            if not readers.wait(lambda: caught_up(gateway), 120):
                figures["troubles"].append("a sink does not catch up")
            gateway.stop()
            figures["hook"] = vars(readers.check(receiver.tags.values()))
            figures["archive"] = vars(readers.check(event["tag"] for event in lines(archive) if event["type"] == "tag.read"))
        finally:
            readers.close()
            gateway.dispose()
            receiver.close()
    return figures


def caught_up(gateway, most=0):
    return all(sink["behind"] <= most for sink in gateway.ask("GET", "/api/v1/sinks").json()["sinks"])


def one_round(number, gateway, readers, receiver, ballast, figures, say, kill=False):
    trouble = lambda: gateway.status().get("store_trouble")
    receiver.status = 503
    if not readers.wait_for_more(1):
        figures["troubles"].append(f"round {number}: nothing is acknowledged before the disk is full")
    fill(ballast)
    if not readers.wait(trouble, 60):
        figures["troubles"].append(f"round {number}: no trouble is shown")
    time.sleep(0.05)  # an acknowledgement that was on its way
    before = readers.acknowledged()
    readers.wait(lambda: False, 0.5)
    figures["acknowledged_while_full"] += readers.acknowledged() - before
    if kill:
        gateway.kill()
    before, since = readers.acknowledged(), time.monotonic()
    ballast.unlink()
    if kill:
        readers.connect(gateway.start().port)
        figures["kills"] += 1
    if not readers.wait(lambda: readers.acknowledged() > before, 60):
        figures["troubles"].append(f"round {number}: it does not go on by itself")
    back = (time.monotonic() - since) * 1000
    figures["longest_return_ms"] = max(figures["longest_return_ms"], back)
    receiver.status = 200
    if not readers.wait(lambda: not trouble(), 60):
        figures["troubles"].append(f"round {number}: the trouble is shown for ever")
    # Else what waits for the sink fills the store up to its own bound, which is another proof (tests/e2e/bounds_test.py).
    if not readers.wait(lambda: caught_up(gateway, 500), 120):
        figures["troubles"].append(f"round {number}: a sink does not catch up")
    figures["rounds"] += 1
    say(f"round {number + 1}: back after {back:.0f} ms, {readers.acknowledged()} acknowledged by now")
