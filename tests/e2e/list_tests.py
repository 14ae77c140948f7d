"""Prints `program Class.method` for every test here, for CMake."""

import importlib
import sys
import unittest
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))


def methods(suite):
    for each in suite:
        if isinstance(each, unittest.TestSuite):
            yield from methods(each)
        else:
            yield each.id().split(".", 1)[1]


for file in sorted(HERE.glob("*_test.py")):
    for method in methods(unittest.defaultTestLoader.loadTestsFromModule(importlib.import_module(file.stem))):
        print(file.stem, method)
