"""N6: the network breaks at random, between the gateway and its sinks and readers."""

import random
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from .. import ledger
from ..site import Site

TITLE = "partitions at random, between the gateway and its sinks and its readers"
PASS = "nothing is lost, at the store and at every sink; what readers without acknowledgement lose is counted"
SINKS = ("mqtt", "nats", "kafka", "postgres", "webhook")
COUNTS = {"silion": 4, "silion-plain": 2, "harting": 3, "caen": 1}
LOCK = threading.Lock()


def options(parser):
    parser.add_argument("--partitions", type=int, help="how many (default 200, quick 10)")
    parser.add_argument("--longest", type=float, help="seconds of the longest (default 300, quick 1)")
    parser.add_argument("--at-once", type=int, help="at most (default 4, quick 1)")
    parser.add_argument("--rate", type=float, help="reads a second in all (default 1000, quick 300)")


def breaks(site):
    """What can break: words, how, and how it is mended."""
    out = [(name, sink.isolate, sink.heal) for name, sink in site.sinks.items()]
    out += [("readers that dial" if number == 0 else f"reader {number}", proxy.stall, proxy.heal)
            for number, proxy in enumerate(site.proxies)]
    out += [(f"{name}, reset", site.sinks[name].proxy.cut, lambda: None) for name in site.sinks if site.sinks[name].proxy]
    out += [("readers that dial, reset", site.proxies[0].cut, lambda: None)]
    return out


def partition(site, links, longest, happened):
    """One, of a link that is whole, from its begin to its end; `links` has those that are whole."""
    with LOCK:
        whole = [each for each in breaks(site) if link_of(each) in links]
        what, begin, end = chosen = random.choice(whole)
        links.remove(link_of(chosen))
        happened[what] = happened.get(what, 0) + 1
    begin()
    # Short ones are as likely as long ones: equally spread over the powers of ten.
    time.sleep(0.1 * (longest / 0.1) ** random.random())
    end()
    time.sleep(random.uniform(0.05, 0.5))
    with LOCK:
        links.add(link_of(chosen))


def link_of(each):
    return each[0].removesuffix(", reset")


def run(proof):
    given = proof.options
    count = given.partitions or (10 if given.quick else 200)
    longest = given.longest or (1.0 if given.quick else 300.0)
    rate = given.rate or (300 if given.quick else 1000)
    names = ("webhook", "nats") if given.bite else SINKS
    env = {"GANTRY_FAILPOINT": "kept_is_accepted"} if given.bite else {}
    more = {name: 'timeout = "2s"' for name in names}  # so that short partitions are noticed, too
    with Site(given.build, names, COUNTS, rate / sum(COUNTS.values()), env=env, sink_more=more, proxies=True, keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        happened, links = {}, {link_of(each) for each in breaks(site)}
        with ThreadPoolExecutor(given.at_once or (1 if given.quick else 4)) as pool:
            for done in [pool.submit(partition, site, links, longest, happened) for _ in range(count)]:
                done.result()
        site.wait_for_flow()
        figures = site.finish()
        proof.figure("partitions", count)
        for what, times in sorted(happened.items()):
            proof.figure(f"  of {what}", times)
        book = ledger.check(proof, site, figures)
        for kind, (lost, generated) in sorted(book.unacknowledged_lost.items()):
            proof.figure(f"without acknowledgement: {kind}", f"{lost} of {generated} lost")
