"""The power goes: a file system in a file, a gateway under load on it, stopped at a random instant; what the disk holds
then is copied, mounted and read. What was written and never synced is only in the memory of the one that was stopped."""

import contextlib
import os
import random
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from .end_to_end import EVERY_READ, READER, Gateway, run
from .processes import NotHere
from .numbered_readers import NumberedReaders, stored_tags

DISK_MIB = 96
CUTS_A_DISK = 10  # then a new one: the books of a cut are read from its whole store


def order(*arguments):
    done = subprocess.run([str(each) for each in arguments], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise NotHere(f"{arguments[0]}: {done.stderr.strip() or done.stdout.strip()}")


@contextlib.contextmanager
def mounted(image, at):
    at.mkdir(exist_ok=True)
    order("mount", "-o", "loop", image, at)
    try:
        yield at
    finally:
        subprocess.run(["umount", at], check=False)


def why_not():
    """Empty: file systems in a file can be made and mounted here."""
    if os.geteuid() != 0:
        return "only root can mount a file system"
    try:
        with tempfile.TemporaryDirectory() as home:
            make_disk(Path(home) / "try", 8)
            with mounted(Path(home) / "try", Path(home) / "mounted"):
                return ""
    except (OSError, NotHere) as error:
        return f"a file system in a file cannot be mounted here: {error}"


def make_disk(image, mib=DISK_MIB):
    with open(image, "wb") as file:
        file.truncate(mib << 20)
    order("mkfs.ext4", "-q", "-F", image)


class Cut:
    """What a cut left of the store."""

    def __init__(self, image, at, claims, readers):
        self.trouble = ""
        with mounted(image, at):
            store = at / "data" / "gantry.db"
            checked = run("store", "check", "--db", store, deadline=120)
            if checked.code != 0:
                self.trouble = checked.out + checked.err
            self.books = readers.check(stored_tags(store), claims)
            again = Gateway(READER + EVERY_READ)
            again.data = at / "data"
            try:
                again.start()
                if "set aside" in again.log():
                    self.trouble += again.log()
            except AssertionError as error:
                self.trouble += str(error)
            finally:
                again.dispose()


def power_cuts(cuts, seed=1, synchronous_normal=False, say=lambda text: None):
    """Figures of so many cuts."""
    dice = random.Random(seed)
    figures = {"cuts": 0, "acknowledged": 0, "lost": 0, "cuts_with_loss": 0, "doubled": 0, "made_up": 0, "damaged": 0, "troubles": []}
    env = {"GANTRY_FAILPOINT": "store_synchronous_normal"} if synchronous_normal else None
    while figures["cuts"] < cuts:
        with tempfile.TemporaryDirectory(prefix="gantry-power-") as home:
            cut_one_disk(Path(home), min(CUTS_A_DISK, cuts - figures["cuts"]), dice, env, figures, say)
    return figures


def cut_one_disk(home, cuts, dice, env, figures, say):
    image, copy = home / "disk", home / "copy"
    make_disk(image)
    with mounted(image, home / "mounted") as disk:
        gateway = Gateway(READER + EVERY_READ, env=env)
        gateway.data = disk / "data"
        readers = NumberedReaders(8, 20, frames_per_second=100)
        try:
            readers.connect(gateway.start().port)
            for _ in range(cuts):
                if not readers.wait_for_more(1):
                    raise AssertionError("no acknowledgement comes: " + gateway.log())
                time.sleep(dice.uniform(0.02, 0.4))  # every instant must be possible, so this is a time and no condition
                gateway.process.send_signal(signal.SIGSTOP)  # until all is looked at: else the store grows meanwhile
                try:
                    order("cp", "--sparse=always", image, copy)
                    cut = Cut(copy, home / "copy.mounted", readers.claims(), readers)
                finally:
                    gateway.process.send_signal(signal.SIGCONT)
                add(figures, cut)
                say(f"cut {figures['cuts']}: {cut.books.text()}{', damaged' if cut.trouble else ''}")
        finally:
            readers.close()
            gateway.dispose()


def add(figures, cut):
    figures["cuts"] += 1
    for name in ("acknowledged", "lost", "doubled", "made_up"):
        figures[name] += getattr(cut.books, name)
    figures["cuts_with_loss"] += cut.books.lost > 0
    if cut.trouble:
        figures["damaged"] += 1
        figures["troubles"].append(cut.trouble[-500:])
