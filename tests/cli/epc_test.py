"""gantry epc, by the examples of the Tag Data Standard."""

import json
import unittest

from gantry_cli import gantry

SGTIN = "3074257BF7194E4000001A85"


class Epc(unittest.TestCase):
    def test_decode_as_json_has_the_documented_members(self):
        done = gantry("epc", "decode", "--json", SGTIN)
        self.assertEqual(
            {
                "hex": SGTIN,
                "scheme": "sgtin-96",
                "filter": 3,
                "epc": "urn:epc:id:sgtin:0614141.812345.6789",
                "tag_uri": "urn:epc:tag:sgtin-96:3.0614141.812345.6789",
                "gs1": "(01)80614141123458(21)6789",
                "link": "https://id.gs1.org/01/80614141123458/21/6789",
            },
            json.loads(done.out),
        )

    def test_many_tags_come_through_a_pipe(self):
        done = gantry("epc", "decode", "--json", "-", give=f"{SGTIN}\n" * 1000)
        self.assertEqual((0, 1000), (done.code, len(done.lines())))

    def test_what_is_no_epc_is_unknown_with_a_reason(self):
        line = json.loads(gantry("epc", "decode", "--json", "E20041453116003820703FB7").out)
        self.assertEqual(("unknown", {"hex", "scheme", "reason"}), (line["scheme"], set(line)))

    def test_encode_gives_what_decode_took(self):
        uri = json.loads(gantry("epc", "decode", "--json", SGTIN).out)["tag_uri"]
        self.assertEqual(f"{SGTIN}\n", gantry("epc", "encode", uri).out)

    def test_errors_are_one_line(self):
        for arguments in (["decode", "nothex"], ["encode", "urn:epc:tag:sgtin-96:9.1.2.3"]):
            done = gantry("epc", *arguments)
            self.assertEqual((1, "", 1), (done.code, done.out, done.err.count("\n")))
            self.assertTrue(done.err.startswith(f"gantry epc {arguments[0]}: "), done.err)


if __name__ == "__main__":
    unittest.main()
