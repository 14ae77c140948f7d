"""What a proof runs on: the gateway, its destinations, and the virtual readers that keep the books."""

import http.client
import json
import os
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import tempfile
import time
from pathlib import Path

from . import destinations
from .processes import PATIENCE, Died, Program, Trouble, built, free_port, wait_for
from .proxy import Proxy

ID = "prove"


class _Socket(http.client.HTTPConnection):
    def __init__(self, path):
        super().__init__("gantry", timeout=60)
        self._path = str(path)

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self._path)


class Readers:
    """gantry_ledger_readers; it outlives the gateway and comes back to it by itself."""

    def __init__(self, home, build, connect, counts, rate, dagprog_rate=2.0):
        self.home, self.file = Path(home), Path(home) / "readers.json"
        arguments = [built("gantry_ledger_readers", build), "--connect", f"127.0.0.1:{connect}", "--pty-dir", home, "--rate", rate,
                     "--dagprog-rate", dagprog_rate, "--ledger", self.file]
        for kind, count in counts.items():
            arguments += [f"--{kind}", count]
        self.process = Program(arguments, self.home / "readers.log")
        self.start_figures = json.loads(self.process.line("ready ").split(" ", 1)[1])

    def figures(self):
        self.process.say("figures")
        return json.loads(self.process.line("figures ").split(" ", 1)[1])

    def acknowledged(self):
        return sum(each["acknowledged"] for each in self.figures() if each["acknowledges"])

    def begin(self):
        self.process.say("begin")
        self.process.line("done")

    def set_rate(self, rate):
        self.process.say(f"rate {rate}")
        self.process.line("done")

    def stop(self):
        """No more reads; what each of them knows once all that waited for an acknowledgement has it."""
        self.process.say("stop")
        word, figures = self.process.line("final ", "undrained ").split(" ", 1)
        if word == "undrained":
            raise Trouble(f"the gateway does not acknowledge all that the readers hold: {figures}")
        return json.loads(figures)

    def close(self):
        if self.process.running():
            self.process.kill()


