#!/usr/bin/env python3
"""What a compiler would say of a Python file: it parses, every import is used, no `except:` takes everything, no
line is longer than 140. Usage: check_python.py FILE...; prints one line a fault and exits 1 if there is one."""

import ast
import sys
from pathlib import Path

LONGEST = 140


def check(text):
    """Line and fault, for each fault of a source."""
    try:
        tree = ast.parse(text)
    except SyntaxError as error:
        yield error.lineno or 1, f"does not parse: {error.msg}"
        return
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST:
            yield number, f"{len(line)} columns, {LONGEST} are allowed"
        if "\t" in line:
            yield number, "a tab"
    used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    exported = {
        each.value
        for node in tree.body
        if isinstance(node, ast.Assign) and any(getattr(target, "id", "") == "__all__" for target in node.targets)
        for each in ast.walk(node.value)
        if isinstance(each, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)) and getattr(node, "module", "") != "__future__":
            for alias in node.names:
                name = (alias.asname or alias.name).split(".")[0]
                if name not in used | exported:
                    yield node.lineno, f"{name} is imported and never used"
        if isinstance(node, ast.ExceptHandler) and node.type is None:
            yield node.lineno, "`except:` takes everything, Ctrl-C too: name the exception"


def main(arguments):
    bad = False
    for name in arguments[1:]:
        for line, fault in check(Path(name).read_text(encoding="utf-8")):
            print(f"{name}:{line}: {fault}")
            bad = True
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
