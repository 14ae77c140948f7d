"""R8: a long backlog."""

from ..backlogs import backlog
from ..end_to_end import built_in, judge_books
from ..processes import Trouble

TITLE = "a backlog of millions of events: restart after a kill, then a sink takes them beside 10,000 live reads a second"
PASS = "ready within 2 s, drained at three times the live rate or more, order kept, nothing lost"


def options(parser):
    parser.add_argument("--rows", type=int, help="how many events wait (default 10,000,000, quick 50,000)")
    parser.add_argument("--new-tags", action="store_true", help="every read is another tag, and all of them are present")


def run(proof):
    given = proof.options
    if given.bite:
        raise Trouble("it has no build that misbehaves on purpose: R1 and R5 have")
    with built_in(given.build):
        rows, tags = given.rows or (50_000 if given.quick else 10_000_000), {"tags": None} if given.new_tags else {}
        figures = backlog(rows, say=proof.say, **tags)
    proof.figure("events that waited", figures["rows"])
    proof.must_be_at_most("start until `ready`", figures["ready_ms"] / 1000, 20 if given.quick else 2, "s")
    proof.figure("live reads meanwhile", figures["live_reached"], "a second")
    if given.quick:
        proof.figure("drained", figures["drain_rate"], "events a second")
    else:
        proof.must_be_at_least("drained", figures["drain_rate"], 3 * figures["live_reached"], "events a second")
    judge_books(proof, figures)
