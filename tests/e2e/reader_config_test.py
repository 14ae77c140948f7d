"""A reader's parameters as a file: dumped, compared, set again."""

import json
import re
import tomllib
import unittest

from virtual_reader import WithVirtualReader, directly


class Files:
    """What works over a gateway and without one; `cli` runs a command about the reader `dock`."""

    def config(self, verb, *arguments, **more):
        return self.cli("reader", "config", verb, "dock", *arguments, **more)

    def file(self, text, name="dock.toml"):
        path = self.directory() / name
        path.write_text(text)
        return path

    def test_a_dump_is_toml_with_what_it_means(self):
        text = self.assert_done(self.config("dump")).out
        values = tomllib.loads(text)
        self.assertEqual("EPCC1G2", values["Protocol"])
        self.assertIn("Session", values["Source_0"])
        self.assertRegex(text, r"(?m)^Power = \d+ +# mW; ")
        self.assertRegex(text, r'(?m)^# Firmware = ".+" +# .*read only$')
        self.assertRegex(text, r"(?m)^# dock|^# caen://")

    def test_a_dump_to_a_file_says_so(self):
        path = self.directory() / "dock.toml"
        self.assertRegex(self.assert_done(self.config("dump", "-o", path)).out, r"dock.toml: \d+ parameters of ")
        self.assertIn("Power", tomllib.loads(path.read_text()))
        self.assertEqual([path.name], [each.name for each in path.parent.iterdir()])

    def test_what_was_dumped_is_the_same(self):
        path = self.file(self.assert_done(self.config("dump")).out)
        self.assertRegex(self.assert_done(self.config("diff", path)).out, r"is as .*dock\.toml says\n$")
        self.assertRegex(self.assert_done(self.config("apply", path)).out, r"nothing to do\n$")

    def test_a_difference_is_shown_by_name_and_exits_with_1(self):
        self.assert_done(self.config("set", "Power", "321"))
        done = self.config("diff", self.file('Power = 123\nProtocol = "epcc1g2"\n[Source_0]\nSession = 0\n'))
        self.assertEqual(1, done.code, done.err)
        self.assertRegex(done.out, r"(?m)^Power +321 +123$")
        self.assertNotIn("Protocol", done.out)  # names count in any case
        line, = [json.loads(line) for line in self.config("diff", "-", "--json", text="Power = 123\n").out.splitlines()]
        self.assertEqual({"parameter": "Power", "reader": 321, "file": "123"}, line)

    def test_only_what_differs_is_set(self):
        self.assert_done(self.config("set", "Power", "321"))
        path = self.file("Power = 123\n[Source_0]\nSession = 0\n")
        planned = self.assert_done(self.config("apply", path, "--dry-run")).out
        self.assertEqual("Power: 321 -> 123\n1 of 2 would be set\n", planned)
        self.assertEqual(321, self.state()["power_mw"])
        self.assertEqual("Power: 321 -> 123\n1 of 2 set\n", self.assert_done(self.config("apply", path)).out)
        self.assertEqual(123, self.state()["power_mw"])
        report, = self.assert_done(self.config("apply", path, "--json")).json_lines()
        self.assertEqual(([], [], False), (report["set"], report["not_set"], report["restarted"]))

    def test_it_stops_at_the_first_refusal_and_says_what_was_done(self):
        self.assert_done(self.config("set", "Power", "321"))
        path = self.file('Power = 9999999\n"Source_0.Session" = 2\n')
        done = self.config("apply", path)
        self.assertEqual(1, done.code)
        self.assertRegex(done.err, r"Power: failed; .*; nothing was set before it; not set: Source_0\.Session")
        self.assertEqual(321, self.state()["power_mw"])

    def test_what_is_wrong_in_a_file_has_its_place(self):
        done = self.config("apply", self.file("Power = 1\nPower = 2\n"))
        self.assertEqual(1, done.code)
        self.assertRegex(done.err, r"dock\.toml:2:\d+: ")
        done = self.config("diff", self.file('Powr = 1\nPower = [1]\nProtocol = "EPC"\nFirmware = "x"\n'))
        self.assertEqual(2, done.code)
        said = done.err.splitlines()
        self.assertRegex(said[0], r'dock\.toml:1:1: caen readers have no parameter "Powr"; did you mean Power\?$')
        self.assertRegex(said[1], r"dock\.toml:2:9: Power must be text, a number, true or false, not ")
        self.assertRegex(said[2], r'dock\.toml:3:12: Protocol cannot be "EPC"; ')
        self.assertEqual(3, len(said))
        done = self.config("apply", self.file('Firmware = "x"\n'))
        self.assertRegex(done.err, r"dock\.toml:1:12: Firmware can only be read, and is ")

    def test_files_and_readers_that_are_not_there(self):
        self.assertEqual(2, self.config("diff", "/nowhere/dock.toml").code)
        self.assert_refused(self.config("apply", "/nowhere/dock.toml"), "/nowhere/dock.toml")

    def test_this_make_keeps_nothing_permanently(self):
        self.assert_refused(self.config("set", "Power", "123", "--permanent"), "unsupported", "at will")
        self.assert_refused(self.config("dump", "--permanent"), "unsupported")
        self.assert_refused(self.config("apply", self.file("Power = 5\n"), "--restart"), "add --permanent", code=2)


class OverTheGateway(Files, WithVirtualReader):
    def setUp(self):
        self.running = self.dialling(self.reader())
        self.running.wait_for_events(1, "reader.connected")

    def cli(self, *arguments, **more):
        return self.running.cli(*arguments, **more)

    def test_a_reader_or_a_file_that_is_not_there(self):
        self.assert_refused(self.config("apply"), "FILE is missing", code=2)
        self.assertEqual(2, self.running.cli("reader", "config", "diff", "nope", self.file("")).code)

    def test_help_says_how_diff_exits(self):
        self.assertRegex(re.sub(r"\s+", " ", self.running.cli("reader", "config", "diff", "--help").out),
                         "0 the same, 1 different, 2 trouble")


class Directly(Files, WithVirtualReader):
    def setUp(self):
        self.address = self.reader()

    def cli(self, *arguments, **more):
        return directly(self.address, *arguments, **more)

    def test_the_readers_name_may_be_left_out(self):
        text = self.assert_done(self.cli("reader", "config", "dump")).out
        path = self.file(text)
        self.assert_done(self.cli("reader", "config", "diff", path))
        self.assert_done(self.cli("reader", "config", "apply", path))


if __name__ == "__main__":
    unittest.main()
