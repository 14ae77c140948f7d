"""N2: one sink is away for long; nobody else notices."""

import time

from .. import ledger
from ..measure import latencies, percentile, slope
from ..processes import wait_for
from ..site import Site

TITLE = "one sink away with a long backlog"
PASS = ("nothing is lost; the p99 of another sink stays within 1.2 times what it was; memory stays flat; the backlog drains at "
        "three times the live rate or faster")
SINKS = ("files", "mqtt", "postgres")
COUNTS = {"silion": 6, "harting": 2}
AWAY = "postgres"
FORGET = '[presence]\nlose_after = "1s"\npurge_after = "2s"\n'  # or what is known of each new tag would be all that is measured
# Caches fill up also while every sink is there: the store's, and the map of known tags (every read here is a new one). So the
# growth of a backlog is compared with that of as many events without one; events kept in memory would cost hundreds of bytes each.
ALLOWED = 8.0  # MiB beyond it
SETTLE = 5.0  # seconds that a start may take to settle


def options(parser):
    parser.add_argument("--rate", type=float, help="reads a second in all (default 2000, quick 400)")
    parser.add_argument("--away", type=float, help="seconds (default 600, quick 8)")


def watch(site, seconds):
    """Events and KiB, as the time passes."""
    points, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        points.append((site.ask("/api/v1/status")["last_seq"], site.process.memory_kib()))
        time.sleep(0.25)
    return points


def run(proof):
    given = proof.options
    rate = given.rate or (400 if given.quick else 2000)
    away = given.away or (8.0 if given.quick else 600.0)
    names = ("files", "postgres") if given.bite else SINKS
    env = {"GANTRY_FAILPOINT": "kept_is_accepted"} if given.bite else {}
    with Site(given.build, names, COUNTS, rate / sum(COUNTS.values()), env=env, more=FORGET, keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        site.wait_for_delivery()
        time.sleep(min(away / 4, SETTLE))
        control = watch(site, min(away, 60.0))  # the time that the comparison is made with
        begun = time.time()
        site.sinks[AWAY].kill()
        memory = watch(site, away)
        ended, backlog = time.time(), site.sink(AWAY)["behind"]
        live = backlog / away
        site.sinks[AWAY].start()
        wait_for(lambda: site.sink(AWAY)["delivered"] > 0 and "trouble" not in site.sink(AWAY), "it is back")
        first, back = site.sink(AWAY), time.monotonic()
        if not given.bite:
            # It is caught up when it is behind by what comes within a moment.
            wait_for(lambda: site.sink(AWAY)["behind"] <= max(200, live / 2), "the backlog is delivered", 3600, every=0.05)
        last, took = site.sink(AWAY), time.monotonic() - back
        figures = site.finish()
        proof.figure("away", away, "s")
        proof.figure("backlog", backlog, "events")
        proof.figure("live rate", live, "events/s")
        ledger.check(proof, site, figures)
        if given.bite:
            return
        drained = (last["cursor"] - first["cursor"]) / max(took, 0.001)
        if given.quick and last["cursor"] == first["cursor"]:
            proof.figure("drain", "faster than could be watched")
        else:
            proof.must_be_at_least("drain, in live rates", drained / live, 3.0)
        usual, growth = slope(control), slope(memory)
        proof.figure("memory while away", memory[0][1] / 1024, f"MiB at first, {memory[-1][1] / 1024:.1f} MiB at last")
        proof.figure("memory, growth an event before", usual * 1024, "bytes")
        proof.figure("memory, growth an event while away", growth * 1024, "bytes")
        proof.must_be_at_most("memory, growth beyond the usual", (growth - usual) * backlog / 1024, ALLOWED, "MiB")
        compare(proof, site, begun, ended)


def compare(proof, site, begun, ended):
    """How late events are at the other sink before, and while one is away."""
    before, during = latencies(site, until=begun), latencies(site, since=begun, until=ended)
    first, second = percentile(before, 0.99), percentile(during, 0.99)
    proof.figure("mqtt: p99 from event to subscriber before", first * 1000, "ms")
    proof.figure("mqtt: p99 while the other is away", second * 1000, f"ms, of {len(during)} events")
    if not proof.options.quick:
        proof.must_be_at_most("mqtt: p99, in those before", second / first, 1.2)
