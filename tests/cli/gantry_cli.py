"""Runs the real `gantry` for one command and looks at what it said. What follows a running gateway lies in tests/e2e."""

import os
import subprocess
from pathlib import Path

BINARY = os.environ.get("GANTRY_BINARY", "gantry")
ROOT = Path(__file__).resolve().parents[2]


class Ran:
    def __init__(self, done):
        self.code, self.raw = done.returncode, done.stdout
        self.out, self.err = done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace")

    def lines(self):
        return self.out.splitlines()


def gantry(*arguments, give=b""):
    given = give.encode() if isinstance(give, str) else give
    return Ran(subprocess.run([BINARY, *map(str, arguments)], input=given, capture_output=True, timeout=120))


def vectors():
    """(protocol, id, direction, bytes) of every vector of every make."""
    for file in sorted(ROOT.glob("src/protocols/*/tests/vectors.tsv")):
        for line in file.read_text().splitlines():
            if not line or line.startswith(("#", "id\t")):
                continue
            name, direction, text, *_ = line.split("\t")
            yield file.parts[-3], name, direction, bytes.fromhex(text)
