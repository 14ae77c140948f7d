"""N4: records that a sink will never take."""

import json

from .. import ledger
from ..processes import wait_for
from ..site import Site

TITLE = "poisonous records: refused by a web server (422) and by a constraint of a table"
PASS = "every one becomes a dead letter with the reason, counted, and the flow goes on; mended, they can be delivered again"
COUNTS = {"silion": 4, "harting": 2}
EVERY = {"webhook": 7, "postgres": 11}  # of the numbers of events


def options(parser):
    parser.add_argument("--poison", type=int, help="records (default 1000, quick 40)")
    parser.add_argument("--rate", type=float, help="reads a second in all (default 500, quick 200)")


def letters(site, name):
    return [json.loads(line) for line in site.gantry("sink", "show", name, "--dead", "--json").splitlines()]


def run(proof):
    given = proof.options
    poison = given.poison or (40 if given.quick else 1000)
    rate = given.rate or (200 if given.quick else 500)
    env = {"GANTRY_FAILPOINT": "refused_is_forgotten"} if given.bite else {}
    with Site(given.build, ("files", "postgres", "webhook"), COUNTS, rate / sum(COUNTS.values()), env=env, keep=given.keep) as site:
        site.start()
        site.wait_for_flow()
        site.wait_for_delivery()
        start = site.ask("/api/v1/status")["last_seq"]
        site.sinks["postgres"].sql(f"ALTER TABLE gantry.events ADD CONSTRAINT poison CHECK (seq % {EVERY['postgres']} <> 0) NOT VALID")
        site.sinks["webhook"].behave(refuse_every=EVERY["webhook"])
        wait_for(lambda: site.ask("/api/v1/status")["last_seq"] - start >= poison * min(EVERY.values()), "enough records", 3600)
        # Also what the gateway says of itself at its end and at its next start is offered, and may be refused.
        figures = site.finish()
        proof.figure("poisonous records wanted of the webhook", poison)
        dead = {}
        if not given.bite:
            site.start()
            dead = check_letters(proof, site, start, site.wait_for_sinks())
            site.stop()
        excused = {name: [each["content"]["id"] for each in found] for name, found in dead.items()}
        ledger.check(proof, site, figures, excused=excused)
        if not given.bite:
            mend(proof, site, dead)


def check_letters(proof, site, start, end):
    """Exactly the poisonous events behind `start`, and up to `end`, are dead letters, whole and with a reason."""
    store, dead = site.store(), {}
    for name, every in EVERY.items():
        dead[name] = [each for each in letters(site, name) if each["event"] <= end]
        present = {ident for ident in site.sinks[name].ids()}
        wanted = {seq for seq, ident in store.execute("SELECT seq, id FROM events WHERE seq > ? AND seq <= ? AND seq % ? = 0",
                                                       (start, end, every))
                  if ident not in present}
        found = {each["event"] for each in dead[name]}
        proof.figure(f"{name}: dead letters", len(found))
        proof.must_be_zero(f"{name}: poisonous and no dead letter", len(wanted - found), loss=True)
        proof.must_be_zero(f"{name}: dead letters that are not poisonous", len(found - wanted))
        word = "422" if name == "webhook" else "poison"
        proof.must_be_zero(f"{name}: dead letters without the reason", sum(word not in each["reason"] for each in dead[name]))
        proof.must(f"{name}: counted by the status", site.sink(name)["dead_letters"] >= len(found), site.sink(name)["dead_letters"])
    store.close()
    return dead


def mend(proof, site, dead):
    """The cause is gone: every dead letter is taken."""
    site.sinks["webhook"].behave()
    site.sinks["postgres"].sql("ALTER TABLE gantry.events DROP CONSTRAINT poison")
    site.start()
    for name in EVERY:
        site.gantry("sink", "retry", name, "--all")
        wait_for(lambda name=name: not letters(site, name), lambda name=name: f"{name} takes them: {site.sink(name)}", 600, every=0.2)
    site.wait_for_sinks()
    site.stop()
    for name, found in dead.items():
        present = set(site.sinks[name].ids())
        proof.must_be_zero(f"{name}: dead letters not delivered by `sink retry`",
                           sum(each["content"]["id"] not in present for each in found), loss=True)
