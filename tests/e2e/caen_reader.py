"""`gantry emulate caen` with known tags, for the programs of caen_clients.py."""

import json
import subprocess

from caen_wire import Tcp
from gantry_e2e import EndToEnd, Process, wait_for

SHORT, LONG_ID, FAR = "300833B2DDD9014035050000", "0102030405060708091011121314151617181920", "3074257BF7194E4000001A85"
TID_OF_SHORT, USER = "E2801160600002054E1A1234", "00112233445566778899AABBCCDDEEFF"
# Two tags in front of Ant0, of 96 and 160 bits, and one in front of Ant1.
TAGS = f"""epc,tid,user,access_password,kill_password,antenna,rssi_dbm
{SHORT},{TID_OF_SHORT},{USER},,,1,-50
{LONG_ID},E2003412,{USER},11223344,55667788,1,-45
{FAR},,,,,2,-60
"""


class CaenReader(EndToEnd):
    def emulate(self, *arguments, tags=TAGS, place=("--listen", "127.0.0.1:0")):
        file = self.directory() / "tags.csv"
        file.write_text(tags)
        command = ["emulate", "caen", *place, "--tags", file, "--set", "round=20ms", *arguments]
        self.reader = self.under_way(Process(command, stdin=subprocess.PIPE))
        return self.reader

    def listening(self, *arguments, **more):
        """The port of a virtual reader."""
        self.emulate(*arguments, **more)
        return int(self.reader.wait_for_line(r"^listening on .*:(\d+)$")[1])

    def wire(self, *arguments, **more):
        return self.connect(self.listening(*arguments, **more))

    def connect(self, port):
        wire = Tcp(port)
        self.addCleanup(wire.close)
        return wire

    def state(self):
        before = len(self.reader.out.lines())
        self.reader.say("state")
        line = wait_for(lambda: self.reader.out.lines()[before:], "its state")[0]
        return json.loads(line)["state"]

    def hand(self, words):
        """A hand at the device; done when it answers again."""
        self.reader.say(words)
        self.state()
