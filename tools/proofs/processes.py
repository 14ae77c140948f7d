"""Programs beside us: where they are, how they are started, watched and ended. Nothing waits for a fixed time."""

import os
import random
import select
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 120.0  # seconds for what should take a moment: the machine may be busy


class Trouble(Exception):
    """The proof could not be run to its end: neither passed nor failed."""


class Died(Trouble):
    """The gateway ended when nobody ended it: the proof has failed."""


class NotHere(Trouble):
    """It cannot be proved on this machine; says why."""


def wait_for(condition, what, patience=PATIENCE, every=0.02):
    """The first true value of condition()."""
    end = time.monotonic() + patience
    while True:
        if value := condition():
            return value
        if time.monotonic() > end:
            raise Trouble(f"{patience:g} s passed and not: {what() if callable(what) else what}")
        time.sleep(every)


def free_port():
    """Below the range from which the system takes ports for connections: nobody takes it while a server is down."""
    any_port = random.SystemRandom()  # not of the seed: proofs with equal seeds may run at the same time
    for _ in range(1000):
        port = any_port.randrange(10_000, 30_000)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise Trouble("no free port on loopback")


def answers(port):
    with socket.socket() as probe:
        probe.settimeout(1)
        return probe.connect_ex(("127.0.0.1", port)) == 0


def find_program(name):
    found = shutil.which(name, path=os.environ.get("PATH", "") + ":/usr/sbin:/usr/local/sbin")
    if not found:
        raise Trouble(f"{name} is not installed; see tools/packages.txt")
    return found


def built(name, build):
    """A program of ours: in the build that was named, or beside the gantry that the environment names."""
    for place in (os.environ.get(name.upper()), f"{build}/bin/{name}",
                  os.environ.get("GANTRY_BINARY") if name == "gantry" else None):
        if place and os.access(place, os.X_OK):
            return place
    raise Trouble(f"{name} is not in {build}/bin; build it with ./dev build dev, or name a build with --build DIR")


class Program:
    """A process whose stdout we read line by line; its stderr goes to a file."""

    def __init__(self, arguments, log, env=None, cwd=None):
        self.arguments = [str(each) for each in arguments]
        self._log = Path(log)
        with open(self._log, "ab") as file:
            self._process = subprocess.Popen(self.arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=file,
                                             env={**os.environ, **(env or {})}, cwd=cwd)
        self._rest = b""

    @property
    def pid(self):
        return self._process.pid

    def running(self):
        return self._process.poll() is None

    def ends_soon(self):
        """It has ended, or does so in a moment."""
        try:
            self._process.wait(2)
        except subprocess.TimeoutExpired:
            return False
        return True

    def say(self, line):
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def line(self, *beginnings, patience=PATIENCE):
        """The next line of its stdout that begins so; others are passed over."""
        end = time.monotonic() + patience
        pipe = self._process.stdout.fileno()
        while True:
            while b"\n" in self._rest:
                line, self._rest = self._rest.split(b"\n", 1)
                text = line.decode("utf-8", "replace")
                if text.startswith(beginnings):
                    return text
            left = end - time.monotonic()
            if left <= 0 or not select.select([pipe], [], [], left)[0]:
                raise Trouble(f"{Path(self.arguments[0]).name} did not say {beginnings} within {patience:g} s; {self.said()}")
            if not (piece := os.read(pipe, 65536)):
                raise Trouble(f"{Path(self.arguments[0]).name} ended with {self._process.wait()}; {self.said()}")
            self._rest += piece

    def said(self):
        """The end of what it wrote to its log."""
        return self._log.read_text(errors="replace")[-2000:]

    def signal(self, number):
        self._process.send_signal(number)

    def wait(self, patience=PATIENCE):
        try:
            code = self._process.wait(patience)
        except subprocess.TimeoutExpired:
            raise Trouble(f"{Path(self.arguments[0]).name} does not end; {self.said()}") from None
        for pipe in (self._process.stdin, self._process.stdout):
            try:
                pipe.close()
            except OSError:
                pass  # it was gone before what we said to it had left
        return code

    def kill(self):
        if self.running():
            self.signal(signal.SIGKILL)
        return self.wait()

    def stop(self, patience=PATIENCE):
        if self.running():
            self.signal(signal.SIGTERM)
        return self.wait(patience)

    def memory_kib(self):
        for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1])
        return 0
