"""The gateway as the end-to-end tests start it, for proofs that need nothing but sockets beside it."""

import contextlib
import io
import os

from .processes import PATIENCE, Trouble, built

os.environ.setdefault("GANTRY_E2E_DEADLINE", str(PATIENCE))

import gantry_e2e  # noqa: E402
import sink_test  # noqa: E402

READER, EVERY_READ = gantry_e2e.READER, gantry_e2e.EVERY_READ
Process, Receiver, run = gantry_e2e.Process, sink_test.Receiver, gantry_e2e.run
STAY = '[presence]\nlose_after = "1h"\n'
LEAVE = '[presence]\nlose_after = "200ms"\npurge_after = "1s"\n'  # every tag is seen once: else presence fills the store


class Gateway(gantry_e2e.Gateway):
    def dispose(self):
        with contextlib.redirect_stderr(io.StringIO()):  # a test shows its log when it fails; here failures have words
            super().dispose()


@contextlib.contextmanager
def built_in(build):
    """With the gantry of that build; what does not work at all could not be proved."""
    gantry_e2e.BINARY = built("gantry", build)
    try:
        yield
    except (AssertionError, OSError) as error:
        raise Trouble(str(error)) from error


def judge_books(proof, figures, where=""):
    """What must hold of the books of NumberedReaders."""
    name = f"{where}: " if where else ""
    proof.figure(f"{name}acknowledged", figures["acknowledged"], "reads")
    proof.must_be_zero(f"{name}lost", figures["lost"], loss=True)
    proof.must_be_zero(f"{name}doubled", figures["doubled"])
    proof.must_be_zero(f"{name}made up", figures["made_up"])
    if "disordered" in figures:
        proof.must_be_zero(f"{name}out of order", figures["disordered"])


def judge_troubles(proof, figures):
    for each in figures["troubles"][:10]:
        proof.say(f"  {each}")
    proof.must_be_zero("what did not go as promised", len(figures["troubles"]))
