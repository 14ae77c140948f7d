"""The checks of words and of Python bite."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import check_python  # noqa: E402
import check_words  # noqa: E402


class Words(unittest.TestCase):
    def lines(self, text, name="a.md"):
        return [line for line, _ in check_words.check(name, text)]

    def test_what_belongs_to_one_machine_is_found(self):
        for text in ("(/" + "root/x)\n", "cd '/" + "work/main'\n", "in .." + "/shared/a.md\n"):
            with self.subTest(text):
                self.assertEqual(self.lines(text), [1])

    def test_other_paths_pass(self):
        for text in ("/var/lib/gantry\n", "tree/root/node\n", "a/home/b\n", "square/root\n"):
            with self.subTest(text):
                self.assertEqual(self.lines(text), [])

    def test_a_host_that_not_everybody_can_reach_is_found(self):
        self.assertEqual(self.lines("a\nhttps:" + "//mirror.corp.lan/debian\n"), [2])
        self.assertEqual(self.lines("https:" + "//gs1.org.evil.io/\n"), [1])
        for url in ("https://id.gs1.org/01/1", "http://127.0.0.1:8477/", "http://[::1]:80/", "https://broker.example/"):
            with self.subTest(url):
                self.assertEqual(self.lines(url + "\n"), [])

    def test_what_was_left_behind_is_found(self):
        for text in ("// TO" + "DO later\n", "a \n", "a\t\n", "<" * 7 + " HEAD\n", "no end"):
            with self.subTest(text):
                self.assertEqual(self.lines(text), [1])
        self.assertEqual(self.lines("a\t\n", "a.tsv"), [], "a table may have empty columns")


class Python(unittest.TestCase):
    def test_each_fault_is_found(self):
        bare = "try:\n    f()\nexcept:\n    pass\n"
        for text in ("import os\n", "from os import path\n", bare, "def f(:\n", "a = 1\t\n"):
            with self.subTest(text):
                self.assertEqual(len(list(check_python.check(text))), 1)
        self.assertEqual(len(list(check_python.check("a = 1" + "1" * 140 + "\n"))), 1)

    def test_what_is_right_passes(self):
        text = "import os.path\nimport sys as s\n\ntry:\n    os.path.join(s.argv)\nexcept OSError:\n    pass\n"
        self.assertEqual(list(check_python.check(text)), [])


if __name__ == "__main__":
    unittest.main()
