"""What the shell offers, asked of bash itself; zsh and fish where they are installed."""

import shutil
import subprocess
import unittest

from gantry_cli import gantry


class Bash(unittest.TestCase):
    def offers(self, *words):
        script = gantry("completion", "bash").out
        line = " ".join(f"'{word}'" for word in words)
        script += (f"\nCOMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; COMP_LINE=\"${{COMP_WORDS[*]}}\"; COMP_POINT=${{#COMP_LINE}}; "
                   "_gantry; printf '%s\\n' \"${COMPREPLY[@]}\"")
        done = subprocess.run(["bash", "--norc", "-u", "-c", script], capture_output=True, text=True, check=True)
        self.assertEqual("", done.stderr)
        return done.stdout.split()

    def test_commands_are_offered(self):
        self.assertLessEqual({"decode", "encode", "epc", "config"}, set(self.offers("gantry", "")))
        self.assertEqual(["decode"], self.offers("gantry", "dec"))
        self.assertEqual(["check", "schema", "example"], self.offers("gantry", "config", ""))

    def test_options_are_offered_where_one_begins(self):
        self.assertEqual(["--raw"], self.offers("gantry", "decode", "--r"))
        self.assertIn("--log-level", self.offers("gantry", "epc", "decode", "--"))

    def test_the_words_of_an_option_are_offered(self):
        self.assertEqual(["silion"], self.offers("gantry", "decode", "-p", "s"))
        self.assertEqual(["to-reader", "to-host"], self.offers("gantry", "decode", "--direction", ""))
        self.assertEqual(["to-host"], self.offers("gantry", "decode", "--direction", "=", "to-h"))
        self.assertIn("debug", self.offers("gantry", "--log-level", ""))

    def test_files_are_offered_where_one_is_wanted_and_nowhere_else(self):
        for line in (("gantry", "run", "-c"), ("gantry", "emulate", "silion", "--tags"), ("gantry", "events", "query", "--db")):
            self.assertIn("/etc", self.offers(*line, "/et"))
        self.assertIn("/etc", self.offers("gantry", "decode", "/et"))
        self.assertIn("/etc", self.offers("gantry", "reader", "config", "apply", "dock", "/et"))
        self.assertIn("/etc", self.offers("gantry", "reader", "config", "dump", "dock", "-o", "/et"))
        for line in (("gantry", "demo", "--for"), ("gantry", "emulate", "silion", "--name"), ("gantry", "epc", "decode")):
            self.assertEqual([], self.offers(*line, "/et"))
        self.assertEqual(["R4300P"], self.offers("gantry", "emulate", "caen", "--model", "R4300"))

    def test_the_types_of_events_are_offered(self):
        for verb in ("tail", "query", "export"):
            self.assertEqual(["reader.connected", "reader.disconnected", "reader.fault", "reader.*"],
                             self.offers("gantry", "events", verb, "--type", "reader."))

    def test_messages_are_offered_and_makes(self):
        self.assertEqual(["SetGpo"], self.offers("gantry", "encode", "-p", "silion", "-d", "to-reader", "SetG"))
        self.assertLessEqual({"silion", "caen", "harting"}, set(self.offers("gantry", "config", "example", "")))


class OtherShells(unittest.TestCase):
    def accepts(self, shell):
        script = gantry("completion", shell)
        self.assertEqual(0, script.code)
        self.assertIn("decode", script.out)
        self.assertIn("tag.new tag.observed", script.out)
        if shutil.which(shell) is None:
            self.skipTest(f"{shell} is not installed: only the text was looked at")
        done = subprocess.run([shell, "-n"], input=script.out, capture_output=True, text=True, check=False)
        self.assertEqual((0, ""), (done.returncode, done.stderr))

    def test_zsh_reads_its_script(self):
        self.accepts("zsh")

    def test_fish_reads_its_script(self):
        self.accepts("fish")

    def test_an_unknown_shell_is_refused(self):
        done = gantry("completion", "tcsh")
        self.assertEqual(2, done.code)
        self.assertIn("tcsh", done.err)


if __name__ == "__main__":
    unittest.main()
