"""The seeds of a fuzz target are the frames of its direction and the inputs that once found a fault."""

import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from fuzz_seeds import main, seeds  # noqa: E402

VECTORS = (
    "# a comment\nid\tdirection\thex\tmeaning\torigin\n"
    "A-1\tto-host\tFF 06\tone\tseed\nA-2\tto-host\tFF07\ttwo\tseed\nA-3\tto-reader\tEE\tthree\tseed\n"
)


class FuzzSeeds(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.src = Path(folder.name)
        self.tests = self.src / "protocols" / "a" / "tests"
        (self.tests / "seeds" / "a_to_host_fuzz").mkdir(parents=True)
        (self.tests / "vectors.tsv").write_text(VECTORS, encoding="utf-8")
        for name in ("a_to_host_fuzz", "a_to_reader_fuzz", "a_both_fuzz"):
            (self.tests / f"{name}.cpp").touch()
        (self.tests / "seeds" / "a_to_host_fuzz" / "crash-1").write_bytes(b"\x00")

    def test_a_target_gets_the_frames_of_its_own_direction(self):
        cut = bytes(8)
        self.assertEqual(
            seeds(self.src, "a_to_host_fuzz"),
            {
                "A-1": b"\xff\x06",
                "A-2": b"\xff\x07",
                "all": b"\xff\x06\xff\x07",
                "A-1-cut": cut + b"\xff\x06",
                "A-2-cut": cut + b"\xff\x07",
                "all-cut": cut + b"\xff\x06\xff\x07",
                "crash-1": b"\x00",
            },
        )
        self.assertEqual(set(seeds(self.src, "a_to_reader_fuzz")), {"A-3", "A-3-cut", "all", "all-cut"})

    def test_a_target_without_a_direction_gets_all_frames(self):
        self.assertLessEqual({"A-1", "A-2", "A-3", "all"}, set(seeds(self.src, "a_both_fuzz")))

    def test_a_target_of_the_configuration_gets_the_samples(self):
        (self.tests / "config_fuzz.cpp").touch()
        (self.src / "protocols" / "a" / "sample.toml").write_bytes(b"a = 1\n")
        self.assertEqual(seeds(self.src, "config_fuzz")["sample-a"], b"a = 1\n")

    def test_each_seed_is_a_file_of_the_corpus(self):
        corpus = self.src / "corpus" / "x"
        self.assertEqual(main(["", str(self.src), "a_to_reader_fuzz", str(corpus)]), 0)
        self.assertEqual({path.name for path in corpus.iterdir()}, {f"seed-{name}" for name in seeds(self.src, "a_to_reader_fuzz")})
        self.assertEqual((corpus / "seed-A-3").read_bytes(), b"\xee")

    def test_an_unknown_target_is_named(self):
        with self.assertRaisesRegex(SystemExit, "no_such_fuzz"):
            seeds(self.src, "no_such_fuzz")


if __name__ == "__main__":
    unittest.main()
