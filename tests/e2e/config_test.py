"""Wrong configuration: `gantry config check` and `gantry run` say where it is, what is wrong, and what to do."""

import json
import re
import unittest

from gantry_e2e import READER, EndToEnd, Process, run

GOOD_READER = '[[reader]]\nname = "gate"\naddress = "silion-listen://127.0.0.1:0"\n'
SECOND_READER = '[[reader]]\nname = "gate"\naddress = "silion-listen://127.0.0.1:0"\n'

# What stands in the file, the place of the error (line and column), and words of the message and the suggestion.
WRONG = {
    "broken_toml": ("[gateway\n", "1:9", "]"),
    "text_without_an_end": ('[gateway]\nid = "site\n', "2:", ""),
    "key_twice": ("[events]\ntag_read = true\ntag_read = false\n", "3:1", "tag_read"),
    "unknown_section": ("[presense]\n", "1:2", 'unknown section "presense"; did you mean [presence]?'),
    "unknown_key": ('[presence]\nloose_after = "2s"\n', "2:1", 'unknown key "loose_after" in [presence]; did you mean "lose_after"?'),
    "unknown_reader_key": (GOOD_READER + 'zon = "dock"\n', "4:1", 'did you mean "zone"?'),
    "duration_as_number": ("[presence]\nlose_after = 2\n", "2:14", 'number; write it like "500ms"'),
    "no_duration": ('[presence]\nlose_after = "soon"\n', "2:14", 'lose_after = "soon" is no duration; write it like'),
    "duration_too_short": ('[presence]\nlose_after = "0s"\n', "2:14", "too short; it must be at least"),
    "no_size": ('[store]\nmax_size = "plenty"\n', "2:12", 'max_size = "plenty" is no size; write it like "512MiB"'),
    "size_too_small": ('[store]\nmax_size = "1KiB"\n', "2:12", 'too small; it must be at least "1MiB"'),
    "choice": ('[store]\non_full = "drop_oldst"\n', "2:11", 'did you mean "drop_oldest"?'),
    "boolean_as_text": ('[events]\ntag_read = "yes"\n', "2:12", "expected true or false"),
    "reader_without_address": ('[[reader]]\nname = "gate"\n', "1:", "[[reader]] has no address"),
    "reader_without_name": ('[[reader]]\naddress = "silion-listen://127.0.0.1:0"\n', "1:", "[[reader]] has no name"),
    "unknown_scheme": ('[[reader]]\nname = "gate"\naddress = "silion-lisen://127.0.0.1:0"\n', "3:11", "did you mean"),
    "port_too_large": ('[[reader]]\nname = "gate"\naddress = "silion-listen://127.0.0.1:70000"\n', "3:11", "70000"),
    "no_network": (GOOD_READER + 'from = ["192.168.0.0/240"]\n', "4:", 'from = "192.168.0.0/240" is no network; write it like'),
    "name_twice": (GOOD_READER + SECOND_READER, "5:8", "is already defined at line 2; names must differ"),
    "no_such_antenna": (GOOD_READER + '[[reader.antenna]]\nname = "Antenna1"\nzone = "a"\n', "5:8", 'theirs are called "Ant1", "Ant2"'),
    "setting_of_the_make": (GOOD_READER + 'heartbeat = "often"\n', "4:13", "heartbeat"),
    "choice_of_the_make": (GOOD_READER + 'crc = "modbuss"\n', "4:7", "modbus"),
    "section_once": ("[reader]\nname = \"gate\"\n", "1:2", "there may be several: write [[reader]]"),
    "sink": ('[[sink]]\nname = "broker"\ntype = "mqtt"\n', "1:", "needs a url"),
    "id_with_blanks": ('[gateway]\nid = "my site"\n', "2:6", "use 1 to 64 letters"),
}


