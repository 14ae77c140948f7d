"""R3: the gateway dies at the worst places, each of which has a name."""

import random
import subprocess

from .. import ledger
from ..processes import PATIENCE, Trouble, built, wait_for
from ..site import Site

TITLE = "SIGKILL between sink and mark, insert and acknowledgement, in a checkpoint, in a migration"
PASS = "no acknowledged or stored read is lost or doubled in the store; sinks have all; doubled ids only at sinks that keep them"
SINKS = ("files", "nats", "postgres", "webhook")
COUNTS = {"silion": 3, "harting": 2}
# The name of the place, and up to which pass of it: another one each time.
PLACES = {
    "sink_delivered": ("a sink has taken a batch, and the cursor is not stored", 20),
    "inserted": ("reads are inserted, and not committed", 20),
    "committed": ("reads are committed, and the reader is not told", 20),
    "in_checkpoint": ("the log is being copied into the file", 6),
    "migration_step": ("a step of a migration is done, and not committed", 1),
    "migration_commit": ("a migration is done, and not committed", 1),
}
FIRST_VERSION = 1  # an older store is made by `gantry store downgrade`


def options(parser):
    parser.add_argument("--times", type=int, help="at each place (default 20, quick 2)")
    parser.add_argument("--rate", type=float, help="reads a second in all (default 1000, quick 300)")
    parser.add_argument("--place", choices=list(PLACES), help="only this one")


def downgrade(site):
    """The store as an older program left it; what that has no place for is left out, and there is none of it here."""
    arguments = [built("gantry", site.build), "store", "downgrade", "--to", str(FIRST_VERSION), "--yes", "--data-dir", str(site.data)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, timeout=PATIENCE)
    if done.returncode:
        raise Trouble(f"gantry store downgrade: {done.stderr}")


def die_once(site, place, most):
    if place.startswith("migration"):
        site.stop()
        downgrade(site)
        site.launch({"GANTRY_FAILPOINT": place})
        site.died()
    else:
        site.kill()
        armed = f"{place}:{random.randint(1, most)}"
        site.launch({"GANTRY_FAILPOINT": f"{armed},checkpoint_often" if place == "in_checkpoint" else armed})
        site.died()
    site.start()
    before = {name: site.sink(name)["delivered"] for name in site.sinks}
    site.wait_for_flow()
    wait_for(lambda: all(site.sink(name)["delivered"] > count for name, count in before.items()), "every sink delivers")


def run(proof):
    given = proof.options
    times = given.times or (2 if given.quick else 20)
    rate = given.rate or (300 if given.quick else 1000)
    places = [given.place] if given.place else list(PLACES)
    names, env = SINKS, {}
    if given.bite:  # a sink that marks before it delivers
        names, places, env = ("files", "webhook"), ["sink_delivered"], {"GANTRY_FAILPOINT": "mark_before_delivery"}
    with Site(given.build, names, COUNTS, rate / sum(COUNTS.values()), env=env, keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        for place in places:
            for _ in range(times):
                if given.bite:
                    bite_once(site)
                else:
                    die_once(site, place, PLACES[place][1])
            proof.figure(f"killed where {PLACES[place][0]}", times, "times")
        figures = site.finish()
        ledger.check(proof, site, figures)


def bite_once(site):
    """Killed while nothing is delivered, and all of it is marked already."""
    site.sinks["webhook"].behave(status=503)
    site.wait_for_flow(200)
    site.kill()
    site.sinks["webhook"].behave()
    site.start()
    site.wait_for_flow()
