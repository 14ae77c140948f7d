"""R11: another version of the store."""

from ..end_to_end import built_in, judge_books, judge_troubles
from ..processes import Trouble
from ..upgrades import upgrades

TITLE = "the store goes down to its oldest version and up again with a backlog, killed in the middle"
PASS = "it is of the one version or of the other, and holds what it held"


def options(parser):
    parser.add_argument("--kills", type=int, help="how many (default 20, quick 4)")
    parser.add_argument("--rows", type=int, help="events in the store (default 100,000, quick 4,000)")


def run(proof):
    given = proof.options
    if given.bite:
        raise Trouble("it has no build that misbehaves on purpose: R1 and R5 have")
    with built_in(given.build):
        figures = upgrades(given.kills or (4 if given.quick else 20), given.rows or (4000 if given.quick else 100_000), say=proof.say)
    proof.figure("killed", figures["kills"], "times")
    proof.figure("of them on the way down", figures["downgrades_killed"])
    proof.figure("on the way up, before the commit", figures["upgrades_killed_before"])
    proof.figure("on the way up, after the commit", figures["upgrades_killed_after"])
    judge_troubles(proof, figures)
    judge_books(proof, figures)
