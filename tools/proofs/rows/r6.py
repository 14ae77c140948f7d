"""R6: the store is damaged."""

from ..test_programs import judge_tests

TITLE = "a damaged store: bytes flipped anywhere, cut off at every 512 bytes"
PASS = "it opens with all or the beginning, or is set aside with an alarm; never a crash, never a read that was not"


def options(parser):
    parser.add_argument("--files", type=int, help="of each kind of damage (default 2000, quick 60)")


def run(proof):
    given = proof.options
    files = given.files or (60 if given.quick else 2000)
    proof.figure("damaged files of each kind", files)
    judge_tests(proof, "gantry_journal_test", ["Damage.*"], {"GANTRY_DAMAGED_FILES": files})
