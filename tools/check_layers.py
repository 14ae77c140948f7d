#!/usr/bin/env python3
"""Holds every file under src/ to what its module's CMakeLists.txt declares.

  DEPENDS        the modules it may include, all of them on a lower layer
  FOREIGN        the outside headers it may include, by name or by prefix, and `clock`: it may read a clock
  TEST_DEPENDS, TEST_FOREIGN   the same, for tests/ alone

Also: heavy headers stay in .cpp files (or in an _impl.hpp, which no other module includes), and the words of a
make stay in its folder. Usage: check_layers.py SRC; prints one line a fault and exits 1 if there is one."""

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

from cpp_text import blank, line_of

# The layers of HACKING.md. A module depends on lower layers only; those of layer 1 may know one another, as
# long as it is no circle.
LAYERS = {
    "base": 0,
    "document": 1, "wire": 1, "event": 1, "epc": 1, "reader": 1, "sink": 1,
    "field": 2, "presence": 2, "journal": 2, "protocols": 2,
    "link": 3, "http": 3, "sinks": 3,
    "gateway": 4,
    "api": 5,
    "cli": 6,
}  # fmt: skip
FOLDERS = {"protocols": 2, "sinks": 3}  # modules below these folders
TEST_ONLY = {"testkit"}  # stands beside the layers: only tests include it

# Standard headers that say something about a design, so they must be declared. All others are free.
DECLARED_STANDARD = {
    "barrier", "condition_variable", "csignal", "filesystem", "fstream", "future", "iostream", "latch", "mutex",
    "semaphore", "shared_mutex", "stop_token", "thread",
}  # fmt: skip
# What any test may use.
TEST_FOREIGN = [
    *DECLARED_STANDARD, "gtest/", "gmock/", "rapidcheck", "fmt/", "tl/expected.hpp", "sys/", "netinet/", "arpa/",
    "fcntl.h", "malloc.h", "poll.h", "signal.h", "spawn.h", "stdlib.h", "unistd.h",
]  # fmt: skip
HEAVY = ["boost/asio", "boost/beast", "CLI/", "toml++/", "sqlite3.h", "spdlog/"]

MAKES = re.compile(r"caen|silion|harting|feig|dagprog", re.IGNORECASE)
# Where a make may be named in code outside its folder, and why.
MAKES_ALLOWED = {
    "cli/": "examples in --help",
}
CLOCK = re.compile(
    r"_clock\s*::\s*now\s*\(|\bgettimeofday\s*\(|\bclock_gettime\s*\(|\btimespec_get\s*\("
    r"|(?<![\w.>:])(?:std\s*::\s*|::\s*)?time\s*\(\s*(?:NULL|nullptr|0|&\s*\w+)\s*\)"
)
INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*(?:<([^>\n]+)>|"([^"\n]+)")', re.MULTILINE)
WORDS = ("DEPENDS", "FOREIGN", "LINK", "GENERATED", "TEST_DEPENDS", "TEST_FOREIGN", "TEST_LINK", "TEST_LABELS")


@dataclass
class Module:
    name: str
    folder: Path
    words: dict = field(default_factory=dict)

    def get(self, word):
        return self.words.get(word, [])


def layer(name):
    parent = name.split("/")[0]
    return FOLDERS[parent] if "/" in name and parent in FOLDERS else LAYERS.get(name)


def calls(text, function):
    """The arguments of every call of a CMake function, as lists of words."""
    text = re.sub(r"#[^\n]*", "", text)
    return [m.group(1).split() for m in re.finditer(rf"\b{function}\s*\(([^()]*)\)", text)]


def read_modules(src):
    makes, found = [], []
    for path in sorted(src.rglob("CMakeLists.txt")):
        text = path.read_text(encoding="utf-8")
        makes += ["protocols/" + call[0] for call in calls(text, "gantry_protocol")]
        found += [(path.parent, call) for call in calls(text, "gantry_module")]
    modules = {}
    for folder, call in found:
        module = Module(call[0], folder)
        word = None
        for each in call[1:]:
            if each in WORDS:
                word = module.words.setdefault(each, [])
            elif each == "${libraries}":  # written by gantry_protocol() lines
                word += makes
            elif word is not None:
                word.append(each)
        modules[module.name] = module
    return modules


def is_standard(header):
    return re.fullmatch(r"[a-z0-9_]+", header) is not None and header not in DECLARED_STANDARD


def allows(foreign, header):
    return any(
        header == each or (each not in DECLARED_STANDARD and each != "clock" and header.startswith(each))
        for each in foreign
    )


