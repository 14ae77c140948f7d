"""The product as its user runs it: starts the real `gantry`, and looks at what it prints, stores and answers.

Nothing here waits for a fixed time: `wait_for` polls a condition up to a deadline. Every port is one that the system
chose; a gateway that is started again listens where it listened before.
"""

import http.client
import json
import os
import re
import select
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

BINARY = os.environ.get("GANTRY_BINARY", "gantry")
# Seconds for what should take milliseconds: the machine may be busy.
DEADLINE = float(os.environ.get("GANTRY_E2E_DEADLINE", "20"))
READER = """
[[reader]]
name = "gate-*"
address = "silion-listen://127.0.0.1:0"
zone = "gate"
heartbeat = "60s"
"""
EVERY_READ = "[events]\ntag_read = true\n"


def wait_for(condition, what, deadline=DEADLINE):
    """The first true value of condition(), or a failure that says what did not happen."""
    end = time.monotonic() + deadline
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > end:
            raise AssertionError(f"{deadline:g} s passed and not: {what() if callable(what) else what}")
        time.sleep(0.01)


def complaint_of_a_sanitizer(text):
    found = re.search(r"(ERROR: \w+Sanitizer|runtime error:|WARNING: ThreadSanitizer)", text)
    return text[found.start():] if found else ""


class Output:
    """A pipe of a process, read by a thread as it comes, kept whole."""

    def __init__(self, pipe):
        self._pipe, self._data, self._stop = pipe, bytearray(), threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        pipe = self._pipe.fileno()
        while not self._stop.is_set():
            if not select.select([pipe], [], [], 0.1)[0]:
                continue
            if not (piece := os.read(pipe, 65536)):
                break
            self._data += piece

    def text(self):
        return bytes(self._data).decode("utf-8", "replace")

    def lines(self):
        """Whole lines only."""
        return self.text().split("\n")[:-1]

    def hang_up(self):
        self._stop.set()
        self.close()

    def close(self):
        self._thread.join(DEADLINE)
        self._pipe.close()


class Process:
    """A gantry command under way."""

    def __init__(self, arguments, stdin=subprocess.DEVNULL, env=None, cwd=None, command=()):
        self.arguments = [str(each) for each in arguments]
        self._process = subprocess.Popen([*map(str, command or (BINARY,)), *self.arguments], stdin=stdin, stdout=subprocess.PIPE,
                                         stderr=subprocess.PIPE, env=env, cwd=cwd)
        self.out, self.err = Output(self._process.stdout), Output(self._process.stderr)
        self._closed = False

    @property
    def pid(self):
        return self._process.pid

    def running(self):
        return self._process.poll() is None

    def say(self, line):
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def wait_for_line(self, pattern, deadline=DEADLINE):
        """The match of the first line on stdout that fits."""
        def find():
            for line in self.out.lines():
                if found := re.search(pattern, line):
                    return found
            if not self.running():
                self.wait()
                raise AssertionError(f"gantry {' '.join(self.arguments)} ended: {self.out.text()}{self.err.text()}")
            return None
        return wait_for(find, lambda: f"a line like {pattern}; there is: {self.out.text()}{self.err.text()}", deadline)

    def wait(self, deadline=DEADLINE):
        """Its exit code."""
        code = self._process.wait(deadline)
        if not self._closed:
            self._closed = True
            self.out.close()
            self.err.close()
            if self._process.stdin:
                self._process.stdin.close()
            if trouble := complaint_of_a_sanitizer(self.err.text()):
                raise AssertionError(trouble)
        return code

    def close_output(self):
        """As `| head` does: nobody reads its stdout any more."""
        self.out.hang_up()

    def send_signal(self, number):
        self._process.send_signal(number)

    def end(self, number=signal.SIGTERM, deadline=DEADLINE):
        if self.running():
            self.send_signal(number)
        return self.wait(deadline)

    def memory_mib(self):
        status = Path(f"/proc/{self.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024

    def open_files(self):
        return len(os.listdir(f"/proc/{self.pid}/fd"))

    def is_sanitized(self):
        """Under AddressSanitizer memory is another matter: terabytes are set aside, and what is freed is kept."""
        status = Path(f"/proc/{self.pid}/status").read_text()
        return int(re.search(r"VmSize:\s+(\d+)", status)[1]) > 1 << 30


class Done:
    """What a command that has ended left behind."""

    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err

    def json_lines(self):
        return [json.loads(line) for line in self.out.splitlines()]


def run(*arguments, text="", env=None, cwd=None, deadline=DEADLINE):
    data = text if isinstance(text, bytes) else text.encode()
    ended = subprocess.run([BINARY, *map(str, arguments)], input=data, capture_output=True, env=env, cwd=cwd,
                           timeout=deadline, check=False)
    done = Done(ended.returncode, ended.stdout.decode("utf-8", "replace"), ended.stderr.decode("utf-8", "replace"))
    if trouble := complaint_of_a_sanitizer(done.err):
        raise AssertionError(trouble)
    return done


class UnixConnection(http.client.HTTPConnection):
    def __init__(self, path):
        super().__init__("gantry", timeout=DEADLINE)
        self._path = str(path)

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self._path)


