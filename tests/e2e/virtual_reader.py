"""One virtual reader that listens, of any make, and the commands about it: over a gateway or straight to it."""

import json
import subprocess

from gantry_e2e import EVERY_READ, EndToEnd, Process, run, wait_for

TAG = "3074257BF7194E4000001A85"
OTHER = "3074257BF7194E4000001A86"
USER = "00112233445566778899AABBCCDDEEFF"
ACCESS, KILL = "1122AABB", "00C0FFEE"
TAGS = f"epc,user,access_password,kill_password\n{TAG},{USER},{ACCESS},{KILL}\n"


class WithVirtualReader(EndToEnd):
    make = "caen"

    def emulate(self, *arguments):
        return self.under_way(Process(["emulate", self.make, *arguments], stdin=subprocess.PIPE))

    def tags(self, text=TAGS):
        file = self.directory() / "tags.csv"
        file.write_text(text)
        return file

    def reader(self, *arguments, tags=TAGS):
        """A virtual reader with one tag, and its address."""
        self.emulation = self.emulate("--tags", self.tags(tags), *arguments)
        return f"{self.make}://" + self.emulation.wait_for_line("^listening on (.*)$")[1]

    def section(self, address, more="", name="dock"):
        return f'[[reader]]\nname = "{name}"\naddress = "{address}"\nzone = "dock"\n{more}'

    def dialling(self, address, more="", **others):
        return self.gateway(self.section(address, more) + EVERY_READ, **others)

    def state(self):
        before = len(self.emulation.out.lines())
        self.emulation.say("state")
        lines = wait_for(lambda: self.emulation.out.lines()[before:], "its state")
        return json.loads(lines[0])["state"]


def directly(address, *arguments, **more):
    """A command about the reader `dock`, without a gateway."""
    return run(*arguments, "--address", address, **more)