def circle(modules):
    """The names along a circle of DEPENDS, or nothing."""
    done, way = set(), []

    def visit(name):
        if name in way:
            return way[way.index(name) :] + [name]
        if name in done or name not in modules:
            return None
        way.append(name)
        found = next(filter(None, map(visit, modules[name].get("DEPENDS"))), None)
        way.pop()
        done.add(name)
        return found

    return next(filter(None, map(visit, modules)), None)


class Check:
    def __init__(self, src):
        self.src = src
        self.modules = read_modules(src)
        self.faults = []

    def fault(self, path, line, text):
        where = path.relative_to(self.src.parent) if path.is_relative_to(self.src.parent) else path
        self.faults.append(f"{where}:{line}: {text}")

    def run(self):
        if not self.modules:
            self.faults.append(f"{self.src}: no gantry_module() found")
        for module in self.modules.values():
            self.check_declaration(module)
            for folder, test in ((module.folder, False), (module.folder / "tests", True)):
                for path in sorted(folder.glob("*.[ch]pp")):
                    self.check_file(module, path, test)
        around = circle(self.modules)
        if around:
            self.faults.append("DEPENDS go round in a circle: " + " -> ".join(around))
        for path in sorted(self.src.rglob("*.[ch]pp")):
            if path.parent not in {m.folder for m in self.modules.values()} and path.parent.name != "tests":
                self.fault(path, 1, "this folder has no gantry_module()")
        return self.faults

    def check_declaration(self, module):
        where = module.folder / "CMakeLists.txt"
        own = layer(module.name)
        if module.name in TEST_ONLY:
            return
        if own is None:
            self.fault(where, 1, f"{module.name} has no layer: give it one in tools/check_layers.py and HACKING.md")
            return
        for name in module.get("DEPENDS"):
            below = layer(name)
            if name not in self.modules:
                self.fault(where, 1, f"{module.name} DEPENDS {name}, which is no module")
            elif name in TEST_ONLY:
                self.fault(where, 1, f"{module.name} DEPENDS {name}, which is for tests")
            elif not (below < own or below == own == 1 or name.startswith(module.name + "/")):
                self.fault(where, 1, f"{module.name} (layer {own}) DEPENDS {name} (layer {below})")

    def check_file(self, module, path, test):
        source = path.read_text(encoding="utf-8")
        code = blank(source)
        foreign = module.get("FOREIGN") + (module.get("TEST_FOREIGN") + TEST_FOREIGN if test else [])
        modules = {module.name, *module.get("DEPENDS")}
        if test:
            modules |= {*module.get("TEST_DEPENDS"), *TEST_ONLY}
        for match in INCLUDE.finditer(code):
            line = line_of(code, match.start())
            if match.group(1):
                self.check_outside(path, line, match.group(1), foreign, module, test)
            elif not (test and (path.parent / match.group(2)).is_file()):  # what tests of a folder share
                self.check_inside(path, line, match.group(2), modules, module)
        if "clock" not in foreign:
            for match in CLOCK.finditer(code):
                self.fault(path, line_of(code, match.start()), f"{module.name} may read no clock: time is an argument")
        self.check_makes(module, path, source, test)

    def check_outside(self, path, line, header, foreign, module, test):
        if not is_standard(header) and not allows(foreign, header):
            self.fault(path, line, f"<{header}> is not in FOREIGN of {module.name}")
        if not test and path.suffix == ".hpp" and not path.name.endswith("_impl.hpp"):
            if any(header.startswith(each) for each in HEAVY):
                self.fault(path, line, f"<{header}> is heavy: include it in a .cpp or an _impl.hpp")

    def check_inside(self, path, line, header, modules, module):
        owner, _, name = header.rpartition("/")
        owner = owner.removesuffix("/tests")
        if owner not in self.modules:
            self.fault(path, line, f'"{header}": write the path from src/, as "module/file.hpp"')
        elif owner not in modules:
            self.fault(path, line, f'"{header}": {module.name} does not name {owner} in DEPENDS')
        elif name.endswith("_impl.hpp") and owner != module.name:
            self.fault(path, line, f'"{header}" is for {owner} alone')

    def check_makes(self, module, path, source, test):
        inside = path.relative_to(self.src).as_posix()
        if test or module.name.startswith("protocols/") or inside.startswith(tuple(MAKES_ALLOWED)):
            return
        for match in MAKES.finditer(blank(source, texts=False)):
            self.fault(path, line_of(source, match.start()), f'"{match.group(0)}" belongs under protocols/')


def main(arguments):
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    check = Check(Path(arguments[1]).resolve())
    faults = check.run()
    for fault in faults:
        print(fault)
    if not faults:
        print(f"{len(check.modules)} modules keep to their layers")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
