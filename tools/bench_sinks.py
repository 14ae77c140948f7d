"""The sinks' part of the benchmarks: each beside a bare client of its library at the same server, and the drain of a
backlog while live reads go on. Starts the servers, with their data on the same disk as everything else."""

import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "e2e"))
import servers  # noqa: E402  # pylint: disable=wrong-import-position

KINDS = ("mqtt", "nats", "kafka", "postgres", "webhook", "jsonl")

# Figure, what it is compared with: for the table of tools/bench.py.
LINES = [(f"sink_{kind}_events_per_s", f"raw_{kind}_events_per_s") for kind in KINDS] + [
    (f"drain_{kind}_events_per_s", f"drain_{kind}_live_reads_per_s") for kind in KINDS if kind != "jsonl"]


class SinkBenchError(Exception):
    """A benchmark of a sink failed: what and why, for people."""


def is_open_to_all(place):
    place = Path(place).resolve()
    return all(each.stat().st_mode & 0o001 for each in (place, *place.parents))


class Stage:
    """The server of one kind, if it needs one, with a directory of its own."""

    def __init__(self, kind, data_dir, bin_dir):
        self.kind = kind
        # PostgreSQL runs as its own user, who may not be let into where this is built.
        below = None if kind == "postgres" and not is_open_to_all(data_dir) else data_dir
        self._directory = tempfile.TemporaryDirectory(prefix=f"{kind}-", dir=below)
        home = self._directory.name
        self.server = {"mqtt": lambda: servers.Mosquitto(home), "nats": lambda: servers.Nats(home),
                       "kafka": lambda: servers.KafkaCluster(os.path.join(bin_dir, "gantry_kafka_cluster")),
                       "postgres": lambda: servers.Postgres(home, sync=True),
                       "webhook": servers.WebReceiver, "jsonl": lambda: None}[kind]()
        self.place = self.server.url if self.server else home
        self.settings = {} if self.server else {"dir": home}

    def section(self, directory):
        file = Path(directory) / f"{self.kind}.toml"
        file.write_text(f'[[sink]]\nname = "bench"\ntype = "{self.kind}"\nurl = "{self.place}"\nstart = "oldest"\n'
                        'types = ["tag.read"]\nretry_min = "50ms"\nretry_max = "100ms"\n')
        return file

    def close(self):
        if self.server:
            self.server.kill()
        if hasattr(self.server, "close"):
            self.server.close()
        self._directory.cleanup()


def run_duel(programs, results, stage, turns):
    if stage.server:
        stage.server.start()
    words = [f"{name}={value}" for name, value in stage.settings.items()]
    seconds = "0.05" if programs.smoke else "1"
    arguments = ["--turns", str(turns), "--seconds", seconds, *(word for each in words for word in ("--set", each))]
    results.add_lines(programs.run("gantry_sink_load", "duel", stage.kind, stage.place, *arguments).splitlines())


def run_drain(programs, results, stage, rate, seconds):
    """The server comes when the program says that the backlog is there."""
    if stage.kind == "kafka":
        stage.server.kill()  # the cluster is up from the beginning, its brokers are not
    section = stage.section(stage.server.home if hasattr(stage.server, "home") else programs.data_dir)
    command = [os.path.join(programs.bin, "gantry_sink_load"), "drain", "--gantry", os.path.join(programs.bin, "gantry"),
               "--kind", stage.kind, "--sink", str(section), "--rate", str(rate), "--seconds", str(seconds)]
    with subprocess.Popen(command, env=programs.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True) as process:
        if process.stdout.readline() == "backlog\n":
            stage.server.start()
        out, err = process.communicate(timeout=600)
    if process.returncode != 0:
        raise SinkBenchError(f"{' '.join(command)} failed:\n{err.strip()}")
    results.add_lines(out.splitlines())


def run_sinks(programs, results, turns, say, kinds=KINDS):
    for kind in kinds:
        say(f"sink {kind}")
        with contextlib.closing(Stage(kind, programs.data_dir, programs.bin)) as stage:
            run_duel(programs, results, stage, turns)
        if kind == "jsonl":  # a file is never away
            continue
        with contextlib.closing(Stage(kind, programs.data_dir, programs.bin)) as stage:
            run_drain(programs, results, stage, *((2000, 0.3) if programs.smoke else (10000, 5)))

