"""./dev, with everything it calls replaced by stubs that write down how they were called."""

import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
# A system has these before any package of ours; nothing else of it is in PATH.
PLAIN = "sh bash cat cut basename dirname env false find grep head mkdir nproc printf rm sed sort tail touch tr true xargs".split()

DPKG = '#!/bin/sh\nfor last; do :; done\ncase " $MISSING " in *" $last "*) exit 1 ;; *) printf installed ;; esac\n'
LOGGED = '#!/bin/sh\necho "{name} $*" >> "$CALLS"\ncase "$*" in {fails}) exit 1 ;; esac\n'
CTEST = """#!/bin/sh
echo "ctest $*" >> "$CALLS"
while [ $# -gt 0 ]; do [ "$1" = --output-junit ] && file=$2; shift; done
set -- "${TESTS:-10}" "${FAILURES:-0}"
printf '<testsuite name="x"\\n\\ttests="%s"\\n\\tfailures="%s"\\n\\tdisabled="0"\\n\\tskipped="1"\\n>' "$@" > "$file"
echo "the output of the tests"
"""


class Dev(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.tree = Path(folder.name) / "a tree"  # with a blank, as people's folders have
        (self.tree / "tools").mkdir(parents=True)
        (self.tree / "src" / "m" / "tests").mkdir(parents=True)
        shutil.copy(ROOT / "dev", self.tree)
        (self.tree / "tools" / "packages.txt").write_text("# a comment\ncmake\n\ngit  # why\nclang-16\n", encoding="utf-8")
        self.bin = Path(folder.name) / "bin"
        self.bin.mkdir()
        for name in PLAIN:
            (self.bin / name).symlink_to(shutil.which(name))
        self.stub("dpkg-query", DPKG)
        self.stub("id", "#!/bin/sh\necho ${USER_ID:-0}\n")
        self.stub("apt-get")
        self.stub("cmake")
        self.stub("python3")
        self.stub("ctest", CTEST)
        for preset in ("dev", "asan", "tsan"):
            (self.tree / "build" / preset).mkdir(parents=True)
        self.calls = Path(folder.name) / "calls"
        self.calls.touch()

    def stub(self, name, text=None, fails="none"):
        path = self.bin / name
        path.write_text(text or LOGGED.format(name=name, fails=fails), encoding="utf-8")
        path.chmod(0o755)

    def dev(self, *arguments, **environment):
        environment = {"PATH": str(self.bin), "CALLS": str(self.calls), "MISSING": "", **environment}
        done = subprocess.run(
            [str(self.tree / "dev"), *arguments],
            env=environment, cwd="/", capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        return done.returncode, done.stdout, done.stderr

    def called(self):
        return self.calls.read_text(encoding="utf-8").splitlines()

    def test_what_is_missing_is_installed_and_said(self):
        code, out, _ = self.dev("deps", MISSING="git clang-16")
        self.assertEqual(code, 0)
        self.assertIn("installing: git clang-16", out)
        self.assertEqual(
            self.called(),
            ["apt-get -q update", "apt-get -q -y install --no-install-recommends git clang-16"],
        )

    def test_apt_is_left_alone_when_nothing_is_missing(self):
        code, out, _ = self.dev("deps")
        self.assertEqual((code, self.called()), (0, []))
        self.assertIn("every package", out)

    def test_no_install_only_lists(self):
        code, out, _ = self.dev("deps", "--no-install", MISSING="cmake git")
        self.assertEqual((code, self.called()), (0, []))
        self.assertIn("missing: cmake git", out)

    def test_no_install_ends_a_verb_that_needs_the_packages(self):
        code, out, err = self.dev("--no-install", "build", MISSING="cmake")
        self.assertEqual((code, self.called()), (1, []))
        self.assertIn("missing: cmake", out)
        self.assertIn("needed", err)

    def test_without_root_and_sudo_it_says_what_to_do(self):
        code, _, err = self.dev("deps", MISSING="cmake", USER_ID="1000")
        self.assertEqual((code, self.called()), (1, []))
        self.assertIn("as root: apt-get install --no-install-recommends cmake", err)

    def test_without_root_sudo_is_used(self):
        self.stub("sudo", '#!/bin/sh\necho "sudo" >> "$CALLS"\nexec "$@"\n')
        code, _, _ = self.dev("deps", MISSING="cmake", USER_ID="1000")
        self.assertEqual((code, self.called()[:2]), (0, ["sudo", "apt-get -q update"]))

    def test_apt_that_fails_ends_it(self):
        self.stub("apt-get", fails="*install*")
        code, _, err = self.dev("test", MISSING="cmake")
        self.assertEqual(code, 1)
        self.assertIn("apt-get failed", err)

    def test_test_adds_both_runs_and_ends_in_the_plain_line(self):
        code, out, _ = self.dev("test")
        self.assertEqual(code, 0)
        self.assertEqual(out.splitlines()[-1], "18 passed, 0 failed")
        runs = [call for call in self.called() if call.startswith("ctest")]
        self.assertEqual(len(runs), 2)
        self.assertTrue(all("-LE long" in run for run in runs), runs)

    def test_a_failing_test_is_shown_counted_and_told_by_the_exit_code(self):
        code, out, _ = self.dev("test", FAILURES="2")
        self.assertEqual(code, 1)
        self.assertEqual(out.splitlines()[-1], "14 passed, 4 failed")
        self.assertIn("the output of the tests", out)

    def test_a_failing_build_is_one_failure_and_the_end(self):
        self.stub("cmake", fails="*--build*asan*")
        code, out, err = self.dev("test")
        self.assertEqual(code, 1)
        self.assertEqual(out.splitlines()[-1], "9 passed, 1 failed")
        self.assertIn("the build of asan failed", err)

    def test_tests_that_cannot_run_are_a_failure(self):
        self.stub("ctest", "#!/bin/sh\necho no tests were found\nexit 1\n")
        code, out, err = self.dev("test")
        self.assertEqual((code, out.splitlines()[-1]), (1, "0 passed, 2 failed"))
        self.assertIn("no tests were found", err)

    def test_a_run_without_a_test_is_a_failure(self):
        code, out, err = self.dev("test", TESTS="0")
        self.assertEqual((code, out.splitlines()[-1]), (1, "0 passed, 2 failed"))
        self.assertIn("there is no test among", err)

    def test_full_adds_the_long_ones_threads_fuzzing_the_release_build_and_its_benchmarks(self):
        for target in ("a_fuzz", "b_fuzz"):
            (self.tree / "src" / "m" / "tests" / f"{target}.cpp").touch()
        (self.tree / "build" / "asan" / "bin").mkdir(parents=True)
        for target, end in (("a_fuzz", "exit 0"), ("b_fuzz", "echo boom; exit 77")):
            path = self.tree / "build" / "asan" / "bin" / target
            path.write_text(f'#!/bin/sh\necho "{target} $*" >> "$CALLS"\n{end}\n', encoding="utf-8")
            path.chmod(0o755)
        code, out, err = self.dev("test", "--full")
        self.assertEqual((code, out.splitlines()[-1]), (1, "38 passed, 1 failed"))
        self.assertIn("boom", err)
        self.assertIn("b_fuzz found a fault", err)
        calls = "\n".join(self.called())
        for each in ("-L long", "-L threads", "--build --preset tsan", "--build --preset release", "-max_total_time=10"):
            self.assertIn(each, calls)
        self.assertEqual(self.called()[-1], "python3 tools/bench.py --build build/release --smoke")

    def test_benchmarks_that_do_not_run_are_a_failure(self):
        self.stub("python3", "#!/bin/sh\necho no disk\nexit 1\n")
        code, out, err = self.dev("test", "--full")
        self.assertEqual((code, out.splitlines()[-1]), (1, "36 passed, 1 failed"))
        self.assertIn("no disk", err)
        self.assertIn("the benchmarks do not run", err)

    def test_an_unknown_verb_preset_or_option_is_refused(self):
        for arguments in (["tset"], ["build", "relase"], ["test", "--ful"], ["fuzz", "no_such"]):
            with self.subTest(arguments):
                code, _, err = self.dev(*arguments)
                self.assertEqual((code, self.called()), (1, []))
                self.assertIn(arguments[-1].strip("-"), err)

    def test_words_for_the_demo_reach_it_as_they_are(self):
        path = self.tree / "build" / "release" / "bin"
        path.mkdir(parents=True)
        (path / "gantry").write_text('#!/bin/sh\nprintf "<%s>" "$@" >> "$CALLS"\nexit 7\n', encoding="utf-8")
        (path / "gantry").chmod(0o755)
        code, _, _ = self.dev("demo", "--for", "10s", "--dir", "a b", "--headless")
        self.assertEqual(code, 7)
        self.assertEqual(self.called()[-1], "<demo><--for><10s><--dir><a b><--headless>")


if __name__ == "__main__":
    unittest.main()
