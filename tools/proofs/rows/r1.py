"""R1: the gateway is killed again and again under load."""

import random
import time

from .. import ledger
from ..site import Site

TITLE = "SIGKILL loop under load, readers of all makes, all sinks on"
PASS = ("no acknowledged or stored read is lost, at the store and at every sink; an acknowledging reader loses nothing at all; "
        "restart within 2 s; what readers without acknowledgement lose is at most 25 ms of flow a kill")
MOST_FLOW = 25  # ms of what all readers of a kind read
SINKS = ("files", "mqtt", "nats", "kafka", "postgres", "webhook")


def options(parser):
    parser.add_argument("--kills", type=int, help="how often (default 1000, quick 6)")
    parser.add_argument("--rate", type=float, help="reads a second in all (default 2000, quick 400)")


def run(proof):
    given = proof.options
    kills = given.kills or (6 if given.quick else 1000)
    rate = given.rate or (400 if given.quick else 2000)
    counts = {"silion": 4, "silion-plain": 2, "harting": 4, "caen": 2, "dagprog": 1}
    readers = sum(counts.values()) - 1
    # A slow disk in both: so that a kill falls into a commit, and acknowledging before it is found out.
    env = {"GANTRY_FAILPOINT": "slow_commit,ack_before_commit" if given.bite else "slow_commit" if given.quick else ""}
    with Site(given.build, ("files",) if given.bite else SINKS, counts, rate / readers, env=env, keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        for number in range(kills):
            time.sleep(random.uniform(0.02, 0.4))  # every instant must be possible: this one waits for no condition
            site.kill()
            site.start()
            site.wait_for_flow()
            if number % 100 == 99:
                proof.say(f"  {number + 1} kills")
        figures = site.finish()
        proof.figure("kills", kills)
        book = ledger.check(proof, site, figures)
        restarts = sorted(site.starts[1:-1])
        proof.figure("restart, median", restarts[len(restarts) // 2], "s from the start of the program to `ready`")
        proof.must_be_at_most("restart, worst", restarts[-1], 2 if not given.quick else 20, "s")
        for kind, (lost, generated) in sorted(book.unacknowledged_lost.items()):
            proof.figure(f"without acknowledgement: {kind}", f"{lost} of {generated} lost,", f"{lost / kills:.2f} a kill")
            if kind == "dagprog":  # it reads on while nobody listens: that is no question of the gateway's speed
                continue
            each = rate / readers * counts["silion-plain" if kind == "plain" else kind]
            flow = 1000 * lost / kills / each
            name = f"without acknowledgement: {kind}, flow lost a kill"
            if given.quick:
                proof.figure(name, flow, "ms")
            else:
                proof.must_be_at_most(name, flow, MOST_FLOW, "ms")
