"""What was printed into a pipe that nobody reads to its end, as `| head` does: quiet, and no failure."""

import os
import subprocess
import unittest

from gantry_cli import BINARY

EPC = b"3074257BF7194E4000001A85\n"


class NobodyReads(unittest.TestCase):
    def run_into_a_closed_pipe(self, *arguments, give=b""):
        reading, writing = os.pipe()
        os.close(reading)
        try:
            return subprocess.run([BINARY, *arguments], input=give, stdout=writing, stderr=subprocess.PIPE, timeout=120, check=False)
        finally:
            os.close(writing)

    def test_every_command_that_prints_ends_quietly(self):
        for arguments, give in ((["--help"], b""), (["--version"], b""), (["config", "schema"], b""), (["config", "example"], b""),
                                (["completion", "bash"], b""), (["epc", "decode", "-"], EPC * 10_000),
                                (["epc", "encode", "-"], b"urn:epc:tag:sgtin-96:3.0614141.812345.6789\n" * 10_000),
                                (["decode", "-p", "silion", "-d", "to-host"], b"00\n" * 10_000),
                                (["decode", "-p", "silion", "-d", "to-host", "--raw"], bytes(1 << 20)),
                                (["encode", "-p", "silion", "-d", "to-host"], b'{"error":"x","bytes":"00"}\n' * 10_000)):
            done = self.run_into_a_closed_pipe(*arguments, give=give)
            self.assertEqual((0, b""), (done.returncode, done.stderr), arguments)

    def test_a_stream_without_end_ends_with_its_reader(self):
        for command in ("epc decode -", "decode -p silion -d to-host"):
            line = f"yes 3074257BF7194E4000001A85 | {BINARY} {command} | head -n 3 > /dev/null; echo ${{PIPESTATUS[1]}}"
            done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=120, check=False)
            self.assertEqual(("0\n", ""), (done.stdout, done.stderr), command)


if __name__ == "__main__":
    unittest.main()
