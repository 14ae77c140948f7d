"""R10: a slow disk."""

from ..end_to_end import built_in, judge_books
from ..processes import Trouble
from ..slow_disks import slow_disks

TITLE = "every sync takes 5, 20, 100 ms: 200 readers that wait for acknowledgement, 100 reads a frame"
PASS = "at 100 ms still 50,000 reads a second, nothing lost"


def options(parser):
    parser.add_argument("--seconds", type=float, help="of each (default 10, quick 1)")


def run(proof):
    given = proof.options
    if given.bite:
        raise Trouble("it has no build that misbehaves on purpose: R1 and R5 have")
    delays = (0, 100) if given.quick else (0, 5, 20, 100)
    with built_in(given.build):
        figures = slow_disks(delays, given.seconds or (1 if given.quick else 10))
    for delay in delays:
        proof.figure(f"{delay} ms a sync: acknowledged", figures["rates"][delay], "reads a second")
        proof.figure(f"{delay} ms a sync: longest wait of a reader", figures["longest_wait_ms"][delay], "ms")
    if not given.quick:
        proof.must_be_at_least("at 100 ms a sync", figures["rates"][100], 50_000, "reads a second")
    proof.must("all is acknowledged at the end", figures["drained"], "yes" if figures["drained"] else "no")
    judge_books(proof, figures)
