#!/usr/bin/env python3
"""Runs clang-tidy on the C++ files that have a compile command, but the fuzz targets; on tests if they are named.

A file that passed is not looked at again until it, a header of ours that it includes, its compile command,
.clang-tidy or clang-tidy itself changes; what passed is kept in BUILD/tidy/. Reading and walking headers is most of
the work, so files with one command are read in batches; those of a batch with faults again one by one.

Usage: tidy.py BUILD [FILE...]; prints what clang-tidy says and exits 1 if it says anything."""

import concurrent.futures
import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import unity

TIDY = "clang-tidy-14"
BATCH_BYTES = 120000
ROOT = Path(__file__).resolve().parent.parent
INCLUDE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"', re.MULTILINE)


def closure(path, known):
    """A file and the files of ours that it includes, however far."""
    found, todo = {}, [path]
    while todo:
        each = todo.pop()
        if each in found:
            continue
        if each not in known:
            data = each.read_bytes()
            beside = (each.parent, ROOT / "src", ROOT)
            names = [m.group(1).decode() for m in INCLUDE.finditer(data)]
            known[each] = (data, [next((d / n for d in beside if (d / n).is_file()), None) for n in names])
        found[each] = known[each][0]
        todo += filter(None, known[each][1])
    return found


def key_of(path, command, common, known):
    digest = hashlib.sha256(common + command.encode())
    for each, data in sorted(closure(path, known).items()):
        digest.update(str(each.relative_to(ROOT)).encode() + b"\0" + hashlib.sha256(data).digest())
    return digest.hexdigest()


def wanted(path, only):
    """Tests only when they are named: the headers of their framework are half of what a run would cost."""
    folders = [ROOT / each for each in ("src", "tests", "bench")]
    ours = any(path.is_relative_to(each) for each in folders) and not path.name.endswith("_fuzz.cpp")
    return ours and (path in only if only else "tests" not in path.relative_to(ROOT).parts)


def flags_of(entry):
    """The compile command without the compiler, the file and what it is made into."""
    words = shlex.split(entry["command"])
    first = next(at for at, word in enumerate(words) if word.startswith("-"))
    flags, words = [], iter(words[first:])
    for word in words:
        if word in ("-o", "-c"):
            next(words)
        else:
            flags.append(word)
    return flags


def tidy(build, paths, flags):
    """What clang-tidy says of files read as one; nothing if it has no complaint."""
    source = paths[0]
    if len(paths) > 1:
        lines = "".join(f'#include "{path}"\n' for path in paths)
        source = build / "tidy" / f"batch_{hashlib.sha256(lines.encode()).hexdigest()[:16]}.cpp"
        source.write_text(lines, encoding="utf-8")
    command = [TIDY, "--quiet", f"--config-file={ROOT / '.clang-tidy'}", str(source), "--", *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=build)
    return "" if done.returncode == 0 else done.stdout or done.stderr


def main(arguments):
    if len(arguments) < 2:
        print(__doc__, file=sys.stderr)
        return 2
    build = Path(arguments[1]).resolve()
    only = {Path(each).resolve() for each in arguments[2:]}
    version = subprocess.run([TIDY, "--version"], capture_output=True, check=True).stdout
    common = version + (ROOT / ".clang-tidy").read_bytes()
    passed = build / "tidy"
    passed.mkdir(exist_ok=True)

    known, marks, alike, files = {}, {}, {}, 0
    for entry in json.loads((build / "compile_commands.json").read_text(encoding="utf-8")):
        path = Path(entry["file"])
        if not wanted(path, only):
            continue
        files += 1
        flags = flags_of(entry)
        marks[path] = passed / key_of(path, shlex.join(flags), common, known)
        if not marks[path].exists():
            alike.setdefault((path.parent, *flags), []).append(path)
    todo = [(list(map(Path, batch)), list(key[1:])) for key, paths in alike.items()
            for batch in unity.batches(paths, BATCH_BYTES)]
    todo.sort(key=lambda each: sum(path.stat().st_size for path in each[0]), reverse=True)

    def run(item):
        paths, flags = item
        if not tidy(build, paths, flags):
            said = {}
        else:
            said = {path: tidy(build, [path], flags) for path in paths}
        for path in paths:
            if not said.get(path):
                marks[path].touch()
        return said

    bad = 0
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for said in pool.map(run, todo):
            for path, text in said.items():
                if text:
                    bad += 1
                    print(f"{path.relative_to(ROOT)}:\n{text.replace(str(ROOT) + '/', '')}", flush=True)
    stale = sum(len(paths) for paths, _ in todo)
    print(f"clang-tidy: {files} files, {files - stale} unchanged since they passed, {bad} with faults")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
