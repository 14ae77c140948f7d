"""N5: links that are half open: neither end hears anything any more, and nobody is told."""

import time

from ..processes import wait_for
from ..site import Site

TITLE = "half-open readers and sinks"
PASS = ("readers are shown offline: Silion within three heartbeats, HARTING and CAEN within 30 s; a sink's time-out is noticed; all "
        "comes back")
READERS = {"silion": 3, "harting": 4, "caen": 2}
SINKS = ("mqtt", "nats", "kafka", "postgres", "webhook")
HEARTBEAT, TIMEOUT, LIMIT = 1.0, 2.0, 30.0
LIMITS = {"silion": 3 * HEARTBEAT, "harting": LIMIT, "caen": LIMIT}
GIVE_UP = 100.0
SLACK = 2.0  # for a machine that is busy with the readers, too


def options(parser):
    parser.add_argument("--times", type=int, help="how often readers, and each sink (default 50, quick 1)")
    parser.add_argument("--only", choices=("readers", "sinks"), help="these alone (default: readers, then sinks)")
    parser.add_argument("--rate", type=float, default=100, help="reads a second in all (default 100)")


def connected(site):
    return {each["name"]: each["connected"] for each in site.ask("/api/v1/readers")["readers"]}


def run(proof):
    given = proof.options
    times = given.times or (1 if given.quick else 50)
    more = {name: f'timeout = "{TIMEOUT:g}s"\n' for name in SINKS}
    with Site(given.build, SINKS, READERS, given.rate / sum(READERS.values()), sink_more=more, proxies=True, keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        worst = {}
        for _ in range(0 if given.only == "sinks" else times):
            wait_for(lambda: all(connected(site).values()), lambda: f"all are there: {connected(site)}", 300)
            for name, took in readers_found(proof, site).items():
                make = name.rsplit("-", 1)[0]
                worst[make] = max(worst.get(make, 0.0), took)
        if worst:
            proof.figure("half-open, each reader", times, "times")
        for make, took in sorted(worst.items()):
            judged = proof.options.bite or not given.quick  # as all times
            proof.must(f"{make}: worst time until it is shown offline", not judged or took <= LIMITS[make] + SLACK,
                       f"{took:.1f} s (at most {LIMITS[make]:g} and {SLACK:g} for a busy machine)", loss=True)
        wait_for(lambda: all(connected(site).values()), "all are back", 300)
        judged_sinks = () if given.bite or given.only == "readers" else SINKS
        if judged_sinks:
            proof.figure("half-open, each sink", times, "times")
        for name in judged_sinks:
            took = max(sink_found(site, name) for _ in range(times))
            proof.must(f"{name}: worst time until its trouble shows", given.quick or took <= LIMIT,
                       f"{took:.1f} s (time-out {TIMEOUT:g} s)")
        site.finish()


def readers_found(proof, site):
    """Seconds until each is shown offline."""
    begun, found = time.monotonic(), {}
    if not proof.options.bite:
        for proxy in site.proxies:
            proxy.stall()
    names = set(connected(site))
    while set(found) != names and time.monotonic() - begun < GIVE_UP:
        for name, there in connected(site).items():
            if not there:
                found.setdefault(name, time.monotonic() - begun)
        time.sleep(0.05)
    for proxy in site.proxies:
        proxy.heal()
        proxy.cut()
    return {name: found.get(name, GIVE_UP) for name in names}


def sink_found(site, name):
    site.wait_for_sinks([name])
    site.sinks[name].isolate()
    begun = time.monotonic()
    wait_for(lambda: "trouble" in site.sink(name), lambda: f"{name} is in trouble: {site.sink(name)}", 4 * LIMIT)
    took = time.monotonic() - begun
    site.sinks[name].heal()
    wait_for(lambda: "trouble" not in site.sink(name), lambda: f"{name} delivers again: {site.sink(name)}", 120)
    return took
