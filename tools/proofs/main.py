"""The command line of tools/prove."""

import argparse
import importlib
import pkgutil
import random
import signal
import sys
from pathlib import Path

from . import rows
from .processes import ROOT, Died, NotHere, Trouble
from .report import Proof


NOT_HERE = 77


def all_rows():
    """By the names of the files in rows/: whoever adds a row adds a file."""
    names = sorted(each.name for each in pkgutil.iter_modules(rows.__path__))
    return {name.upper(): importlib.import_module(f"{rows.__name__}.{name}") for name in names}


def parser(known):
    lines = "\n".join(f"  {name:<4} {module.TITLE}" for name, module in known.items())
    out = argparse.ArgumentParser(prog="tools/prove", formatter_class=argparse.RawDescriptionHelpFormatter,
                                  description="Runs a proof of what docs/reliability.md promises, and prints its figures.",
                                  epilog=f"rows:\n{lines}\n\nexit code: 0 it holds, 1 it does not, 2 it could not be run, "
                                         "77 this machine cannot do what it needs")
    verbs = out.add_subparsers(dest="row", metavar="ROW")
    for name, module in known.items():
        verb = verbs.add_parser(name, aliases=[name.lower()], description=f"{module.TITLE}. Passes if: {module.PASS}")
        verb.add_argument("--quick", action="store_true", help="the size for CI")
        verb.add_argument("--bite", action="store_true",
                          help="with a gateway that misbehaves on purpose; passes only if losses are found")
        verb.add_argument("--build", default=str(ROOT / "build/dev"), metavar="DIR",
                          help="build with failpoints (default build/dev); GANTRY_BINARY names another gantry")
        verb.add_argument("--json", metavar="FILE", help="the figures, also as a file")
        verb.add_argument("--keep", action="store_true", help="leave the directory of the run, with logs")
        verb.add_argument("--seed", type=int, default=None, help="of what is random")
        if hasattr(module, "options"):
            module.options(verb)
    return out


def main(arguments):
    known = all_rows()
    parse = parser(known)
    if not arguments:
        parse.print_help()
        return 0
    options = parse.parse_args(arguments)
    row = options.row.upper()
    module = known[row]
    seed = options.seed if options.seed is not None else random.randrange(1 << 32)
    random.seed(seed)
    command = f"tools/prove {row} {' '.join(arguments[1:])}".strip()
    proof = Proof(row, module.TITLE, options, command if options.seed is not None else f"{command} --seed {seed}")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # whoever is told to end takes his servers with him
    proof.begin()
    try:
        module.run(proof)
    except NotHere as reason:
        print(f"{row}: not proved here: {reason}", file=sys.stderr)
        return NOT_HERE
    except Died as end:
        print(f"{row}: FAILED: {end}", file=sys.stderr)
        return 1
    except Trouble as trouble:
        print(f"{row}: it could not be run to its end: {trouble}", file=sys.stderr)
        return 2
    code = proof.end()
    if options.json:
        Path(options.json).write_text(proof.json(), encoding="utf-8")
    return code
