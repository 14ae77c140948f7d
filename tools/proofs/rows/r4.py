"""R4: the disk is full."""

from ..end_to_end import built_in, judge_books, judge_troubles
from ..full_disks import full_disks, why_not
from ..processes import NotHere

TITLE = "the disk is full and then is not: 8 MiB, sinks on, one of them away while it is full"
PASS = "nothing is acknowledged while it is full; it goes on by itself within 2 s; nothing is lost at any sink"


def options(parser):
    parser.add_argument("--rounds", type=int, help="how many (default 20, quick 3)")


def run(proof):
    given = proof.options
    if why := why_not():
        raise NotHere(why)
    env = {"GANTRY_FAILPOINT": "ack_before_commit"} if given.bite else None
    with built_in(given.build):
        kills = {"kill_each": 1, "frames": 200} if given.bite else {}  # some must fall into the moment of the failing write
        rounds = given.rounds or (20 if not given.quick else 8 if given.bite else 3)
        figures = full_disks(rounds, env, say=proof.say, **kills)
    proof.figure("rounds", figures["rounds"])
    proof.figure("of them with a kill while it was full", figures["kills"])
    proof.must_be_zero("acknowledged while it was full", figures["acknowledged_while_full"], loss=True)
    proof.must_be_at_most("longest return", figures["longest_return_ms"], 20_000 if given.quick else 2000, "ms")
    judge_books(proof, figures["hook"], "webhook")
    judge_books(proof, figures["archive"], "files")
    judge_troubles(proof, figures)
