#!/usr/bin/env python3
"""Writes what a fuzz target starts from.

Beside the target's source (src/<module>/tests/<target>.cpp): the frames of vectors.tsv, those of the target's own
direction when its name says one (..._to_host_..., ..._to_reader_...), bare and behind the eight bytes that stream targets
take as the seed of their cuts; for a target of the configuration every sample.toml; and the files of seeds/<target>/, where
inputs lie that once found a fault.

Usage: fuzz_seeds.py SRC TARGET CORPUS"""

import sys
from pathlib import Path

CUT_SEED = 8


def frames(path, direction):
    """The bytes of each vector of a direction; of all when there is none."""
    for line in path.read_text(encoding="utf-8").splitlines():
        columns = line.split("\t")
        if line.startswith(("#", "id\t")) or len(columns) < 4:
            continue
        if direction in (None, columns[1]):
            yield columns[0], bytes.fromhex(columns[2])


def seeds(src, target):
    """Names and bytes of all seeds of a target."""
    source = next(iter(sorted(src.rglob(f"tests/{target}.cpp"))), None)
    if source is None:
        raise SystemExit(f"there is no {src}/<module>/tests/{target}.cpp")
    found = {}
    vectors = source.parent / "vectors.tsv"
    if vectors.exists():
        direction = next((each for each in ("to-host", "to-reader") if each.replace("-", "_") in target), None)
        found = dict(frames(vectors, direction))
        found["all"] = b"".join(found.values())
        found |= {f"{name}-cut": bytes(CUT_SEED) + data for name, data in found.items()}
    if "config" in target:
        found |= {f"sample-{path.parent.name}": path.read_bytes() for path in sorted(src.rglob("sample.toml"))}
    kept = source.parent / "seeds" / target
    for path in sorted(kept.iterdir()) if kept.is_dir() else []:
        found[path.name] = path.read_bytes()
    return found


def main(arguments):
    if len(arguments) != 4:
        print(__doc__, file=sys.stderr)
        return 2
    corpus = Path(arguments[3])
    corpus.mkdir(parents=True, exist_ok=True)
    for name, data in seeds(Path(arguments[1]), arguments[2]).items():
        (corpus / f"seed-{name}").write_bytes(data)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
