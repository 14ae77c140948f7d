#!/usr/bin/env python3
"""Runs the benchmarks (gantry_micro, gantry_load and gantry_sink_load) in turn, several times, and prints the medians beside the
machine's own limits. docs/performance.md says what each figure means."""
import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time

import bench_sinks

# What of Google Benchmark's figures becomes which result: benchmark, result, field, factor, unit.
MICRO = [
    ("silion_decode/crc", "decode_silion_tags_per_s", "items_per_second", 1, "tags/s"),
    ("silion_decode/no_crc", "decode_silion_no_crc_tags_per_s", "items_per_second", 1, "tags/s"),
    ("silion_decode_one_by_one/whole", "decode_silion_whole_tags_per_s", "items_per_second", 1, "tags/s"),
    ("silion_decode_one_by_one/cut", "decode_silion_cut_tags_per_s", "items_per_second", 1, "tags/s"),
    ("silion_driver", "driver_silion_tags_per_s", "items_per_second", 1, "tags/s"),
    ("caen_decode", "decode_caen_tags_per_s", "items_per_second", 1, "tags/s"),
    ("harting_decode", "decode_harting_tags_per_s", "items_per_second", 1, "tags/s"),
    ("dagprog_decode", "decode_dagprog_lines_per_s", "items_per_second", 1, "lines/s"),
    ("bare_decode", "raw_decode_tags_per_s", "items_per_second", 1, "tags/s"),
    ("crc16/64", "crc16_bytes_per_s", "bytes_per_second", 1, "B/s"),
    ("crc16/8192", "crc16_8k_bytes_per_s", "bytes_per_second", 1, "B/s"),
    ("bare_crc16_bytewise/64", "raw_crc16_bytewise_bytes_per_s", "bytes_per_second", 1, "B/s"),
    ("bare_memcpy/67108864", "raw_memcpy_bytes_per_s", "bytes_per_second", 1, "B/s"),
    ("epc_sgtin96", "epc_sgtin96_ns", "cpu_time", 1, "ns"),
    ("event_json", "event_json_ns", "cpu_time", 1, "ns"),
    ("bare_event_copy", "raw_event_copy_ns", "cpu_time", 1, "ns"),
    ("presence_sighting/1000", "presence_1k_ns_per_read", "cpu_time", 1, "ns"),
    ("presence_sighting/100000", "presence_ns_per_read", "cpu_time", 1, "ns"),
    ("bare_lookup/1000", "raw_lookup_1k_ns", "cpu_time", 1, "ns"),
    ("bare_lookup/100000", "raw_lookup_ns", "cpu_time", 1, "ns"),
    ("journal_reads/1000/real_time", "journal_reads_per_s", "items_per_second", 1, "reads/s"),
    ("journal_reads/10000/real_time", "journal_10k_reads_per_s", "items_per_second", 1, "reads/s"),
    ("journal_rows/1000/real_time", "journal_rows_per_s", "items_per_second", 1, "rows/s"),
    ("bare_append_sync/real_time", "raw_append_sync_ms", "real_time", 1e-6, "ms"),
    ("bare_sqlite/rows/1000/real_time", "raw_sqlite_rows_per_s", "items_per_second", 1, "rows/s"),
    ("bare_sqlite/blobs/1000/real_time", "raw_sqlite_blob_records_per_s", "items_per_second", 1, "records/s"),
    ("bare_sqlite/blobs/10000/real_time", "raw_sqlite_10k_blob_records_per_s", "items_per_second", 1, "records/s"),
]

# The table: heading, then lines of result and the limit that it is compared with.
TABLE = [
    ("Decode", [
        ("decode_silion_tags_per_s", "raw_decode_tags_per_s"),
        ("decode_silion_no_crc_tags_per_s", "decode_silion_tags_per_s"),
        ("decode_silion_cut_tags_per_s", "decode_silion_whole_tags_per_s"),
        ("driver_silion_tags_per_s", "decode_silion_whole_tags_per_s"),
        ("decode_caen_tags_per_s", "raw_decode_tags_per_s"),
        ("decode_harting_tags_per_s", "raw_decode_tags_per_s"),
        ("decode_dagprog_lines_per_s", None),
        ("crc16_bytes_per_s", "raw_crc16_bytewise_bytes_per_s"),
        ("crc16_8k_bytes_per_s", "raw_memcpy_bytes_per_s"),
    ]),
    ("Tags and events", [
        ("epc_sgtin96_ns", None),
        ("event_json_ns", "raw_event_copy_ns"),
        ("presence_1k_ns_per_read", "raw_lookup_1k_ns"),
        ("presence_ns_per_read", "raw_lookup_ns"),
    ]),
    ("Journal", [
        ("raw_append_sync_ms", None),
        ("journal_reads_per_s", "raw_sqlite_blob_records_per_s"),
        ("journal_10k_reads_per_s", "raw_sqlite_10k_blob_records_per_s"),
        ("journal_rows_per_s", "raw_sqlite_rows_per_s"),
    ]),
    ("End to end", [
        ("raw_loopback_frames_per_s", None),
        ("raw_loopback_10_a_send_frames_per_s", None),
        ("e2e_durable_reads_per_s", "raw_acknowledge_reads_per_s"),
        ("e2e_durable_reads_per_s", "raw_journal_records_per_s"),
        ("e2e_durable_reads_per_core_s", None),
        ("e2e_presence_reads_per_s", "raw_acknowledge_reads_per_s"),
        ("e2e_presence_reads_per_core_s", None),
        ("e2e_durable_single_reads_per_s", "raw_acknowledge_single_reads_per_s"),
        ("e2e_durable_new_tags_reads_per_s", "raw_sqlite_rows_per_s"),
        ("ack_latency_p50_ms", "raw_append_sync_ms"),
        ("ack_latency_p99_ms", "raw_append_sync_ms"),
        ("ack_latency_p99_ms_at_100k", None),
        ("e2e_durable_held_percent_at_50k", None),
        ("e2e_durable_held_percent_at_100k", None),
        ("e2e_durable_cpu_percent_at_50k", None),
    ]),
    ("Sinks", bench_sinks.LINES),
    ("Start and rest", [
        ("ready_ms", None),
        ("idle_connection_bytes", None),
        ("idle_rss_1000_readers_bytes", None),
        ("idle_rss_5000_readers_bytes", None),
        ("idle_rss_10000_readers_bytes", None),
        ("idle_cpu_percent", None),
    ]),
]


