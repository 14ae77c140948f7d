"""The disk fails at the N-th write, sync or open of the store, once or until it is mended: nothing is acknowledged
meanwhile, it is shown, and the gateway goes on by itself with nothing lost."""

import tempfile
import time

from .disk_faults import NAMES, OPEN, SYNC, WRITE, DiskFaults
from .end_to_end import EVERY_READ, READER, Gateway
from .numbered_readers import NumberedReaders, stored_tags

LASTING_EACH = 10  # every so many faults last until they are mended
OPENS = 40  # an open is only due when something has failed: the N-th is tried so far


class FailingDisk:
    def __init__(self, home, failpoint=None):
        self.faults = DiskFaults(home)
        env = dict(self.faults.env, **({"GANTRY_FAILPOINT": failpoint} if failpoint else {}))
        self.gateway = Gateway(READER + EVERY_READ, env=env)
        self.readers = NumberedReaders(4, 10)
        self.figures = {"faults": 0, "lasting": 0, "acknowledged_while_failing": 0, "longest_return_ms": 0.0, "troubles": []}

    def start(self):
        self.readers.connect(self.gateway.start().port)

    def close(self):
        self.readers.close()
        self.gateway.dispose()

    def trouble(self):
        return self.gateway.status().get("store_trouble")

    def note(self, text):
        self.figures["troubles"].append(text)

    def fault(self, call, at, lasting):
        """One fault, from its arming until all is well again."""
        name = f"{NAMES[call]} {at}"
        self.faults.fail(call, at, -1 if lasting else 1)
        if call == OPEN:
            self.faults.fail(WRITE, 1)  # then files are opened anew
        if not self.readers.wait(lambda: self.faults.failed(call) > 0 or (call == OPEN and self.opens_once_more()), 120):
            self.faults.heal()
            return self.note(f"{name}: it never came to that")
        self.figures["faults"] += 1
        if lasting:
            self.figures["lasting"] += 1
            if not self.readers.wait(self.trouble, 30):
                self.note(f"{name}: no trouble is shown")
            time.sleep(0.05)  # an acknowledgement that was on its way
            before = self.readers.acknowledged()
            if not self.readers.wait(lambda: "held" in self.gateway.reader_info("gate-1")["state"], 10):
                self.note(f"{name}: the reader is not shown as held")
            self.readers.wait(lambda: False, 0.3)
            self.figures["acknowledged_while_failing"] += self.readers.acknowledged() - before
        self.go_on(name)

    def opens_once_more(self):
        """Fewer files than that were opened: another write fails."""
        if self.faults.failed(WRITE):
            self.faults.fail(WRITE, 1)
        return False

    def go_on(self, name):
        since = time.monotonic()
        self.faults.heal()
        if not self.readers.wait_for_more(40) or not self.readers.wait(lambda: not self.trouble(), 30):
            self.note(f"{name}: it does not go on by itself")
        self.figures["longest_return_ms"] = max(self.figures["longest_return_ms"], (time.monotonic() - since) * 1000)

    def kill_while_failing(self, at):
        """Its bite: who acknowledges before the commit has lost these."""
        self.faults.fail(WRITE if at % 2 else SYNC, at, -1)  # what was written and not synced survives a kill
        if not self.readers.wait(self.trouble, 60):
            self.note(f"kill {at}: no trouble is shown")
        self.gateway.kill()
        self.faults.heal()
        self.readers.connect(self.gateway.start().port)
        self.readers.wait_for_more(1)

    def check(self):
        if not self.readers.drain():
            self.note("not all is acknowledged at the end")
        self.gateway.stop()
        checked = self.gateway.cli("store", "check", deadline=300)
        if checked.code != 0:
            self.note("the store is damaged: " + checked.out + checked.err)
        self.figures.update(vars(self.readers.check(stored_tags(self.gateway.db))))
        return self.figures


def failing_disks(last, say=lambda text: None):
    with tempfile.TemporaryDirectory(prefix="gantry-failing-") as home:
        disk = FailingDisk(home)
        try:
            disk.start()
            for call in (WRITE, SYNC, OPEN):
                for at in range(1, (min(last, OPENS) if call == OPEN else last) + 1):
                    disk.fault(call, at, lasting=at % LASTING_EACH == 1)
                say(f"{NAMES[call]}: {disk.figures['faults']} faults by now, {len(disk.figures['troubles'])} troubles")
            for at in (1, 2, 3):
                disk.kill_while_failing(at)
            return disk.check()
        finally:
            disk.close()


def kills_while_failing(kills, failpoint):
    with tempfile.TemporaryDirectory(prefix="gantry-failing-") as home:
        disk = FailingDisk(home, failpoint)
        try:
            disk.start()
            for at in range(1, kills + 1):
                disk.kill_while_failing(at)
            return disk.check()
        finally:
            disk.close()
