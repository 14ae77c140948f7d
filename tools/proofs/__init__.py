"""The proofs behind tools/prove: docs/reliability.md says what they prove and what came out."""

import sys
from pathlib import Path

# What the end-to-end tests have, the proofs use too.
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "e2e"))
