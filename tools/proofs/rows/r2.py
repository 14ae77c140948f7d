"""R2: the power goes."""

from ..end_to_end import built_in, judge_books
from ..power_cuts import power_cuts, why_not
from ..processes import NotHere

TITLE = "power cuts, simulated: a file system in a file is copied while the gateway is stopped under load"
PASS = "no acknowledged read is lost, no store is damaged; with synchronous NORMAL (--bite) losses are found"


def options(parser):
    parser.add_argument("--cuts", type=int, help="how many (default 200, quick 3; with --bite 10, quick 2)")


def run(proof):
    given = proof.options
    cuts = given.cuts or ((2 if given.bite else 3) if given.quick else (10 if given.bite else 200))
    if why := why_not():
        raise NotHere(why)
    with built_in(given.build):
        figures = power_cuts(cuts, synchronous_normal=given.bite, say=proof.say if cuts <= 20 else lambda text: None)
    proof.figure("cuts", figures["cuts"])
    judge_books(proof, figures)
    proof.figure("cuts that lost something", figures["cuts_with_loss"])
    for each in figures["troubles"][:3]:
        proof.say(each)
    proof.must_be_zero("damaged stores", figures["damaged"])
