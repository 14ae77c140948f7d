"""N3: a sink that answers late, wrongly, or not at all."""

import time

from .. import ledger
from ..measure import latencies, percentile
from ..processes import wait_for
from ..site import Site

TITLE = "a sink that is slow, silent, refuses for now, talks nonsense, hangs up"
PASS = ("nothing is lost; the p99 of another sink stays within 1.2 times what it was; the time-out ends a delivery that nobody "
        "answers; Retry-After is obeyed")
COUNTS = {"silion": 4, "harting": 2}
TIMEOUT, RETRY_AFTER = 1.0, 2
WAYS = {
    "slow: 1 % of the speed": {"delay": 0.5},
    "accepts and never answers": {"mode": "never"},
    "500": {"status": 500},
    "429 with Retry-After": {"status": 429, "headers": {"Retry-After": str(RETRY_AFTER)}},
    "garbage": {"mode": "garbage"},
    "dies within a good answer": {"mode": "cut"},
    "hangs up without a word": {"mode": "drop"},
    "closes after each reply": {"mode": "close"},
}


def options(parser):
    parser.add_argument("--rate", type=float, help="reads a second in all (default 1000, quick 200)")
    parser.add_argument("--seconds", type=float, help="of each way (default 600, quick 2.5)")


def one_way(proof, site, way, behaviour, seconds):
    hook = site.sinks["webhook"]
    seen, begun = len(hook.requests()), time.time()
    hook.behave(**behaviour)
    time.sleep(seconds)
    requests = hook.requests()[seen:]
    proof.figure(f"{way}: requests", len(requests))
    if behaviour.get("status") == 429:
        asked = [each["time"] for each in requests if each["status"] == 429]
        gaps = [later - sooner for sooner, later in zip(asked, asked[1:])]
        proof.must(f"{way}: the shortest wait", not gaps or min(gaps) >= RETRY_AFTER - 0.05,
                   f"{min(gaps):.2f} s" if gaps else "asked once only")
    if behaviour.get("mode") == "never":
        wait_for(lambda: "trouble" in site.sink("webhook"), "the time-out is noticed", 10 * TIMEOUT)
        proof.figure(f"{way}: trouble", site.sink("webhook")["trouble"])
    hook.behave()
    return begun, time.time()


def run(proof):
    given = proof.options
    rate = given.rate or (200 if given.quick else 1000)
    seconds = given.seconds or (2.5 if given.quick else 600.0)
    env = {"GANTRY_FAILPOINT": "kept_is_accepted"} if given.bite else {}
    more = {"webhook": f'timeout = "{TIMEOUT:g}s"'}
    with Site(given.build, ("files", "mqtt", "webhook"), COUNTS, rate / sum(COUNTS.values()), env=env, sink_more=more,
              keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        site.wait_for_delivery()
        time.sleep(seconds)
        spans = [(time.time() - seconds, time.time())]
        for way, behaviour in WAYS.items():
            spans.append(one_way(proof, site, way, behaviour, seconds))
            if not given.bite:
                wait_for(lambda: (now := site.sink("webhook"))["behind"] < rate and "trouble" not in now,
                         lambda: f"it catches up: {site.sink('webhook')}", 600)
        figures = site.finish()
        ledger.check(proof, site, figures)
        first = percentile(latencies(site, since=spans[0][0], until=spans[0][1]), 0.99)
        proof.figure("mqtt: p99 from event to subscriber before", first * 1000, "ms")
        worst = 0.0
        for (begun, ended), way in zip(spans[1:], WAYS):
            late = percentile(latencies(site, since=begun, until=ended), 0.99)
            worst = max(worst, late)
            proof.figure(f"mqtt: p99 while the other is: {way}", late * 1000, "ms")
        if not given.quick:
            proof.must_be_at_most("mqtt: worst p99, in that before", worst / first, 1.2)
