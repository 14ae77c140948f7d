#!/usr/bin/env python3
"""Finds what must not be in a repository that others clone: paths and hosts of one machine, work left undone, white
space that only shows in a diff. Usage: check_words.py FILE...; prints one line a fault, exits 1 if there is one."""

import re
import sys
from pathlib import Path

# Hosts that a text may name: documents of standards and projects, and names that are reserved for examples.
HOSTS = re.compile(
    r"(?:\w+|\[?[0-9a-f:.]+\]?|[\w.-]*\b(?:example(?:\.\w+)?|test|invalid)"
    r"|(?:[\w-]+\.)*(?:gs1\.org|apache\.org|sqlite\.org|ietf\.org|rfc-editor\.org|json-schema\.org|w3\.org"
    r"|debian\.org|llvm\.org|gnu\.org|boost\.org|cmake\.org|keepachangelog\.com|semver\.org|prometheus\.io))\Z",
    re.IGNORECASE,
)
URL = re.compile(r"https?://((?:\[[0-9a-fA-F:.]+\]|[\w.-]*\w))")
RULES = [
    (re.compile(r"(?<![\w.~-])/(?:root|work)/\w"), "a path of one machine"),
    (re.compile(r"\.\./shared\b"), "a path outside the repository"),
    (re.compile(r"\b(?:TO" r"DO|FIX" r"ME|X" r"XX)\b"), "work left undone: do it, or open an issue"),
    (re.compile(r"^(?:<{7}|>{7}) ", re.MULTILINE), "a merge that was not finished"),
    (re.compile(r"[ \t]+$", re.MULTILINE), "blanks at the end of a line"),
]
BLANKS_ALLOWED = (".tsv", ".csv", ".svg")


def check(name, text):
    for pattern, fault in RULES:
        if name.endswith(BLANKS_ALLOWED) and fault.startswith("blanks"):
            continue
        for match in pattern.finditer(text):
            yield text.count("\n", 0, match.start()) + 1, fault
    for match in URL.finditer(text):
        host = match.group(1).rsplit("@", 1)[-1]
        if not HOSTS.match(host) and name != "LICENSE":
            yield text.count("\n", 0, match.start()) + 1, f"the host {host}: is it one that everybody can reach?"
    if text and not text.endswith("\n"):
        yield text.count("\n") + 1, "no line end at the end of the file"


def main(arguments):
    bad = False
    for name in arguments[1:]:
        data = Path(name).read_bytes()
        if b"\0" in data or Path(name).suffix in (".png", ".ico", ".woff2") or "/seeds/" in name:
            continue
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            print(f"{name}:1: this is no UTF-8")
            bad = True
            continue
        for line, fault in check(name, text):
            print(f"{name}:{line}: {fault}")
            bad = True
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
