"""A disk under the store that is slow, or fails at the N-th call: disk_faults.cpp, built when it is needed, and told
what to do while the gateway runs."""

import errno
import mmap
import os
import shlex
import struct
import subprocess
from pathlib import Path

WRITE, SYNC, OPEN = 1, 2, 3
NAMES = {WRITE: "write", SYNC: "sync", OPEN: "open"}
_ERROR, _BEFORE, _FAILURES, _FAILED, _MADE, _SYNC_US = range(0, 24, 4)  # places in the file, those of calls by call
_SIZE = 128


class DiskFaults:
    def __init__(self, directory):
        self._library, control = Path(directory) / "disk_faults.so", Path(directory) / "disk_faults"
        compiler = shlex.split(os.environ.get("CXX", "c++"))
        subprocess.run([*compiler, "-std=c++20", "-O1", "-fPIC", "-shared", "-o", self._library,
                        Path(__file__).with_name("disk_faults.cpp"), "-ldl"], check=True)
        control.write_bytes(bytes(_SIZE))
        with control.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _SIZE)
        # AddressSanitizer wants to be the first library; here it need not be.
        options = ":".join(filter(None, [os.environ.get("ASAN_OPTIONS"), "verify_asan_link_order=0"]))
        self.env = {"LD_PRELOAD": str(self._library), "GANTRY_DISK_FAULTS": str(control), "ASAN_OPTIONS": options}

    def _get(self, place):
        return struct.unpack_from("i", self._map, 4 * place)[0]

    def _set(self, place, value):
        struct.pack_into("i", self._map, 4 * place, value)

    def fail(self, call, at, failures=1, error=errno.EIO):
        """The at-th call from now (1 is the next) and those after it, `failures` in all; -1: until heal()."""
        self._set(_FAILURES + call, 0)
        for place, value in ((_ERROR, error), (_BEFORE, at - 1), (_FAILED, 0), (_FAILURES, failures)):
            self._set(place + call, value)

    def heal(self):
        for call in NAMES:
            self._set(_FAILURES + call, 0)

    def failed(self, call):
        return self._get(_FAILED + call)

    def made(self, call):
        return self._get(_MADE + call)

    def slow_syncs(self, seconds):
        self._set(_SYNC_US, int(seconds * 1e6))
