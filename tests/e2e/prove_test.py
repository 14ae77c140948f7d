"""The proofs of delivery at the size for CI: tools/prove with --quick. What they prove stands in docs/reliability.md."""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from gantry_e2e import BINARY, complaint_of_a_sanitizer

ROOT = Path(__file__).resolve().parents[2]
FAILPOINTS = os.environ.get("GANTRY_FAILPOINTS") == "1"
NOT_HERE = 77  # this machine cannot do what the proof needs, and it says what
LONGEST = 280  # seconds, on a slow machine under a sanitizer


class WithProofs(unittest.TestCase):
    def prove(self, row, *arguments):
        with tempfile.TemporaryDirectory(prefix="gantry-prove-") as home:
            figures = Path(home) / "figures.json"
            build = Path(BINARY).resolve().parents[1]
            done = subprocess.run([sys.executable, "-B", ROOT / "tools/prove", row, "--quick", "--build", build, "--json", figures,
                                   *arguments], capture_output=True, text=True, timeout=LONGEST, check=False)
            self.assertEqual("", complaint_of_a_sanitizer(done.stderr))
            if done.returncode == NOT_HERE:
                self.skipTest(done.stderr)
            self.assertEqual(0, done.returncode, done.stdout + done.stderr)
            return json.loads(figures.read_text())["figures"]

    def assert_clean(self, figures, *sinks):
        """The proof has looked, and what it looked at was not nothing."""
        self.assertGreater(figures["acknowledged"], 100)
        self.assertEqual(0, figures["store: acknowledged reads lost"])
        for sink in sinks:
            self.assertGreater(figures[f"{sink}: delivered"], 100)
            self.assertEqual(0, figures[f"{sink}: lost"])


class Proofs(WithProofs):
    def test_a_gateway_killed_under_load_loses_nothing(self):
        figures = self.prove("R1")
        self.assert_clean(figures, "files", "mqtt", "nats", "kafka", "postgres", "webhook")

    def test_sinks_that_are_killed_and_come_back_have_all(self):
        self.assert_clean(self.prove("N1", "--restarts", "1"), "files", "mqtt", "nats", "kafka", "postgres", "webhook")

    def test_what_is_refused_becomes_a_dead_letter(self):
        self.assertGreater(self.prove("N4")["webhook: dead letters"], 20)

    def test_a_rough_network_changes_no_read(self):
        self.assert_clean(self.prove("N7"), "files")

    def test_a_network_that_loses_pieces_is_found_out(self):
        self.prove("N7", "--bite")

    def test_a_clock_that_jumps_loses_nothing(self):
        self.assert_clean(self.prove("N8"), "files")

    def test_timers_that_jump_with_the_clock_are_found_out(self):
        self.prove("N8", "--bite")

    def test_lost_acknowledgements_lose_and_double_nothing(self):
        self.assertGreaterEqual(self.prove("N9")["acknowledgements lost"], 100)

    def test_reads_that_are_counted_twice_are_found_out(self):
        self.assertGreater(self.prove("N9", "--bite")["reads counted more than once"], 0)

    def test_two_devices_under_one_name_are_one_reader(self):
        self.assertEqual(0, self.prove("N10")["under another reader's name"])

    @unittest.skipUnless(FAILPOINTS, "a gateway without failpoints does not misbehave")
    def test_acknowledging_before_the_commit_is_found_out(self):
        self.assertGreater(self.prove("R1", "--bite")["store: acknowledged reads lost"], 0)

    @unittest.skipUnless(FAILPOINTS, "a gateway without failpoints does not misbehave")
    def test_a_sink_that_marks_before_it_delivers_is_found_out(self):
        self.assertGreater(self.prove("R3", "--bite")["webhook: lost"], 0)


class Long(WithProofs):
    @unittest.skipUnless(FAILPOINTS, "a gateway without failpoints does not die where it is told")
    def test_a_gateway_killed_at_the_worst_places_loses_nothing(self):
        self.assert_clean(self.prove("R3", "--times", "1"), "files", "nats", "postgres", "webhook")

    def test_a_sink_that_is_away_holds_up_nobody(self):
        self.assert_clean(self.prove("N2"), "files", "mqtt", "postgres")

    def test_a_sink_that_misbehaves_holds_up_nobody(self):
        self.assert_clean(self.prove("N3"), "files", "mqtt", "webhook")

    def test_a_network_that_breaks_loses_nothing(self):
        self.assert_clean(self.prove("N6"), "mqtt", "nats", "kafka", "postgres", "webhook")

    @unittest.skipUnless(FAILPOINTS, "a gateway without failpoints does not misbehave")
    def test_counting_a_failure_as_delivered_is_found_out(self):
        self.assertGreater(self.prove("N1", "--bite")["webhook: lost"], 0)


if __name__ == "__main__":
    unittest.main()
