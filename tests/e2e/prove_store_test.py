"""The proofs of the store at the size for CI: tools/prove with --quick. What they prove stands in docs/reliability.md."""

import unittest

import prove_test


class Long(prove_test.WithProofs):
    def assert_books(self, figures, where=""):
        """They were kept, and balance."""
        name = f"{where}: " if where else ""
        self.assertGreater(figures[f"{name}acknowledged"], 100)
        self.assertEqual(0, figures[f"{name}lost"])
        self.assertEqual(0, figures[f"{name}doubled"])

    def test_when_the_power_goes_nothing_is_lost(self):
        self.assert_books(self.prove("R2"))

    def test_a_full_disk_loses_nothing_at_any_sink(self):
        figures = self.prove("R4")
        for sink in ("webhook", "files"):
            self.assert_books(figures, sink)

    def test_a_failing_disk_loses_nothing(self):
        figures = self.prove("R5")
        self.assertGreater(figures["faults"], 5)
        self.assert_books(figures)

    def test_a_backlog_goes_out_in_order_beside_live_reads(self):
        self.assert_books(self.prove("R8"))

    def test_a_slow_disk_only_costs_time(self):
        self.assert_books(self.prove("R10"))

    def test_another_version_of_the_store_loses_nothing(self):
        self.assert_books(self.prove("R11"))

    @unittest.skipUnless(prove_test.FAILPOINTS, "a gateway without failpoints does not misbehave")
    def test_a_commit_without_a_sync_is_found_out(self):
        self.assertGreater(self.prove("R2", "--bite")["lost"], 0)

    @unittest.skipUnless(prove_test.FAILPOINTS, "a gateway without failpoints does not misbehave")
    def test_acknowledging_before_a_commit_that_fails_is_found_out(self):
        self.assertGreater(self.prove("R5", "--bite")["lost"], 0)


if __name__ == "__main__":
    unittest.main()