class Site:
    """`readers`: how many of each kind, by the words of gantry_ledger_readers (silion, silion-plain, harting, caen, dagprog).
    With `proxies` a Proxy stands between the gateway and each reader that has a network; `proxies` may also be what makes one, of
    the port behind it and whether readers dial it."""

    def __init__(self, build, sinks, readers, rate, env=None, more="", sink_more=None, proxies=False, keep=False,
                 heartbeat="1s"):
        self.build, self.env, self.more, self._keep = build, dict(env or {}), more, keep
        self.heartbeat = heartbeat
        self.home = Path(tempfile.mkdtemp(prefix="gantry-prove-"))
        os.chmod(self.home, 0o711)  # PostgreSQL's user must get to its own directory
        self.data = self.home / "data"
        self.process = self.readers = None
        self.starts, self.sinks = [], {}
        self.settled = 0  # sinks have been waited for up to this event; tags go on to be lost while the gateway stops
        try:
            self.sinks = destinations.make(sinks, self.home, build, sink_more)
            for each in self.sinks.values():
                each.start()
            self.port = free_port()
            self._make_proxy = proxies if callable(proxies) else lambda port, readers_dial: Proxy(port)
            self.proxies = [self._make_proxy(self.port, True)] if proxies else []
            self.readers = Readers(self.home, build, self.proxies[0].port if proxies else self.port, readers, rate)
            self._configure(proxies)
        except BaseException:
            self.close()
            raise

    def _configure(self, proxies):
        toml = [f'[gateway]\nid = "{ID}"\ndata_dir = "{self.data}"\n[events]\ntag_read = true\n{self.more}']
        # Both dial; the longer name first: the first section that fits counts.
        toml.append(f'[[reader]]\nname = "*"\naddress = "silion-listen://127.0.0.1:{self.port}"\nheartbeat = "{self.heartbeat}"\n')
        for each in self.readers.start_figures:
            if each["make"] == "silion":
                continue
            place = each["place"]
            if proxies and each["make"] != "dagprog":
                self.proxies.append(self._make_proxy(int(place.rsplit(":", 1)[1]), False))
                place = f"127.0.0.1:{self.proxies[-1].port}"
            toml.append(f'[[reader]]\nname = "{each["name"]}"\naddress = "{each["make"]}://{place}"\n')
            if each["make"] == "harting":
                toml.append('mode = "buffered"\npoll = "20ms"\nvalid_time = "100ms"\n')
                if int(each["name"].rsplit("-", 1)[1]) % 2 == 0:  # every second one notifies instead
                    toml[-1] = f'notify = "127.0.0.1:{free_port()}"\nkeepalive = "1s"\nvalid_time = "100ms"\n'
        toml += [each.section() for each in self.sinks.values()]
        (self.home / "gantry.toml").write_text("\n".join(toml))

    # --- the gateway

    def start(self, env=None):
        begun = time.monotonic()
        self.process = Program([built("gantry", self.build), "run", "-c", self.home / "gantry.toml"], self.home / "gantry.log",
                               env={**self.env, **(env or {})})
        self.process.line("ready")
        self.starts.append(time.monotonic() - begun)
        if len(self.starts) == 1:  # what is read before somebody can hear it is lost where nobody acknowledges
            self.readers.begin()

    def launch(self, env=None):
        """Without waiting until it is ready: it may die before."""
        self.process = Program([built("gantry", self.build), "run", "-c", self.home / "gantry.toml"], self.home / "gantry.log",
                               env={**self.env, **(env or {})})

    def kill(self):
        self.process.kill()

    def stop(self):
        code = self.process.stop()
        if code:
            raise Trouble(f"the gateway ended with {code}: {self.process.said()}")

    def died(self):
        """Waits until it has died by itself, as by kill -9."""
        code = self.process.wait()
        if code != -signal.SIGKILL:
            raise Trouble(f"the gateway ended with {code}, not at the failpoint: {self.process.said()}")

    def ask(self, path, method="GET", body=None):
        connection = _Socket(self.data / "gantry.sock")
        try:
            connection.request(method, path, json.dumps(body) if body is not None else None)
            answer = connection.getresponse()
            text = answer.read()
            if answer.status >= 400:
                raise Trouble(f"{method} {path}: {answer.status} {text.decode(errors='replace')}")
            return json.loads(text) if text else {}
        except (OSError, http.client.HTTPException) as error:
            if self.process.ends_soon():
                raise Died(f"the gateway has ended with {self.process.wait()}: {self.process.said()}") from error
            raise Trouble(f"{method} {path}: {error}") from error
        finally:
            connection.close()

    def sink(self, name):
        return next(each for each in self.ask("/api/v1/sinks")["sinks"] if each["name"] == name)

    def gantry(self, *arguments):
        done = subprocess.run([built("gantry", self.build), *map(str, arguments), "--data-dir", self.data], capture_output=True,
                              text=True, check=False, timeout=PATIENCE)
        if done.returncode:
            raise Trouble(f"gantry {' '.join(map(str, arguments))}: {done.stderr}")
        return done.stdout

    # --- the flow

    def wait_for_flow(self, more=1):
        """Readers are served: more reads are acknowledged than before."""
        before = self.readers.acknowledged()
        wait_for(lambda: self.readers.acknowledged() >= before + more, lambda: f"reads are acknowledged; {self.process.said()}")

    def wait_for_delivery(self):
        """Every sink works, under load."""
        wait_for(lambda: all(each["delivered"] and "trouble" not in each for each in self.ask("/api/v1/sinks")["sinks"]),
                 lambda: f"every sink delivers: {self.ask('/api/v1/sinks')}")

    def wait_for_sinks(self, names=None, patience=600.0):
        """All that is stored by now is delivered, is not wanted or is a dead letter. Up to which event that is."""
        last = self.ask("/api/v1/status")["last_seq"]

        def waiting():
            return {each["name"]: each.get("trouble", each["behind"]) for each in self.ask("/api/v1/sinks")["sinks"]
                    if each["cursor"] < last and each["name"] in (names or self.sinks)}
        wait_for(lambda: not waiting(), lambda: f"the sinks have all up to event {last}: {waiting()}", patience, every=0.05)
        return last

    def finish(self):
        """Ends the reading, waits until everything is where it belongs, stops the gateway. What the readers know."""
        figures = self.readers.stop()
        self._settle()
        self.wait_for_sinks()
        # What the gateway tells of itself at its end is for its next start: those events are delivered then.
        self.stop()
        self.readers.process.say("end")
        self.readers.process.wait()
        self.start()
        self.settled = self.wait_for_sinks()
        self.stop()
        return figures

    def _settle(self):
        """Reads of readers that nobody acknowledges come a moment later."""
        last, since = -1, time.monotonic()
        while time.monotonic() - since < 0.5:
            now = self.ask("/api/v1/status")["last_seq"]
            if now != last:
                last, since = now, time.monotonic()
            time.sleep(0.05)

    # --- what it stored

    def store(self):
        return sqlite3.connect(f"file:{self.data}/gantry.db?mode=ro", uri=True, timeout=60)

    def log_lines(self, pattern):
        return [line for line in (self.home / "gantry.log").read_text(errors="replace").splitlines() if re.search(pattern, line)]

    def close(self):
        if self.process and self.process.running():
            self.process.kill()
        if self.readers:
            self.readers.close()
        for each in self.sinks.values():
            each.close()
        for each in getattr(self, "proxies", []):
            each.close()
        if self._keep:
            print(f"kept: {self.home}")
        else:
            shutil.rmtree(self.home, ignore_errors=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
