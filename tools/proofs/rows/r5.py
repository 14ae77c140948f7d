"""R5: the disk fails."""

import os
import subprocess

from ..end_to_end import built_in, judge_books, judge_troubles
from ..failing_disks import failing_disks, kills_while_failing
from ..processes import Trouble, built

TITLE = "EIO at the N-th write, sync and open of the store"
PASS = "nothing is acknowledged while it fails, it is shown, it goes on by itself, and nothing acknowledged is lost"


def options(parser):
    parser.add_argument("--last", type=int, help="N goes from 1 to this (default 200, quick 3)")


def run(proof):
    given = proof.options
    last = given.last or (3 if given.quick else 200)
    with built_in(given.build):
        if given.bite:
            figures = kills_while_failing(min(last, 10), "ack_before_commit")
            proof.figure("killed while it failed", min(last, 10))
        else:
            figures = failing_disks(last, say=proof.say)
            proof.figure("faults", figures["faults"])
            proof.figure("of them lasting until mended", figures["lasting"])
            proof.must_be_zero("acknowledged while it failed", figures["acknowledged_while_failing"], loss=True)
            proof.figure("longest return after it was mended", figures["longest_return_ms"], "ms")
    judge_books(proof, figures)
    judge_troubles(proof, figures)
    if not given.quick and not given.bite:
        below_sqlite(proof, last)


def below_sqlite(proof, last):
    """The same inside one process, at SQLite's own calls: half a write arrives, and files are opened at every commit."""
    program = built("gantry_journal_test", proof.options.build)
    done = subprocess.run([program, "--gtest_brief=1", "--gtest_filter=Faults.*LosesAndDoublesNothing"],
                          env={**os.environ, "GANTRY_FAULTS_UP_TO": str(last)}, capture_output=True, text=True, check=False)
    if "[  PASSED  ]" not in done.stdout and "[  FAILED  ]" not in done.stdout:
        raise Trouble(f"{program} did not run: {done.stdout}{done.stderr}")
    proof.must("at each of so many writes, syncs and opens below SQLite", done.returncode == 0, last)
