"""Files that would disturb each other are never in one batch; all others are."""

import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

TOOLS = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(TOOLS))
from unity import batches  # noqa: E402

OTHER = "namespace n {\nint use(int given) {\n    int limit = given;\n    return limit + rows.count();\n}\n}\n"
APART = {
    "a constant of an unnamed namespace": "namespace {\nconstexpr int limit = 1;\n}",
    "a variable that is started with braces": "namespace {\nstd::map<int, std::string> limit{{1, {}}};\n}",
    "the second of two names": "namespace {\nconst Bytes first = hex(\"01\"), limit = hex(\"02\");\n}",
    "a function": "namespace {\nint limit(int a, int b) { return a < b ? a : b; }\n}",
    "a function template": "namespace {\ntemplate <typename T>\nstd::vector<T> limit(const T& a) { return {a}; }\n}",
    "a static function": "static int limit() { return 1; }",
    "a type": "namespace n {\nstruct limit : Base {\n    int a;\n};\n}",
    "an enumeration": "namespace {\nenum class limit : char { a, b };\n}",
    "a type that is only announced": "namespace {\nclass limit;\n}",
    "a table": "namespace {\nconst Row limit[] = {{1, \"a\"}, {2, \"b\"}};\n}",
    "behind a function": "namespace {\nvoid f() {}\nint limit;\n}",
    "an alias": "namespace n {\nusing limit = int;\n}",
    "an alias of a namespace": "namespace limit = boost::json;",
    "a macro": "#define OTHER 1",
}
TOGETHER = {
    "a function that others call": "namespace n {\nint limit(int a) { return a; }\n}",
    "a member": "namespace {\nstruct Own {\n    int limit() { return limit_; }\n};\n}",
    "a local name": "namespace {\nvoid f() { int limit = 1; }\n}",
    "a member of the same name there": "namespace {\nint count = 0;\n}",
    "a definition of a member": "namespace n {\nint Own::limit() const { return 1; }\nint Own::limit_{1};\n}",
    "a comment": "namespace {\n// int limit = 1;\n}",
    "a text": 'namespace {\nconst char* text = "{ limit";\n}',
    "tests with one name": "namespace {\nTEST(Suite, limit) {}\n}",
    "a name from elsewhere": "namespace n {\nusing other::limit;\n}",
}


class Unity(unittest.TestCase):
    def batches(self, *sources, most=1000):
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / f"{number}.cpp" for number in range(len(sources))]
            for path, source in zip(paths, sources):
                path.write_text(source, encoding="utf-8")
            return [[int(Path(each).stem) for each in batch] for batch in batches(map(str, paths), most)]

    def test_names_that_disturb_the_other_file_keep_it_apart(self):
        for why, source in APART.items():
            with self.subTest(why):
                self.assertEqual(self.batches(source, OTHER), [[0], [1]])
                self.assertEqual(self.batches(OTHER, source), [[0], [1]])

    def test_what_does_not_disturb_is_compiled_together(self):
        for why, source in TOGETHER.items():
            with self.subTest(why):
                self.assertEqual(self.batches(source, OTHER), [[0, 1]])

    def test_one_short_name_for_one_thing_may_be_in_both(self):
        json, text = "namespace json = boost::json;\n", "using json = std::string;\n"
        self.assertEqual(self.batches(json, json, text), [[0, 1], [2]])

    def test_a_batch_is_no_larger_than_said(self):
        self.assertEqual(self.batches(*["int a();"] * 5, most=16), [[0, 1], [2, 3], [4]])

    def test_a_large_file_is_a_batch_of_its_own(self):
        self.assertEqual(self.batches("int a();", "int b();", most=1), [[0], [1]])

    def test_a_path_may_hold_a_blank(self):
        with tempfile.TemporaryDirectory() as folder:
            paths = [str(Path(folder) / name) for name in ("a 1.cpp", "a 2.cpp")]
            for path in paths:
                Path(path).touch()
            done = subprocess.run(
                [sys.executable, str(TOOLS / "unity.py"), "1000", *paths], capture_output=True, text=True, check=True
            )
            self.assertEqual(done.stdout, "\t".join(paths) + "\n")


if __name__ == "__main__":
    unittest.main()
