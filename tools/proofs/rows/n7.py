"""N7: what a network may do to a reader's bytes without losing any, and resets at every place."""

from .. import ledger
from ..processes import wait_for
from ..rough import Rough
from ..site import Site

TITLE = "readers behind a network that cuts, gathers, stalls and resets"
PASS = ("byte by byte, gathered or stalled, every reader's reads are those of an unbroken flow; resets at every place of what readers "
        "say lose nothing that acknowledges, and double and invent nothing")
COUNTS = {"silion": 4, "silion-plain": 2, "harting": 4, "caen": 2}
STALL = 0.5


def options(parser):
    parser.add_argument("--reads", type=int, help="acknowledged in each phase (default 20000, quick 300)")
    parser.add_argument("--places", type=int, help="where connections are reset: 1 to so many (default 1000, quick 150)")
    parser.add_argument("--rate", type=float, help="reads a second in all (default 1000, quick 300)")


def run(proof):
    given = proof.options
    rate = given.rate or (300 if given.quick else 1000)
    reads = given.reads or (300 if given.quick else 20_000)
    smooth_but_rough(proof, rate, reads)
    if not given.bite:
        resets(proof, rate, given.places or (150 if given.quick else 1000))


def site_of(proof, rate):
    return Site(proof.options.build, ("files",), COUNTS, rate / sum(COUNTS.values()), proxies=Rough, keep=proof.options.keep,
                heartbeat="20s")


def smooth_but_rough(proof, rate, reads):
    """No byte is lost, so no read may be: not even of readers that nobody acknowledges."""
    phases = [("segment", 1), ("stall", STALL), ("gather", 0.5)]
    if proof.options.bite:
        phases = [("leave_out", 0.05)]
    with site_of(proof, rate) as site:
        site.start()
        site.wait_for_flow(100)
        before = {each["reader"]: each["generated"] for each in site.readers.figures()}
        for what, value in phases:
            for proxy in site.proxies:
                setattr(proxy, what, value)
            site.wait_for_flow(reads)
            for proxy in site.proxies:
                proxy.be_smooth()
        for words, name in (("segments of one byte", "segments"), ("stalls of 500 ms within a message", "stalls"),
                            ("most pieces gathered into one", "gathered"), ("pieces left out", "left_out")):
            numbers = [getattr(proxy, name) for proxy in site.proxies]
            proof.figure(words, max(numbers) if name == "gathered" else sum(numbers))
        figures = site.finish()
        ledger.check(proof, site, figures)
        store = site.store()
        for each in figures:
            if not each["acknowledges"]:
                missing = lost_since(store, each, before[each["reader"]])
                proof.must_be_zero(f"{each['name']}, not acknowledged: lost of {each['generated']}", missing, loss=True)
        gone = store.execute("SELECT count(*) FROM events WHERE type = 'reader.disconnected' AND reason NOT LIKE '%gateway%'").fetchone()
        store.close()
        proof.figure("links that ended", gone[0])


def lost_since(store, figures, number):
    """Before it a reader may have talked to a gateway that was not there yet."""
    tags = store.execute("SELECT tag FROM events WHERE type = 'tag.read' AND reader = ?", (figures["name"],))
    there = {found[1] for (tag,) in tags if (found := ledger.numbered(tag))}
    return sum(each not in there for each in range(number + 1, figures["generated"] + 1))


def resets(proof, rate, places):
    with site_of(proof, rate) as site:
        site.start()
        site.wait_for_flow()
        first = next(Rough.places)
        for proxy in site.proxies:
            proxy.reset = True
            proxy.cut()
        done = lambda: sum(proxy.resets for proxy in site.proxies)
        wait_for(lambda: done() >= places, lambda: f"{done()} of {places} resets", 3600)
        for proxy in site.proxies:
            proxy.be_smooth()
            proxy.cut()
        proof.figure("resets, each at another place", done())
        proof.figure("the last place", next(Rough.places) - first, "bytes")
        site.wait_for_flow()
        figures = site.finish()
        book = ledger.check(proof, site, figures)
        for kind, (lost, generated) in sorted(book.unacknowledged_lost.items()):
            proof.figure(f"not acknowledged, resets: {kind}", f"{lost} of {generated} lost")