class BenchError(Exception):
    """A benchmark failed: what and why, for people."""


class Results:
    """Figures by name, every run kept."""

    def __init__(self):
        self.figures = {}

    def add(self, name, value, unit):
        self.figures.setdefault(name, (unit, []))[1].append(value)

    def add_lines(self, lines):
        for line in lines:
            figure = json.loads(line)
            self.add(figure["name"], figure["value"], figure["unit"])

    def median(self, name):
        return statistics.median(self.figures[name][1]) if name in self.figures else None

    def as_list(self):
        return [{"name": name, "value": statistics.median(runs), "unit": unit, "runs": runs}
                for name, (unit, runs) in self.figures.items()]


class Programs:
    """The programs under one build directory, run with their data on the same disk."""

    def __init__(self, build, data_dir, smoke):
        self.bin = os.path.join(build, "bin")
        self.data_dir = data_dir
        self.environment = dict(os.environ, TMPDIR=data_dir)
        self.smoke = smoke
        for name in ("gantry", "gantry_micro", "gantry_load", "gantry_sink_load"):
            if not os.path.exists(os.path.join(self.bin, name)):
                raise BenchError(f"{name} is not in {self.bin}; build it first: ./dev build release")

    def run(self, name, *arguments):
        command = [os.path.join(self.bin, name), *arguments]
        try:
            done = subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=600,
                                  check=False)
        except subprocess.TimeoutExpired:
            raise BenchError(f"{' '.join(command)}: no end after 600 s") from None
        if done.returncode != 0:
            raise BenchError(f"{' '.join(command)} failed:\n{done.stderr.strip()}")
        return done.stdout

    def load(self, results, what, *arguments, gateway=False):
        if gateway:
            arguments += ("--gantry", os.path.join(self.bin, "gantry"))
        results.add_lines(self.run("gantry_load", what, *arguments).splitlines())


def run_micro(programs, results, repetitions, wanted):
    """All repetitions of all benchmarks, in random order, so that a slow moment hits no benchmark alone."""
    arguments = ["--benchmark_format=json", f"--benchmark_min_time={0.01 if programs.smoke else 0.1}",
                 f"--benchmark_repetitions={repetitions}", "--benchmark_enable_random_interleaving=true"]
    if wanted:
        arguments.append(f"--benchmark_filter={wanted}")
    report = json.loads(programs.run("gantry_micro", *arguments))
    names = {benchmark: rest for benchmark, *rest in MICRO}
    for run in report["benchmarks"]:
        if run.get("error_occurred"):
            raise BenchError(f"{run['name']}: {run['error_message']}")
        if run.get("run_type") == "iteration" and run["run_name"] in names:
            name, field, factor, unit = names[run["run_name"]]
            results.add(name, run[field] * factor, unit)


def run_load(programs, results, turns, say):
    """Each turn measures everything once: a ratio compares figures taken side by side."""
    seconds = "0.2" if programs.smoke else "1.5"
    short = "0.1" if programs.smoke else "0.7"
    readers = "20" if programs.smoke else "1000"
    for turn in range(turns):
        say(f"end to end, turn {turn + 1} of {turns}")
        for frames in ("1", "10"):
            programs.load(results, "loopback", "--connections", readers, "--frames-a-send", frames, "--seconds", short)
        programs.load(results, "acknowledge", "--readers", readers, "--seconds", short)
        programs.load(results, "store", "--seconds", short)
        rates = "2000,0" if programs.smoke else "50000,100000,0"
        programs.load(results, "pipeline", "--readers", readers, "--seconds", seconds, "--rates", rates, gateway=True)
        programs.load(results, "pipeline", "--presence", "--turns", "5", "--readers", readers, "--seconds", seconds,
                      gateway=True)
        for _ in range(1 if programs.smoke else 2):
            programs.load(results, "ready", gateway=True)
        if turn % 2 == 0:
            programs.load(results, "acknowledge", "--records", "1", "--readers", readers, "--seconds", short)
            programs.load(results, "pipeline", "--records", "1", "--readers", readers, "--seconds", short, gateway=True)
            programs.load(results, "pipeline", "--new-tags", "--readers", readers, "--seconds", seconds, gateway=True)
    say("idle readers")
    counts = "20,40" if programs.smoke else "1000,5000,10000"
    programs.load(results, "idle", "--readers", counts, "--seconds", "0.3" if programs.smoke else "3", gateway=True)