class Answer:
    def __init__(self, status, kind, body):
        self.status, self.kind, self.body = status, kind, body

    def json(self):
        return json.loads(self.body)


class Store:
    """gantry.db through a connection of our own, as any SQLite tool would open it."""

    def __init__(self, path):
        self._db = sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=DEADLINE)
        self._db.row_factory = sqlite3.Row

    def rows(self, sql, *values):
        return [{key: row[key] for key in row.keys() if row[key] is not None}
                for row in self._db.execute(sql, values).fetchall()]

    def number(self, sql, *values):
        return self._db.execute(sql, values).fetchone()[0]

    def close(self):
        self._db.close()


class Gateway:
    """`gantry run` with a configuration and a data directory that outlive it."""

    def __init__(self, toml=READER, head='id = "e2e"', env=None):
        self.home = Path(tempfile.mkdtemp(prefix="gantry-e2e-"))
        self.data = self.home / "data"
        self.config = self.home / "gantry.toml"
        self.toml, self._head, self.env = toml, head, env
        self.ports, self._places = [], 0
        self.process, self.log_before, self._stores = None, "", []

    def write_config(self):
        """Ports that are known by now take the place of 0, in order."""
        known = iter(self.ports)
        toml = re.sub(r"127\.0\.0\.1:0\b", lambda any_port: f"127.0.0.1:{next(known, 0)}", self.toml)
        self.config.write_text(f'[gateway]\n{self._head}\ndata_dir = "{self.data}"\n{toml}')
        return self.config

    def launch(self):
        """Starts without waiting for anything."""
        env = {**os.environ, **self.env} if self.env else None
        self.process = Process(["run", "-c", self.write_config()], env=env)
        return self.process

    def start(self):
        self.launch()
        self.process.wait_for_line("^ready$")
        lines = self.process.out.lines()
        self.ports = [int(line.rsplit(":", 1)[1]) for line in lines if line.startswith("listening on ")]
        return self

    @property
    def port(self):
        return self.ports[0]

    def running(self):
        return self.process is not None and self.process.running()

    def stop(self):
        code = self.process.end()
        self._forget()
        if code != 0:
            raise AssertionError(f"gantry run ended with {code}: {self.log_before}")

    def kill(self):
        self.process.end(signal.SIGKILL)
        self._forget()

    def restart(self):
        self.stop()
        return self.start()

    def kill_and_restart(self):
        self.kill()
        return self.start()

    def _forget(self):
        self.log_before += self.process.err.text()
        self.process = None

    def dispose(self):
        for store in self._stores:
            store.close()
        try:
            if self.running():
                self.stop()
        finally:
            if self.process is not None and self.process.running():
                self.process.end(signal.SIGKILL)
            sys.stderr.write(self.log())  # ctest shows it when the test failed
            shutil.rmtree(self.home, ignore_errors=True)

    # What it says.

    def log(self):
        return self.log_before + (self.process.err.text() if self.process else "")

    def messages(self):
        """The log's messages; it is JSON lines, because stderr is no terminal."""
        return [json.loads(line)["message"] for line in self.log().split("\n")[:-1] if line.startswith("{")]

    def wait_for_message(self, pattern, deadline=DEADLINE):
        find = lambda: next((each for each in self.messages() if re.search(pattern, each)), None)
        return wait_for(find, lambda: f"a log message like {pattern}; the log: {self.log()}", deadline)

    # What it stored.

    @property
    def db(self):
        return self.data / "gantry.db"

    def store(self):
        """A connection that stays open until the test ends."""
        if not self._stores:
            self._stores.append(Store(self.db))
        return self._stores[0]

    def events(self, *types, **fields):
        """From the view, in order."""
        rows = self.store().rows("SELECT * FROM events ORDER BY seq")
        return [row for row in rows if (not types or row["type"] in types)
                and all(row.get(key) == value for key, value in fields.items())]

    def wait_for_events(self, count, *types, deadline=DEADLINE, **fields):
        find = lambda: len(found := self.events(*types, **fields)) >= count and found
        seen = lambda: f"{count} events {types} {fields}; there are {[row['type'] for row in self.events()]}"
        return wait_for(find, seen, deadline)

    def present(self):
        return self.store().rows("SELECT * FROM present_tags ORDER BY tag")

    def reads_of(self, tag=None):
        where, values = ("AND tag = ?", [tag]) if tag else ("", [])
        return self.store().number(f"SELECT coalesce(sum(reads), 0) FROM events WHERE type = 'tag.read' {where}", *values)

    # What it answers.

    def ask(self, method, path, body=None, headers=None):
        connection = UnixConnection(self.data / "gantry.sock")
        try:
            data = json.dumps(body) if body is not None and not isinstance(body, (str, bytes)) else body
            connection.request(method, path, data, headers or {})
            answer = connection.getresponse()
            return Answer(answer.status, answer.getheader("content-type"), answer.read())
        finally:
            connection.close()

    def status(self):
        return self.ask("GET", "/api/v1/status").json()

    def listener(self):
        return self.status()["listeners"][0]

    def cli(self, *arguments, **more):
        """A command against this gateway; its place goes before a bare `--`, where there is one."""
        return run(*arguments, "--data-dir", self.data, **more)

    def begin(self, *arguments, **more):
        return Process([*arguments, "--data-dir", self.data], **more)

    def query(self, *arguments):
        done = self.cli("events", "query", "--json", *arguments)
        if done.code != 0:
            raise AssertionError(done.err)
        return done.json_lines()

    def reader_info(self, name):
        done = self.cli("reader", "info", name, "--json")
        if done.code != 0:
            raise AssertionError(done.err)
        return json.loads(done.out)


class EndToEnd(unittest.TestCase):
    maxDiff = None

    def gateway(self, toml=READER, start=True, **more):
        gateway = Gateway(toml, **more)
        self.addCleanup(gateway.dispose)
        return gateway.start() if start else gateway

    def directory(self):
        path = Path(tempfile.mkdtemp(prefix="gantry-e2e-"))
        self.addCleanup(shutil.rmtree, path, ignore_errors=True)
        return path

    def under_way(self, process):
        """A process of the test's own, ended with it."""
        self.addCleanup(lambda: process.running() and process.end(signal.SIGKILL))
        return process

    def assert_done(self, done):
        self.assertEqual(0, done.code, done.out + done.err)
        return done

    def assert_refused(self, done, *words, code=1):
        """One clear line on stderr that holds the words, nothing on stdout."""
        self.assertEqual(code, done.code, done.out + done.err)
        self.assertEqual("", done.out)
        said = [line for line in done.err.splitlines() if not line.startswith("{")]
        self.assertEqual(1, len(said), done.err)
        for word in words:
            self.assertIn(str(word), said[0])
