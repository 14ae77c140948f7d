"""Commands that speak to a reader themselves, where the reader is the one that dials."""

import json
import re
import socket
import unittest

from gantry_e2e import EndToEnd, Process, run


class AReaderThatDialsIn(EndToEnd):
    def setUp(self):
        with socket.create_server(("127.0.0.1", 0)) as any_port:
            self.place = f"127.0.0.1:{any_port.getsockname()[1]}"

    def emulate(self, name):
        command = ["emulate", "silion", "--connect", self.place, "--name", name, "--set", "batch=100ms"]
        return self.under_way(Process(command))

    def cli(self, *arguments):
        return run(*arguments, "--address", f"silion-listen://{self.place}", "--set", "heartbeat=10s")

    def test_is_waited_for_and_told(self):
        self.emulate("gate-1")
        done = self.assert_done(self.cli("gpio", "get"))
        self.assertRegex(done.out, r"^input 1: off\n")
        self.assertRegex(self.assert_done(self.cli("reader", "info")).out, r"(?m)^name +gate-1$")

    def test_keeps_its_reads_for_the_gateway(self):
        emulation = self.emulate("gate-1")
        rows = self.assert_done(self.cli("reader", "watch", "--for", "2500ms", "--json")).json_lines()
        self.assertGreater(rows[-1]["reads"], 0)
        self.assertEqual(0, rows[-1]["counters"]["acknowledged"])
        self.assertEqual(0, emulation.end())
        self.assertEqual(0, json.loads(emulation.out.lines()[-1])["state"]["reads_acked"])

    def test_is_known_by_its_name(self):
        self.emulate("gate-1")
        self.assert_refused(self.cli("gpio", "get", "gate-2", "--timeout", "1500ms"), "no reader called gate-2")
        self.emulate("gate-2")
        self.assertTrue(re.match("input 1", self.assert_done(self.cli("gpio", "get", "gate-2", "--timeout", "15s")).out))


if __name__ == "__main__":
    unittest.main()
