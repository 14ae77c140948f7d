"""N9: acknowledgements that get lost."""

import time

from .. import ledger
from ..processes import wait_for
from ..rough import ACK_SIZE, Rough
from ..site import Site

TITLE = "acknowledgements lost on their way to the readers"
PASS = "what is sent again is acknowledged again, and counted once; nothing is lost"


def options(parser):
    parser.add_argument("--losses", type=int, help="of acknowledgements (default 1000, quick 100)")
    parser.add_argument("--readers", type=int, default=25, help="Silion readers (default 25)")


def run(proof):
    given = proof.options
    losses = given.losses or (100 if given.quick else 1000)
    with Site(given.build, ("files",), {"silion": given.readers}, 20.0, proxies=Rough, keep=given.keep) as site:
        site.start()
        site.wait_for_flow(given.readers)
        network, rounds, waits = site.proxies[0], 0, 0
        network.twice = given.bite  # at once, as no reader sends again: these are new reads, and must be found to be too many
        lost = lambda: network.swallowed // ACK_SIZE
        while lost() < losses:
            before, network.deaf = lost(), True
            wait_for(lambda: lost() >= min(before + given.readers, losses), lambda: f"{lost() - before} are lost in this round")
            rounds += 1
            same_connection = rounds % 10 == 1
            if same_connection:  # the same connection, after the reader's own wait
                waits += 1
                time.sleep(6)
            network.deaf = False
            if not same_connection:
                network.cut()
            site.wait_for_flow(given.readers)
        network.twice = False
        proof.figure("acknowledgements lost", lost())
        proof.figure("  repeated on a new connection", f"{rounds - waits} rounds")
        proof.figure("  repeated on the same one", f"{waits} rounds")
        book = ledger.check(proof, site, site.finish())
        proof.must_be_zero("reads counted more than once", book.doubled, loss=True)
