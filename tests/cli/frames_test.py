"""decode and encode: nothing in the input is lost in the output."""

import json
import random
import subprocess
import tempfile
import unittest
from pathlib import Path

from gantry_cli import BINARY, gantry, vectors

DIRECTIONS = ("to-reader", "to-host")
PROTOCOLS = sorted({protocol for protocol, *_ in vectors()})


class Frames(unittest.TestCase):
    def there_and_back(self, protocol, direction, data, *options):
        way = ("-p", protocol, "-d", direction, *options)
        decoded = gantry("decode", *way, give=data if options else data.hex())
        self.assertEqual(decoded.err.count("\n"), decoded.code, decoded.err)
        encoded = gantry("encode", *way, give=decoded.out)
        self.assertEqual((0, ""), (encoded.code, encoded.err))
        self.assertEqual(data, encoded.raw if options else bytes.fromhex(encoded.out))
        return decoded

    def offsets_follow_each_other(self, lines, size):
        at = 0
        for line in map(json.loads, lines):
            self.assertEqual(at, line["offset"])
            self.assertGreater(line["length"], 0)
            if "error" in line:
                self.assertEqual(2 * line["length"], len(line["bytes"]))
            at += line["length"]
        self.assertEqual(size, at)

    def test_every_vector_comes_back_whichever_way_it_is_read(self):
        for direction in DIRECTIONS:
            for protocol in PROTOCOLS:
                mine = [data for owner, _, _, data in vectors() if owner == protocol]
                self.assertTrue(mine)
                way = ("-p", protocol, "-d", direction)
                given = "".join(data.hex() + "\n" for data in mine)
                decoded = gantry("decode", *way, give=given)
                encoded = gantry("encode", *way, give=decoded.out)
                self.assertEqual(0, encoded.code, encoded.err)
                self.assertEqual(given.replace("\n", "").upper(), encoded.out.replace("\n", ""))

    def test_good_vectors_are_one_message_and_bad_ones_say_why(self):
        for protocol, name, direction, data in vectors():
            for way in DIRECTIONS if direction == "other" else (direction,):
                with self.subTest(name, way=way):
                    decoded = gantry("decode", "-p", protocol, "-d", way, give=data.hex())
                    self.offsets_follow_each_other(decoded.lines(), len(data))
                    lines = [json.loads(line) for line in decoded.lines()]
                    bad = any("error" in line for line in lines)
                    self.assertEqual(int(bad), decoded.code)
                    self.assertEqual(bad, "could not be decoded" in decoded.err)
                    for line in lines:
                        self.assertEqual((protocol, way), (line["protocol"], line["direction"]))

    def test_frames_back_to_back_are_a_message_each(self):
        for protocol in PROTOCOLS:
            for direction in DIRECTIONS:
                single = {}
                for owner, _, way, data in vectors():
                    if (owner, way) == (protocol, direction):
                        decoded = gantry("decode", "-p", protocol, "-d", direction, give=data.hex())
                        if decoded.code == 0:
                            single[data] = decoded.lines()
                self.assertGreater(len(single), 2)
                stream = b"".join(single)
                decoded = self.there_and_back(protocol, direction, stream)
                self.assertEqual(0, decoded.code)
                self.assertEqual(sum(map(len, single.values())), len(decoded.lines()))
                self.offsets_follow_each_other(decoded.lines(), len(stream))
                raw = self.there_and_back(protocol, direction, stream, "--raw")
                self.assertEqual(decoded.out, raw.out)

    def test_random_bytes_come_back(self):
        chance = random.Random(1)
        for protocol in PROTOCOLS:
            for direction in DIRECTIONS:
                for size in (1, 7, 300, 70_000):
                    data = chance.randbytes(size)
                    decoded = self.there_and_back(protocol, direction, data)
                    self.offsets_follow_each_other(decoded.lines(), size)
                    self.there_and_back(protocol, direction, data, "--raw")

    def test_damaged_vectors_come_back(self):
        chance = random.Random(2)
        for protocol in PROTOCOLS:
            for direction in DIRECTIONS:
                mine = [bytearray(data) for owner, _, _, data in vectors() if owner == protocol]
                for _ in range(10):
                    stream = bytearray()
                    for data in chance.sample(mine, len(mine)):
                        data = bytearray(data)
                        for _ in range(chance.randrange(3)):
                            data[chance.randrange(len(data))] = chance.randrange(256)
                        stream += data[: chance.randrange(1, len(data) + 1)]
                    decoded = self.there_and_back(protocol, direction, bytes(stream))
                    self.offsets_follow_each_other(decoded.lines(), len(stream))
                    self.there_and_back(protocol, direction, bytes(stream), "--raw")

    def test_a_stream_is_decoded_in_pieces_without_growing(self):
        protocol, _, direction, data = next(row for row in vectors() if row[2] == "to-host")
        stream = data * (8_000_000 // len(data))
        with tempfile.TemporaryDirectory() as directory:
            file = Path(directory) / "stream.bin"
            file.write_bytes(stream)
            limit = "ulimit -v 600000; " if not _sanitized() else ""
            command = f'{limit}"$0" decode --raw -p {protocol} -d {direction} "$1" | tail -n 1'
            done = subprocess.run(["sh", "-c", command, BINARY, file], capture_output=True, timeout=300)
        last = json.loads(done.stdout)
        self.assertEqual(len(stream), last["offset"] + last["length"])
        self.assertEqual(b"", done.stderr)

    def test_a_live_pipe_is_answered_at_once(self):
        protocol, _, direction, data = next(row for row in vectors() if row[2] == "to-host")
        for options, sent in ((["--raw"], data), ([], data.hex().encode() + b"\n")):
            command = [BINARY, "decode", *options, "-p", protocol, "-d", direction]
            with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
                for _ in range(3):
                    process.stdin.write(sent)
                    process.stdin.flush()
                    self.assertEqual(len(data), json.loads(process.stdout.readline())["length"])
                process.stdin.close()
                self.assertEqual(0, process.wait(60))

    def test_blank_lines_and_blanks_between_digits_mean_nothing(self):
        protocol, _, direction, data = next(vectors())
        spread = data.hex(" ").upper()
        decoded = gantry("decode", "-p", protocol, "-d", direction, give=f"\n  {spread}\r\n\n")
        self.assertEqual(1, len(decoded.lines()))
        self.assertEqual(0, decoded.code, decoded.err)

    def test_a_bad_line_is_named_and_ends_it(self):
        protocol, _, direction, data = next(vectors())
        decoded = gantry("decode", "-p", protocol, "-d", direction, give=f"{data.hex()}\nhello\n{data.hex()}\n")
        self.assertEqual((1, 1), (decoded.code, len(decoded.lines())))
        self.assertIn("gantry decode: line 2: column 1: 'h' is no hex digit", decoded.err)
        encoded = gantry("encode", "-p", protocol, "-d", direction, give='{"message":"Nonsense"}\n')
        self.assertEqual(1, encoded.code)
        self.assertIn("gantry encode: line 1: there is no message Nonsense", encoded.err)

    def test_input_from_a_file_is_the_same_as_from_a_pipe(self):
        protocol, _, direction, data = next(vectors())
        with tempfile.TemporaryDirectory() as directory:
            file = Path(directory) / "frames.hex"
            file.write_text(data.hex())
            decoded = gantry("decode", "-p", protocol, "-d", direction, file)
            self.assertEqual(gantry("decode", "-p", protocol, "-d", direction, give=data.hex()).out, decoded.out)
            lines = Path(directory) / "lines.jsonl"
            lines.write_text(decoded.out)
            encoded = gantry("encode", "-p", protocol, "-d", direction, lines)
            self.assertEqual(data.hex().upper(), encoded.out.strip())


class Messages(unittest.TestCase):
    """Messages that a person types; the bytes are those of the guide."""

    def encode(self, *words, way="to-reader"):
        return gantry("encode", "-p", "silion", "-d", way, *words)

    def test_a_message_without_fields(self):
        self.assertEqual("EE0000000100\n", self.encode("TagAck").out)
        self.assertEqual("EE0000001601\n", self.encode("GetGpi").out)

    def test_a_list_is_written_as_json(self):
        done = self.encode("SetGpo", 'Outputs=[{"Output":1,"State":1,"Seconds":7}]')
        self.assertEqual(("EE000004170101010107\n", 0, ""), (done.out, done.code, done.err))

    def test_members_of_the_header_are_given_like_fields(self):
        self.assertEqual("EE0000001600\n", self.encode("GetGpi", "flags=0").out)

    def test_names_that_are_nearly_right_are_suggested(self):
        for words, error in (
            (["SetGpoo"], "did you mean SetGpo?"),
            (["SetGpo", 'Output=[{"Output":1}]'], "did you mean Outputs?"),
            (["SetGpo"], "fields of SetGpo: Outputs"),
        ):
            done = self.encode(*words)
            self.assertEqual((1, "", 1), (done.code, done.out, done.err.count("\n")))
            self.assertIn(error, done.err)

    def test_what_the_protocol_does_not_allow_is_refused(self):
        done = self.encode("SetGpo", 'Outputs=[{"Output":9,"State":1,"Seconds":0}]')
        self.assertEqual((1, ""), (done.code, done.out))
        self.assertIn("9 is outside 1 to 5", done.err)


def _sanitized():
    """An instrumented binary reserves address space beyond any limit."""
    return b"__asan_init" in Path(BINARY).read_bytes() or b"__tsan_init" in Path(BINARY).read_bytes()


if __name__ == "__main__":
    unittest.main()
