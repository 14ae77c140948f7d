"""What a proof found: figures, and what must hold."""

import json
import platform
import time
from pathlib import Path


def machine():
    cpu = next((line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
                if line.startswith("model name")), platform.machine())
    cores = Path("/proc/cpuinfo").read_text().count("\nprocessor") + 1
    memory = int(Path("/proc/meminfo").read_text().split()[1]) // 1024 // 1024
    return f"{cpu}, {cores} cores, {memory} GiB, Linux {platform.release()}"


class Proof:
    """One run of one row. `options` has quick, bite, build, keep, and what the row itself takes."""

    def __init__(self, row, title, options, command):
        self.row, self.title, self.options, self.command = row, title, options, command
        self.figures, self.faults, self.losses = {}, [], 0
        self._begun = time.monotonic()

    def say(self, text):
        print(f"{self.row}: {text}", flush=True)

    def begin(self):
        self.say(self.title)
        self.say(f"machine: {machine()}")
        self.say(f"date: {time.strftime('%Y-%m-%d %H:%M:%S %Z')}")
        self.say(f"command: {self.command}")

    def figure(self, name, value, unit=""):
        self.figures[name] = value
        shown = f"{value:,}" if isinstance(value, int) else f"{value:.3g}" if isinstance(value, float) else str(value)
        self.say(f"  {name:<52} {shown} {unit}".rstrip())

    def must(self, name, holds, shown, loss=False):
        """A requirement. `loss`: what a build that misbehaves on purpose has to be found out by."""
        self.figures[name] = shown
        self.say(f"  {name:<52} {shown:,}{'' if holds else '   <-- must not be'}" if isinstance(shown, int) else
                 f"  {name:<52} {shown}{'' if holds else '   <-- must not be'}")
        if not holds:
            self.faults.append(name)
            self.losses += loss
        return holds

    def must_be_zero(self, name, value, loss=False):
        return self.must(name, value == 0, value, loss)

    # Times, rates and memory are not judged at the size for CI: it is too short, and the machine may be busy.

    def must_be_at_most(self, name, value, most, unit=""):
        return self._measured(name, value <= most, value, unit, f"at most {most:g}")

    def must_be_at_least(self, name, value, least, unit=""):
        return self._measured(name, value >= least, value, unit, f"at least {least:g}")

    def _measured(self, name, holds, value, unit, bound):
        quick = self.options.quick
        shown = f"{value:.3g} {unit} ({bound}{'; not judged at this size' if quick else ''})".replace("  ", " ")
        return self.must(name, holds or quick, shown)

    def end(self):
        """The exit code: 0 only if all holds, or, for a bite, only if losses were found."""
        seconds = time.monotonic() - self._begun
        if self.options.bite:
            passed = self.losses > 0
            verdict = "it bites: losses were found" if passed else "IT DOES NOT BITE: no loss was found"
        else:
            passed = not self.faults
            verdict = "passed" if passed else f"FAILED: {'; '.join(self.faults)}"
        self.say(f"{verdict} ({seconds:.0f} s)")
        self.passed = passed
        return 0 if passed else 1

    def json(self):
        return json.dumps({"row": self.row, "title": self.title, "machine": machine(), "date": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
                           "command": self.command, "bite": self.options.bite, "quick": self.options.quick,
                           "passed": self.passed, "faults": self.faults, "figures": self.figures}, indent=2) + "\n"
