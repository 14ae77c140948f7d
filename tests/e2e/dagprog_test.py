"""DAGProg units on a serial line: a pseudo-terminal with a virtual unit at its other end."""

import subprocess
import unittest

from gantry_e2e import EVERY_READ, EndToEnd, Process, run, wait_for

UID = "E004010012345678"
TAGS = f"epc,technology,user\n{UID},iso15693,0012341F\n"
CODE = {"iso15693": TAGS, "icode1": "epc,technology\n0102030405060708,icode1\n"}


class Line(EndToEnd):
    def emulate(self, *arguments, family="iso15693"):
        file = self.directory() / "tags.csv"
        file.write_text(CODE[family])
        self.line = self.directory() / "ttyD0"
        command = ["emulate", "dagprog", "--pty", self.line, "--family", family, "--tags", file, *arguments]
        emulation = self.under_way(Process(command, stdin=subprocess.PIPE))
        emulation.wait_for_line(f"^listening on {self.line}$")
        return emulation

    def reading(self, settings=""):
        toml = f'[[reader]]\nname = "desk"\naddress = "dagprog://{self.line}?baud=38400"\nzone = "desk"\n{settings}'
        return self.gateway(toml + EVERY_READ)

    def test_a_gateway_reads_writes_and_reads_on(self):
        emulation = self.emulate("--set", "separator=space")
        gateway = self.reading()
        gateway.wait_for_events(1, "tag.observed", tag=UID, technology="iso15693", zone="desk")
        wait_for(lambda: "values after space" in gateway.cli("reader", "info", "desk").out, "its forms are found out")
        self.assert_done(gateway.cli("tag", "write", "desk", UID, "--technology", "iso15693", "--offset", "5",
                                      "--data", "11223344"))
        read = ["tag", "read", "desk", UID, "--technology", "iso15693", "--offset", "5"]
        self.assertEqual("11223344\n", self.assert_done(gateway.cli(*read)).out)
        last = gateway.status()["last_seq"]
        wait_for(lambda: any(row["seq"] > last for row in gateway.events("tag.read")), "it reads on")
        emulation.say("restart")
        gateway.wait_for_events(1, "reader.fault", reader="desk")
        last = gateway.status()["last_seq"]
        wait_for(lambda: any(row["seq"] > last for row in gateway.events("tag.read")), "it reads after a restart")
        self.assert_done(gateway.cli("reader", "config", "set", "desk", "FirstBlock", "3"))
        self.assertIn("3", self.assert_done(gateway.cli("reader", "config", "get", "desk", "FirstBlock")).out)

    def test_straight_to_an_icode1_unit(self):
        self.emulate("--set", "stx=yes", family="icode1")
        address = f"dagprog://{self.line}"
        answer = self.assert_done(run("reader", "exec", "--address", address, "ReadSerialNumber", "--json"))
        self.assertIn("0102030405060708", answer.out)
        self.assert_refused(run("reader", "exec", "--address", address, "WriteData", "Block=2", "Data=00"),
                            "force_system_blocks")


if __name__ == "__main__":
    unittest.main()
