"""A gateway that dies by itself fails a proof; all else that cannot be asked leaves it undecided."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from proofs.processes import Died, Trouble  # noqa: E402
from proofs.site import Site  # noqa: E402


class Gone:
    def __init__(self, ended):
        self.ended = ended

    def ends_soon(self):
        return self.ended

    def wait(self):
        return -11

    def said(self):
        return "its last words"


class Asking(unittest.TestCase):
    def ask(self, ended):
        site = Site.__new__(Site)
        site.data, site.process = Path("/nowhere"), Gone(ended)
        with self.assertRaises(Trouble) as caught:
            site.ask("/api/v1/status")
        return caught.exception

    def test_a_gateway_that_has_died_has_failed(self):
        error = self.ask(ended=True)
        self.assertIsInstance(error, Died)
        self.assertIn("-11: its last words", str(error))

    def test_one_that_runs_and_cannot_be_asked_has_not(self):
        self.assertNotIsInstance(self.ask(ended=False), Died)


if __name__ == "__main__":
    unittest.main()
