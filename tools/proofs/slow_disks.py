"""Every sync of the store takes longer: how much that costs readers that wait for acknowledgement."""

import tempfile
import time

from .disk_faults import DiskFaults
from .end_to_end import EVERY_READ, READER, STAY, Gateway
from .numbered_readers import NumberedReaders, stored_tags

READERS, RECORDS, TAGS = 200, 100, 500


def slow_disks(delays_ms, seconds, say=lambda text: None):
    figures = {"readers": READERS, "records_a_frame": RECORDS, "rates": {}, "longest_wait_ms": {}}
    with tempfile.TemporaryDirectory(prefix="gantry-slow-") as home:
        faults = DiskFaults(home)
        gateway = Gateway(READER + EVERY_READ + STAY, env=faults.env)
        readers = NumberedReaders(READERS, RECORDS, tags=TAGS)
        try:
            readers.connect(gateway.start().port)
            for delay in delays_ms:
                faults.slow_syncs(delay / 1000)
                readers.wait_for_more(READERS * RECORDS)
                readers.longest_wait = 0.0
                before, since = readers.acknowledged(), time.monotonic()
                readers.wait(lambda: time.monotonic() - since >= seconds and readers.acknowledged() > before, seconds + 120)
                rate = (readers.acknowledged() - before) / (time.monotonic() - since)
                figures["rates"][delay], figures["longest_wait_ms"][delay] = round(rate), round(readers.longest_wait * 1000)
                say(f"{delay} ms a sync: {rate:,.0f} reads a second acknowledged, longest wait {readers.longest_wait * 1000:.0f} ms")
            faults.slow_syncs(0)
            figures["drained"] = readers.drain()
            gateway.stop()
            figures.update(vars(readers.check(stored_tags(gateway.db))))
        finally:
            readers.close()
            gateway.dispose()
    return figures
