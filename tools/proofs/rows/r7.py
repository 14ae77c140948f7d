"""R7: six defects of another buffer."""

from ..test_programs import judge_tests

TITLE = "the six defects that Vector's makers found in its disk buffer, a test each"
PASS = "none of them is ours"


def run(proof):
    judge_tests(proof, "gantry_gateway_test", ["VectorDefects.*"])
    judge_tests(proof, "gantry_journal_test", ["Retention.*Dropp*", "Retention.NothingGoesPastTheSlowestCursor"])
