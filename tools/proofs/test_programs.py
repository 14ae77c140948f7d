"""Proofs that are tests of a module, run in another size."""

import os
import re
import subprocess

from .processes import Trouble, built


def judge_tests(proof, program, patterns, env=None):
    if proof.options.bite:
        raise Trouble("it has no build that misbehaves on purpose: the tests themselves say what must not be")
    path = built(program, proof.options.build)
    done = subprocess.run([path, f"--gtest_filter={':'.join(patterns)}"], capture_output=True, text=True, check=False,
                          env={**os.environ, **{name: str(value) for name, value in (env or {}).items()}})
    passed = re.findall(r"^\[       OK \] (\S+) \((\d+) ms\)$", done.stdout, re.MULTILINE)
    failed = set(re.findall(r"^\[  FAILED  \] (\w+\.\w+)", done.stdout, re.MULTILINE))
    if not passed and not failed:
        raise Trouble(f"{path} ran no test {patterns}: {done.stdout[-500:]}{done.stderr[-500:]}")
    for name, took in passed:
        proof.figure(name, int(took), "ms")
    for name in sorted(failed):
        proof.say(f"  {name} failed")
    proof.must_be_zero(f"{program}: tests that failed, of {len(passed) + len(failed)}", len(failed))
    if done.returncode != 0 and not failed:
        proof.must_be_zero(f"{program} ended with", done.returncode)