def short(value, unit):
    if unit == "bytes":
        return f"{value / 1024:,.1f} KiB" if value < 1 << 20 else f"{value / (1 << 20):,.1f} MiB"
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if "/" in unit and value >= size:
            return f"{value / size:.3g} {letter} {unit}"
    return f"{value:.3g} {unit}"


def print_table(results):
    width = max(len(name) for name in results.figures) + 2
    for heading, lines in TABLE:
        lines = [(name, limit) for name, limit in lines if name in results.figures]
        if not lines:
            continue
        print(f"\n{heading}")
        for name, limit in lines:
            unit, runs = results.figures[name]
            value = results.median(name)
            spread = f"{short(min(runs), unit)} to {short(max(runs), unit)}" if len(runs) > 1 else ""
            beside = ""
            if limit in results.figures and results.median(limit):
                limit_unit, most = results.figures[limit][0], results.median(limit)
                beside = f"{value / most:.2f} x {limit} {short(most, limit_unit)}"
            print(f"  {name:<{width}}{short(value, unit):>20}   {spread:<40}{beside}")


def check_shape(document):
    """The smoke test's question: is it all there, and a number above zero?"""
    wanted = {"decode_silion_tags_per_s", "decode_caen_tags_per_s", "decode_harting_tags_per_s",
              "decode_dagprog_lines_per_s", "e2e_durable_reads_per_s", "e2e_presence_reads_per_s",
              "raw_loopback_frames_per_s", "raw_journal_records_per_s", "epc_sgtin96_ns", "event_json_ns", "ready_ms",
              "idle_connection_bytes", *(name for line in bench_sinks.LINES for name in line)}
    found = {result["name"] for result in document["results"]}
    if wanted - found:
        raise BenchError(f"results are missing: {', '.join(sorted(wanted - found))}")
    for result in document["results"]:
        if not result["runs"] or not isinstance(result["value"], (int, float)) or not result["unit"]:
            raise BenchError(f"{result['name']} is no figure: {result}")
        if result["name"].endswith(("_per_s", "_ns")) and result["value"] <= 0:
            raise BenchError(f"{result['name']} is {result['value']}")
    if not document["machine"].get("cores"):
        raise BenchError("the machine has no cores")


def main():
    parser = argparse.ArgumentParser(prog="./dev bench", description=__doc__)
    parser.add_argument("--build", default="build/release", help="the build directory (default: %(default)s)")
    parser.add_argument("--json", metavar="FILE", help="write all figures with their runs into FILE")
    parser.add_argument("--only", choices=("micro", "load", "sinks"), help="one of the three parts")
    parser.add_argument("--filter", default="", help="micro: only benchmarks whose name matches this pattern")
    parser.add_argument("--turns", type=int, default=5, help="runs of each measurement (default: %(default)s)")
    parser.add_argument("--smoke", action="store_true", help="very short: do they run, and is nothing lost?")
    options = parser.parse_args()
    if options.turns < 1:
        parser.error("--turns must be at least 1")
    turns = 1 if options.smoke else options.turns
    started = time.monotonic()

    def say(text):
        print(f"[{time.monotonic() - started:4.0f} s] {text}", file=sys.stderr, flush=True)

    try:
        with tempfile.TemporaryDirectory(prefix="bench-", dir=options.build) as data_dir:
            os.chmod(data_dir, 0o711)  # PostgreSQL's user must get to its own directory
            programs = Programs(options.build, os.path.abspath(data_dir), options.smoke)
            results = Results()
            machine = json.loads(programs.run("gantry_load", "machine"))
            if options.only in (None, "micro"):
                say("single parts")
                run_micro(programs, results, turns, options.filter)
            if options.only in (None, "load"):
                run_load(programs, results, turns, say)
            if options.only in (None, "sinks"):
                bench_sinks.run_sinks(programs, results, turns, say)
        say("done")
        document = {"machine": machine, "results": results.as_list()}
        if options.smoke and not options.only:
            check_shape(document)
        if options.json:
            with open(options.json, "w", encoding="utf-8") as out:
                json.dump(document, out, indent=1)
                out.write("\n")
        print(f"{machine['cpu']}, {machine['cores']} cores, {machine['compiler']}, {machine['build']} build")
        print_table(results)
    except (BenchError, bench_sinks.SinkBenchError, bench_sinks.servers.ServerError, OSError) as error:
        print(f"bench: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
