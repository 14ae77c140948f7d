"""N1: every sink is killed and comes back, at random."""

import random
import time

from .. import ledger
from ..measure import seconds
from ..processes import wait_for
from ..site import Site

TITLE = "every sink killed and restarted at random"
PASS = "nothing is lost; a sink delivers again within 5 s of its return; no wait is longer than 30 s"
SINKS = ("files", "mqtt", "nats", "kafka", "postgres", "webhook")
COUNTS = {"silion": 4, "harting": 2, "caen": 1}


def options(parser):
    parser.add_argument("--restarts", type=int, help="of each sink (default 100, quick 2)")
    parser.add_argument("--rate", type=float, help="reads a second in all (default 1000, quick 300)")
    parser.add_argument("--sinks", help=f"only these, with commas (default {','.join(SINKS)})")


def waits(site, names):
    """The longest wait that a sink has planned now, in seconds."""
    return max((seconds(each["next_try"]) - time.time() for each in site.ask("/api/v1/sinks")["sinks"]
                if each["name"] in names and "next_try" in each), default=0.0)


def delivers_again(site, name):
    """Seconds until the sink has delivered something and has no trouble any more."""
    before, begun = site.sink(name)["delivered"], time.monotonic()
    wait_for(lambda: (now := site.sink(name))["delivered"] > before and "trouble" not in now,
             lambda: f"{name} delivers again: {site.sink(name)}")
    return time.monotonic() - begun


def run(proof):
    given = proof.options
    restarts = given.restarts or (2 if given.quick else 100)
    rate = given.rate or (300 if given.quick else 1000)
    names = tuple(given.sinks.split(",")) if given.sinks else ("files", "webhook") if given.bite else SINKS
    env = {"GANTRY_FAILPOINT": "kept_is_accepted"} if given.bite else {}
    more = {name: 'timeout = "2s"' for name in names}  # so soon a silence is a trouble
    with Site(given.build, names, COUNTS, rate / sum(COUNTS.values()), env=env, sink_more=more, keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        site.wait_for_delivery()
        turns = [name for name in names for _ in range(restarts)]
        random.shuffle(turns)
        back, longest = {name: [] for name in names}, 0.0
        for name in turns:
            site.sinks[name].kill()
            end = time.monotonic() + random.uniform(0.1, 1.0 if given.quick else 3.0)
            while time.monotonic() < end:
                longest = max(longest, waits(site, names))
                time.sleep(0.05)
            if not given.bite:
                wait_for(lambda name=name: "trouble" in site.sink(name), lambda name=name: f"{name} is missed")
            site.sinks[name].start()
            if not given.bite:
                back[name].append(delivers_again(site, name))
        figures = site.finish()
        proof.figure("restarts of each sink", restarts)
        ledger.check(proof, site, figures)
        for name, times in back.items():
            if times:
                proof.must_be_at_most(f"{name}: delivers again after its return, worst", max(times), 5 if not given.quick else 30,
                                      "s")
        proof.must_be_at_most("longest planned wait", longest, 30.0, "s")
