"""Help that is worth reading, wrong usage, and a completion script that bash takes. What the offline commands print is
looked at in tests/cli."""

import re
import subprocess
import unittest

from gantry_e2e import BINARY, EndToEnd, run


def subcommands(*path):
    """What --help lists below "Subcommands"."""
    text = run(*path, "--help").out
    listed = re.search(r"(?m)^[A-Z][A-Za-z]*ommands:\n((?: +.*\n?)+)", text)
    return re.findall(r"(?m)^  ([a-z][a-z-]*)\b", listed[1]) if listed else []


def all_commands():
    found, left = [], [()]
    while left:
        path = left.pop()
        found.append(path)
        left += [(*path, name) for name in subcommands(*path)]
    return found


class Help(EndToEnd):
    def test_every_command_has_help_worth_reading(self):
        commands = all_commands()
        self.assertLessEqual({("run",), ("demo",), ("emulate",), ("decode",), ("encode",), ("events", "tail"), ("events", "query"),
                              ("events", "export"), ("reader", "list"), ("reader", "info"), ("gpio", "get"), ("gpio", "set"),
                              ("config", "check"), ("config", "schema"), ("config", "example"), ("epc", "decode"),
                              ("completion",)}, set(commands))
        for command in commands:
            done = self.assert_done(run(*command, "--help"))
            self.assertEqual("", done.err)
            self.assertIn("gantry", done.out)
            self.assertIn("-h,--help", done.out)
            if command:
                self.assertIn("Examples:", done.out, command)

    def test_the_version(self):
        self.assertRegex(self.assert_done(run("--version")).out, r"^gantry \d+\.\d+\.\d+\n$")

    def test_wrong_usage_exits_with_2_and_one_line(self):
        for arguments, words in ((["rnu"], "run"), (["reader"], "list"), (["reader", "lsit"], "list"), (["run", "--jsno"], "--json"),
                                 (["decode", "-p", "silicon", "-d", "to-host"], "silion"), (["decode"], "--help"),
                                 (["emulate", "silion", "--count", "0", "--connect", "127.0.0.1:1"], "count"),
                                 (["gpio", "set", "gate-1"], "OUTPUT"), (["events", "tail", "--last", "many"], "last"),
                                 (["--log-level", "loud", "run"], "debug")):
            self.assert_refused(run(*arguments), words, code=2)

    def test_with_nothing_to_do_it_shows_its_help(self):
        done = run()
        self.assertEqual((2, ""), (done.code, done.out))
        self.assertIn("Every command has its own --help", done.err)

    def test_output_that_cannot_be_written_is_no_success(self):
        with open("/dev/full", "wb") as full:
            for command in (["config", "schema"], ["config", "example"], ["epc", "decode", "3074257BF7194E4000001A85"]):
                ended = subprocess.run([BINARY, *command], stdout=full, stderr=subprocess.PIPE, check=False)
                self.assertEqual(1, ended.returncode, command)
                self.assertIn(b"cannot write the output", ended.stderr)


class Completion(EndToEnd):
    def test_the_script_loads_in_bash(self):
        script = self.directory() / "gantry.bash"
        script.write_text(self.assert_done(run("completion", "bash")).out)
        checked = subprocess.run(["bash", "--norc", "-c", f"bash -n {script} && source {script} && complete -p gantry"],
                                 capture_output=True, text=True, check=False)
        self.assertEqual(("", 0), (checked.stderr, checked.returncode))
        self.assertRegex(checked.stdout, "^complete .* gantry\n$")

    def test_every_command_is_in_the_script(self):
        script = run("completion", "bash").out
        for command in all_commands():
            for word in command:
                self.assertIn(word, script)


if __name__ == "__main__":
    unittest.main()
