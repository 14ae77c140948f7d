#!/usr/bin/env python3
"""Sorts the .cpp files of one target into batches that can be compiled as one file each.

Two files share a batch only where no name that one declares for itself (in an unnamed namespace, static, or a type or
constant of its own) is a word of the other, so nobody has to think of batches when naming things. Both may give one
thing the same short name. A file that defines macros stays alone. The same files give the same batches.

Usage: unity.py MOST-BYTES FILE...; prints a line a batch, its files separated by tabs."""

import re
import sys
from pathlib import Path

from cpp_text import blank

DIRECTIVE = re.compile(r"^[ \t]*#[ \t]*(\w+)(?:[^\n\\]|\\.)*", re.MULTILINE | re.DOTALL)
WORD = re.compile(r"(?<![\w.:>])[A-Za-z_]\w*")
NAMESPACE = re.compile(r"(?:inline )?namespace\b([\w: ]*)$")
TYPE = re.compile(r"(?:struct|class|union|enum(?: class| struct)?) (?:alignas\(\) )?(\w+)(?! *::)")
ALIAS = re.compile(r"(?:using|namespace)\b")
FREE = re.compile(r"(?:static|constexpr|inline|consteval)\b")
PAIRS = {"(": ")", "{": "}"}


def skip(code, at):
    """The place behind the bracket that closes the one at `at`."""
    opening, depth = code[at], 0
    for place in range(at, len(code)):
        if code[place] == opening:
            depth += 1
        elif code[place] == PAIRS[opening]:
            depth -= 1
            if depth == 0:
                return place + 1
    return len(code)


def statements(code):
    """What stands at the level of namespaces, brackets emptied, and whether the namespace is unnamed."""
    at, said, scopes = 0, "", []
    while at < len(code):
        char = code[at]
        if char == "{":
            space = NAMESPACE.match(" ".join(said.split()))
            if space:
                scopes.append(not space.group(1).strip())
                said, at = "", at + 1
                continue
        if char in PAIRS:
            said += char + PAIRS[char]
            at = skip(code, at)
            if char == "{" and code[at : at + 64].lstrip()[:1] not in set(";,=({.)"):
                yield said, any(scopes)
                said = ""
            continue
        at += 1
        if char == "}":
            scopes = scopes[:-1]
            said = ""
        elif char == ";":
            yield said, any(scopes)
            said = ""
        else:
            said += char


def alias(said):
    """The name that a statement gives to something declared elsewhere, with the statement."""
    said = " ".join(said.split())
    if not ALIAS.match(said) or said.startswith("using namespace"):
        return {}
    return {re.findall(r"\w+", said.split("=")[0])[-1]: said}


def declared(said, unnamed):
    """The names that a statement declares for its file alone."""
    said = re.sub(r"\[\[[^\]]*\]\]", "", said)
    shorter = None
    while shorter != said:
        shorter, said = said, re.sub(r"<[^<>;]*>", "", said)
    said = re.sub(r"^(?:template|extern) ?", "", " ".join(said.split()))
    kind = TYPE.match(said)
    if kind and ("{" in said or unnamed):
        return {kind.group(1)}
    if kind or not said or ALIAS.match(said):
        return set()
    head = said.split("(")[0]
    if "(" in said and "=" not in head and "{" not in head:
        name = re.search(r"(?<![\w:])(\w+) ?$", head)
        own = name and not name.group(1).isupper() and (unnamed or FREE.match(said))
        return {name.group(1)} if own else set()
    pieces = (re.split(r"[={\[(]", piece)[0] for piece in said.split(","))
    return {name for piece in pieces for name in re.findall(r"(?<![\w:])\w+(?= ?$)", piece)}


class File:
    def __init__(self, path):
        source = Path(path).read_text(encoding="utf-8")
        code = blank(source)
        self.path, self.size = path, len(source)
        self.alone = any(m.group(1) in ("define", "undef") for m in DIRECTIVE.finditer(code))
        code = DIRECTIVE.sub("", code)
        self.names, self.aliases = set(), {}
        for said, unnamed in statements(code):
            self.names |= declared(said, unnamed)
            self.aliases |= alias(said)
        self.words = set(WORD.findall(code)) | self.names

    def suits(self, other):
        if not self.names.isdisjoint(other.words) or not other.names.isdisjoint(self.words):
            return False
        return self.tolerates(other) and other.tolerates(self)

    def tolerates(self, other):
        """Whether no short name of this file means something else in the other one."""
        for name, said in self.aliases.items():
            theirs = other.aliases.get(name)
            if theirs != said if theirs else "=" in said and name in other.words:
                return False
        return True


def batches(paths, most):
    found = []
    for file in sorted(map(File, paths), key=lambda each: each.path):
        for batch in found:
            small = sum(each.size for each in batch) + file.size <= most
            if small and not file.alone and not batch[0].alone and all(file.suits(each) for each in batch):
                batch.append(file)
                break
        else:
            found.append([file])
    return [[each.path for each in batch] for batch in found]


def main(arguments):
    if len(arguments) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    for batch in batches(arguments[2:], int(arguments[1])):
        print(*batch, sep="\t")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
