"""What a network and a clock can do to readers, with books: every acknowledged read is in the store, once, under its own
reader and in order. The figures of long runs are in docs/reliability.md."""

import concurrent.futures
import time
import unittest

from gantry_e2e import EVERY_READ, READER, EndToEnd
from reader_ledger import Books, NumberedReader
from silion import ACK, CRC

SIGNS = ("skipped_bytes", "bad_checksum", "bad_length", "malformed", "resyncs", "unknown_code")
STALL = 0.5


class WithBooks(EndToEnd):
    def setUp(self):
        self.books = Books()

    def readers(self, gateway, count, **more):
        made = [NumberedReader(self.books, index, gateway.port, **more) for index in range(1, count + 1)]
        for each in made:
            self.addCleanup(each.close)
        return made

    def at_once(self, work, readers):
        """Each on a thread of its own; the first failure is the test's."""
        with concurrent.futures.ThreadPoolExecutor(max_workers=len(readers)) as pool:
            list(pool.map(work, readers))

    def assert_clean(self, gateway):
        balance = self.books.balance(gateway.store())
        self.assertTrue(balance.is_clean(), balance)
        self.assertEqual((balance.sent, 0), (balance.stored, balance.marked), balance)
        return balance

    def counted(self, gateway, *counters):
        """The sum over all readers."""
        infos = [gateway.ask("GET", f"/api/v1/readers/{name}").json() for name in {each.name for each in self.books.readers}]
        return sum(info["counters"][each] for info in infos for each in counters)


class Segments(WithBooks):
    """A frame is the same frame however the network cuts it."""

    def offsets(self, gateway):
        """A reader for every place in which its frames can be cut."""
        first = NumberedReader(Books(), 1, gateway.port, name="gate-000", flags=ACK | CRC)
        size = len(first.next_frame())
        first.close()
        made = []
        for offset in range(1, size):
            made.append(NumberedReader(self.books, offset, gateway.port, name=f"gate-{offset:03}", flags=ACK | CRC))
            self.addCleanup(made[-1].close)
        return made

    def test_a_stall_at_every_place_of_a_frame(self):
        gateway = self.gateway(READER + EVERY_READ)

        def stalled(reader):
            frame = reader.next_frame()
            reader.send(frame[:reader.index])
            time.sleep(STALL)  # the fault itself
            reader.send(frame[reader.index:])
            reader.wait_for_ack()
            reader.acknowledged()

        readers = self.offsets(gateway)
        for _ in range(2):
            self.at_once(stalled, readers)
        self.assertEqual(0, self.counted(gateway, *SIGNS))
        self.assertEqual(10 * len(readers), self.assert_clean(gateway).stored)

    def test_a_reset_at_every_place_of_a_frame(self):
        gateway = self.gateway(READER + EVERY_READ)

        def reset(reader):
            reader.exchange()
            frame = reader.next_frame()
            reader.send(frame[:reader.index])
            reader.reset()
            reader.connect().send(frame)
            reader.wait_for_ack()
            reader.acknowledged()

        readers = self.offsets(gateway)
        self.at_once(reset, readers)
        self.assertEqual(10 * len(readers), self.assert_clean(gateway).stored)

    def test_one_byte_a_segment_and_fifty_frames_in_one(self):
        gateway = self.gateway(READER + EVERY_READ)
        dripping, gathered = self.readers(gateway, 2, flags=ACK | CRC)
        for _ in range(10):
            for byte in dripping.next_frame():
                dripping.send(bytes([byte]))
            dripping.wait_for_ack()
            dripping.acknowledged()
        for _ in range(4):
            gathered.send(b"".join(gathered.next_frame() for _ in range(50)))
            for _ in range(50):
                gathered.wait_for_ack()
            gathered.acknowledged()
        self.assertEqual(0, self.counted(gateway, *SIGNS))
        self.assertEqual(50 + 1000, self.assert_clean(gateway).stored)


class LostAcknowledgements(WithBooks):
    READERS, LOSSES = 50, 20

    def test_a_thousand_that_never_arrive(self):
        """The reader sends the same again, after its wait or on a new connection: acknowledged again, not counted twice."""
        gateway = self.gateway(READER + 'ack_wait = "1s"\n' + EVERY_READ)

        def lose(reader):
            for turn in range(self.LOSSES):
                frame = reader.exchange()  # this acknowledgement is the one that gets lost
                if turn % 10 == 0:
                    time.sleep(1.1)  # the reader's own patience
                else:
                    reader.reset()
                    reader.connect()
                reader.send(frame)
                reader.wait_for_ack()
                if turn % 2 == 0:
                    reader.heartbeat()  # it goes on without, or with a sign that it got this one

        readers = self.readers(gateway, self.READERS)
        self.at_once(lose, readers)
        self.assertEqual(self.READERS * self.LOSSES * 5, self.assert_clean(gateway).stored)


class OneName(WithBooks):
    """Two devices under one name, which is one reader: the newest connection wins, and nothing is mixed or lost."""

    def test_two_that_take_the_place_from_each_other(self):
        gateway = self.gateway(READER + EVERY_READ)
        first = NumberedReader(self.books, 1, gateway.port, name="gate-1")
        second = NumberedReader(self.books, 2, gateway.port, name="gate-1")
        other = NumberedReader(self.books, 3, gateway.port, name="gate-2")
        for each in (first, second, other):
            self.addCleanup(each.close)

        self.at_once(lambda reader: reader.insist(20), [first, second, other])
        balance = self.books.balance(gateway.store())
        self.assertEqual((0, 0, 0), (balance.lost, balance.invented, balance.mixed), balance)
        self.assertEqual(balance.sent, balance.acknowledged)
        taken = [row["reason"] for row in gateway.events("reader.disconnected", reader="gate-1")]
        self.assertIn("a newer connection took its place", taken)
        self.assertEqual([], gateway.events("reader.disconnected", reader="gate-2"), "nobody else is touched")
        names = [each["name"] for each in gateway.ask("GET", "/api/v1/readers").json()["readers"]]
        self.assertEqual(["gate-1", "gate-2"], sorted(names))


if __name__ == "__main__":
    unittest.main()
