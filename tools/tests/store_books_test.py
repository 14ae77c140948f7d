"""The books of the store's proofs find every kind of loss, and nothing where there is none."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from proofs.numbered_readers import PREFIX, NumberedReader, NumberedReaders, identity  # noqa: E402


def tag(reader, number):
    return f"{PREFIX.hex().upper()}{reader:04X}{number:08X}"


class StoreBooks(unittest.TestCase):
    def setUp(self):
        self.readers = NumberedReaders(2, 5)
        for reader in self.readers.readers:
            reader.next_frame()
            reader.acknowledged = 5
            reader.next_frame()  # outstanding
        self.stored = [tag(reader, number) for number in range(1, 6) for reader in (1, 2)]

    def books(self, stored):
        return self.readers.check(stored)

    def test_all_that_was_acknowledged_is_enough(self):
        books = self.books(self.stored)
        self.assertTrue(books.clean(), books.text())
        self.assertEqual((10, 10), (books.acknowledged, books.stored))

    def test_what_is_outstanding_may_be_there_or_not(self):
        self.assertTrue(self.books([*self.stored, tag(1, 6), tag(1, 7)]).clean())

    def test_other_tags_are_none_of_its_business(self):
        self.assertTrue(self.books([*self.stored, "E2801160600002054CC0"]).clean())

    def test_a_lost_read_is_found(self):
        for each in self.stored:
            self.assertEqual(1, self.books([other for other in self.stored if other != each]).lost)

    def test_a_doubled_read_is_found(self):
        self.assertEqual(1, self.books([*self.stored, self.stored[3]]).doubled)

    def test_a_read_that_was_not_is_found(self):
        for each in (tag(1, 11), tag(3, 1)):
            self.assertEqual(1, self.books([*self.stored, each]).made_up)

    def test_reads_out_of_order_are_found(self):
        first, second = self.stored.index(tag(1, 2)), self.stored.index(tag(1, 3))
        self.stored[first], self.stored[second] = self.stored[second], self.stored[first]
        self.assertEqual(1, self.books(self.stored).disordered)

    def test_the_number_is_in_the_user_memory_where_tags_are_few(self):
        reader = NumberedReader(3, 2, "gate-3", tags=2)
        reader.next_frame()
        self.assertIn(bytes.fromhex("0003" "00000000" "04" "00000002"), reader.frame)
        self.assertEqual(tag(3, 2), identity(tag(3, 0), '{"user":"00000002"}'))
        self.assertEqual(tag(3, 2), identity(tag(3, 2), None))

    def test_a_frame_that_is_ready_is_not_outstanding(self):
        reader = NumberedReader(1, 5, "gate-1")
        reader.next_frame()
        reader.prepare()
        self.assertEqual((5, 10), (reader.outstanding, reader.generated))
        reader.next_frame()
        self.assertEqual((10, 10), (reader.outstanding, reader.generated))

    def test_an_acknowledgement_is_heard_in_pieces(self):
        reader, answer = self.readers.readers[0], bytes.fromhex("ee0000000100")
        self.assertFalse(reader.hear(answer[:4]))
        self.assertTrue(reader.hear(answer[4:] + answer[:2]))
        self.assertEqual(answer[:2], reader.heard)


if __name__ == "__main__":
    unittest.main()