class Wrong(EndToEnd):
    """One test a row of the table, made below."""

    def look(self, text, place, words):
        file = self.directory() / "gantry.toml"
        file.write_text(text)
        checked = run("config", "check", file)
        self.assert_refused(checked, f"{file}:{place}", words)
        self.assertRegex(checked.err, rf"^{re.escape(str(file))}:\d+:\d+: ")
        # Nothing runs on a file that is wrong, and the same words say why.
        ran = run("run", "-c", file)
        self.assertEqual(1, ran.code)
        self.assertIn(checked.err.strip(), ran.err)
        self.assertEqual("", ran.out)


for _name, _row in WRONG.items():
    setattr(Wrong, f"test_{_name}", lambda self, row=_row: self.look(*row))


class Check(EndToEnd):
    def file(self, text):
        file = self.directory() / "gantry.toml"
        file.write_text(text)
        return file

    def test_all_errors_are_told_at_once_in_the_order_of_the_file(self):
        done = run("config", "check", self.file('[presence]\nlose_after = 1\n[store]\nkeep = "x"\nmax_siz = "1MiB"\n'))
        self.assertEqual(1, done.code)
        self.assertEqual(["2:14", "4:8", "5:1"], re.findall(r"toml:(\d+:\d+): ", done.err))

    def test_a_good_file_is_called_good(self):
        done = self.assert_done(run("config", "check", self.file(READER)))
        self.assertRegex(done.out, "gantry.toml: good, 1 reader\n$")

    def test_a_warning_is_no_error(self):
        done = self.assert_done(run("config", "check", self.file(READER + '[api]\nlisten = "127.0.0.1:8477"\n')))
        self.assertIn("api.listen is not served by this version", done.err)
        self.assertIn("with warnings", done.out)

    def test_the_verdict_as_json(self):
        good = json.loads(run("config", "check", "--json", self.file(READER)).out)
        self.assertEqual((True, [], 1), (good["valid"], good["errors"], good["readers"]))
        done = run("config", "check", "--json", self.file("[presense]\n"))
        bad = json.loads(done.out)
        self.assertEqual((1, False, 1), (done.code, bad["valid"], len(bad["errors"])))

    def test_from_standard_input(self):
        self.assert_done(run("config", "check", "-", text=READER))
        self.assert_refused(run("config", "check", "-", text="[presense]\n"), "stdin:1:2")

    def test_a_file_that_is_not_there(self):
        for verb in (["config", "check"], ["run", "-c"]):
            done = run(*verb, "/nowhere/gantry.toml")
            self.assertEqual((1, ""), (done.code, done.out))
            self.assertIn("/nowhere/gantry.toml: there is no such file; `gantry config example` prints one", done.err)

    def test_wrong_usage_is_told_from_a_wrong_file(self):
        self.assertEqual(2, run("config", "check", "--jsno").code)
        self.assertEqual(2, run("run", "-c").code)

    def test_the_example_is_good_and_runs(self):
        directory = self.directory()
        example = run("config", "example").out
        file = directory / "gantry.toml"
        file.write_text(example)
        self.assert_done(run("config", "check", file))
        # On this machine's terms: any port, and a directory that is ours.
        file.write_text(re.sub(r"silion-listen://[^\"]*", "silion-listen://127.0.0.1:0", example))
        process = self.under_way(Process(["run", "-c", file, "--data-dir", directory / "data"]))
        process.wait_for_line("^ready$")
        self.assertEqual(0, process.end())

    def test_the_example_of_a_make_is_good(self):
        self.assert_done(run("config", "check", "-", text=self.assert_done(run("config", "example", "silion")).out))
        self.assertEqual(2, run("config", "example", "silicon").code)

    def test_the_schema_is_json_and_knows_every_section(self):
        schema = json.loads(self.assert_done(run("config", "schema")).out)
        self.assertLessEqual({"gateway", "reader", "presence", "zone", "events", "store", "api"}, set(schema["properties"]))


if __name__ == "__main__":
    unittest.main()
