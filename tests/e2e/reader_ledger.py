"""Readers that number every read, and the books of what they sent and what was acknowledged: compared with the store,
nothing may be missing, doubled, invented, mixed up or out of order."""

import collections
import random
import time
from typing import NamedTuple

from silion import SilionReader

MARK = "30F1"  # what a numbered tag begins with


def numbered_tag(reader, number):
    return f"{MARK}{reader:08X}{number:012X}"


class Balance(NamedTuple):
    sent: int
    acknowledged: int
    stored: int
    lost: int       # acknowledged, and not in the store
    doubled: int    # in the store more than once
    invented: int   # in the store, and never sent
    mixed: int      # under another reader's name
    disordered: int # before one that was sent before it
    marked: int     # possible_repeat: a crash left open what they are

    def is_clean(self):
        return (self.lost, self.doubled, self.invented, self.mixed, self.disordered) == (0, 0, 0, 0, 0)


class NumberedReader(SilionReader):
    """One name; each frame carries reads that no other has."""

    def __init__(self, books, index, port, name=None, **more):
        self.books, self.index, self.sent, self.known = books, index, 0, 0
        super().__init__(port, name or f"gate-{index}", **more)
        books.readers.append(self)

    def next_frame(self, tags=5):
        """The bytes of a frame with new reads; they count as sent."""
        numbers = range(self.sent + 1, self.sent + tags + 1)
        self.sent += tags
        return self.tag_frame(*[numbered_tag(self.index, number) for number in numbers])

    def acknowledged(self):
        """All that was sent up to now."""
        self.known = self.sent

    def exchange(self, tags=5):
        frame = self.send(self.next_frame(tags))
        self.wait_for_ack()
        self.acknowledged()
        return frame


    def insist(self, frames, tags=5):
        """As readers do: what is not acknowledged is sent again on the next connection."""
        for _ in range(frames):
            frame = self.next_frame(tags)
            while True:
                try:
                    self.send(frame)
                    self.wait_for_ack()
                    break
                except OSError:
                    time.sleep(random.uniform(0, 0.3))  # else two under one name may never let each other finish
                    self.connect()
            self.acknowledged()


class Books:
    def __init__(self):
        self.readers = []

    def balance(self, store):
        """Against the view `events` of a store (gantry_e2e.Store)."""
        names = {reader.index: reader.name for reader in self.readers}
        sent, known = collections.Counter(), collections.Counter()
        for reader in self.readers:
            sent[reader.index] = max(sent[reader.index], reader.sent)
            known[reader.index] = max(known[reader.index], reader.known)
        seen, last = collections.Counter(), collections.Counter()
        invented = mixed = disordered = marked = 0
        for row in store.rows("SELECT tag, reader, reads, possible_repeat FROM events WHERE type = 'tag.read' ORDER BY seq"):
            index, number = int(row["tag"][4:12], 16), int(row["tag"][12:], 16)
            if not row["tag"].startswith(MARK) or len(row["tag"]) != 24 or not 1 <= number <= sent[index] or row["reads"] != 1:
                invented += 1
                continue
            if row.get("possible_repeat"):
                marked += 1
                continue
            mixed += row["reader"] != names[index]
            disordered += number < last[index]
            last[index] = max(last[index], number)
            seen[index, number] += 1
        lost = sum(seen[index, number] == 0 for index in known for number in range(1, known[index] + 1))
        return Balance(sent=sum(sent.values()), acknowledged=sum(known.values()), stored=sum(seen.values()), lost=lost,
                       doubled=sum(count - 1 for count in seen.values()), invented=invented, mixed=mixed,
                       disordered=disordered, marked=marked)
