"""Readers that number every read and keep the books: Silion frames, one outstanding each, acknowledged or not sent
again. Made of sockets and bytes, none of the product's own code; quick enough to load a gateway from one thread."""

import json
import selectors
import socket
import sqlite3
import struct
import threading
import time
from dataclasses import dataclass, field

TAGS, ACKNOWLEDGE = 1, 1  # command, flag
PREFIX = bytes.fromhex("3074257BF719")  # an SGTIN-96 by its header
RECORD = struct.pack(">BBbBB", 1, 1, -50, 5, 12) + PREFIX  # antenna, reads, strength, protocol, length of the EPC
AHEAD = 20  # so many readers get their next frame ready between two looks at the sockets


class NumberedReader:
    """Each read is another tag; with `tags`, of so many in turn, and user memory has the number."""

    def __init__(self, number, records, name, tags=None):
        self.number, self.records, self.name, self.tags = number, records, name.encode(), tags
        self.generated = self.outstanding = self.acknowledged = 0
        self.frame, self.ahead, self.left, self.heard, self.socket = b"", b"", b"", b"", None
        self.sent_at, self.away = 0.0, False
        self._head = RECORD + number.to_bytes(2, "big")

    def prepare(self):
        """The frame after this one."""
        first, self.generated = self.generated + 1, self.generated + self.records
        head, numbers = self._head, range(first, self.generated + 1)
        if self.tags:
            records = [head + (each % self.tags).to_bytes(4, "big") + b"\x04" + each.to_bytes(4, "big") for each in numbers]
        else:
            records = [head + each.to_bytes(4, "big") + b"\0" for each in numbers]
        data = struct.pack(">H", self.records) + b"".join(records)
        self.ahead = struct.pack(">BBHBBI", 0xFF, len(self.name), len(data), TAGS, ACKNOWLEDGE, 0) + self.name + data

    def next_frame(self):
        if not self.ahead:
            self.prepare()
        self.frame, self.ahead, self.outstanding = self.ahead, b"", self.generated

    def hear(self, data):
        """True when the outstanding frame is acknowledged."""
        self.heard += data
        acknowledged = False
        while len(self.heard) >= 6:
            size, code = struct.unpack(">HB", self.heard[2:5])
            if len(self.heard) < 6 + size:
                break
            acknowledged |= code == TAGS
            self.heard = self.heard[6 + size:]
        return acknowledged


@dataclass
class Books:
    """What is in the store, against what the readers know."""

    acknowledged: int = 0
    stored: int = 0
    lost: int = 0      # acknowledged and not there
    doubled: int = 0
    made_up: int = 0   # there, and never generated
    disordered: int = 0
    examples: list = field(default_factory=list)

    def clean(self):
        return self.lost == self.doubled == self.made_up == self.disordered == 0

    def text(self):
        return (f"{self.acknowledged} acknowledged, {self.stored} stored, {self.lost} lost, {self.doubled} doubled, "
                f"{self.made_up} made up, {self.disordered} out of order")


class NumberedReaders:
    """A fleet, fed by a thread of its own from connect() to close()."""

    def __init__(self, count, records, pattern="gate-{}", frames_per_second=None, tags=None):
        """Each sends its next frame as soon as the one before is acknowledged, or not more than so often."""
        self.readers = [NumberedReader(i, records, pattern.format(i), tags) for i in range(1, count + 1)]
        self.longest_wait = 0.0
        self.pace(frames_per_second)
        self._selector, self._thread, self._stop, self._new_frames = None, None, False, True

    def pace(self, frames_per_second):
        self._every = 1 / frames_per_second if frames_per_second else 0.0

    def acknowledged(self):
        return sum(reader.acknowledged for reader in self.readers)

    def connect(self, port):
        """Everybody dials (again), and sends what is outstanding."""
        self.disconnect()
        self._selector, self._stop, self._new_frames = selectors.DefaultSelector(), False, True
        for reader in self.readers:
            reader.socket = socket.create_connection(("127.0.0.1", port), 20)
            reader.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            reader.socket.setblocking(False)
            reader.heard, reader.left, reader.away = b"", reader.frame, False
            self._selector.register(reader.socket, selectors.EVENT_READ | selectors.EVENT_WRITE, reader)
        self._thread = threading.Thread(target=self._feed, daemon=True)
        self._thread.start()
        return self

    def disconnect(self):
        if self._thread:
            self._stop = True
            self._thread.join()
            self._thread = None
        for reader in self.readers:
            if reader.socket:
                reader.socket.close()
                reader.socket = None
        if self._selector:
            self._selector.close()
            self._selector = None

    close = disconnect

    def drain(self, seconds=60):
        """Nothing new; True when all that was sent is acknowledged."""
        self._new_frames = False
        return self.wait(lambda: all(not reader.frame for reader in self.readers), seconds)

    @staticmethod
    def wait(condition, seconds):
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            time.sleep(0.005)
        return True

    def wait_for_more(self, count, seconds=60):
        """Until so many more reads are acknowledged."""
        wanted = self.acknowledged() + count
        return self.wait(lambda: self.acknowledged() >= wanted, seconds)

    def _feed(self):
        while not self._stop:
            for key, ready in self._selector.select(0.05 if not self._every else 0.005):
                self._turn(key.data, ready)
            if self._new_frames and not self._every:
                self._prepare()
            if self._every:
                for reader in self.readers:
                    self._turn(reader, 0)

    def _prepare(self):
        """While the gateway works or waits for its disk."""
        prepared = 0
        for reader in self.readers:
            if not reader.ahead:
                reader.prepare()
                prepared += 1
                if prepared == AHEAD:
                    return

    def _turn(self, reader, ready):
        if reader.away:
            return
        try:
            self._exchange(reader, ready)
        except OSError:  # the gateway is gone: whoever ended it connects again
            reader.away = True
            self._selector.unregister(reader.socket)

    def _exchange(self, reader, ready):
        if ready & selectors.EVENT_READ:
            data = reader.socket.recv(65536)
            if not data:
                raise ConnectionError("the gateway closed the connection")
            if reader.hear(data) and reader.frame:
                reader.acknowledged, reader.frame = reader.outstanding, b""
                self.longest_wait = max(self.longest_wait, time.monotonic() - reader.sent_at)
        due = not self._every or time.monotonic() >= reader.sent_at + self._every
        if not reader.frame and self._new_frames and due:
            reader.next_frame()
            reader.left, reader.sent_at = reader.frame, time.monotonic()
        if reader.left:
            try:
                reader.left = reader.left[reader.socket.send(reader.left):]
            except BlockingIOError:
                pass
        wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if reader.left else 0)
        if self._selector.get_key(reader.socket).events != wanted:
            self._selector.modify(reader.socket, wanted, reader)

    # The books.

    def claims(self):
        """What may be asked for now: by reader, what is acknowledged and what was generated."""
        return {reader.number: (reader.acknowledged, reader.generated) for reader in self.readers}

    def check(self, tags, claims=None):
        """`tags`: all that were read, in the order in which they are stored, as identity() gives them."""
        claims = claims or self.claims()
        books = Books(acknowledged=sum(acknowledged for acknowledged, _ in claims.values()))
        seen = {number: bytearray(generated + 1) for number, (_, generated) in claims.items()}
        last = dict.fromkeys(claims, 0)
        prefix = PREFIX.hex().upper()
        for tag in tags:
            if not tag.startswith(prefix):
                continue
            reader, number = int(tag[12:16], 16), int(tag[16:], 16)
            books.stored += 1
            if reader not in seen or number >= len(seen[reader]):
                books.made_up += 1
                self._example(books, "made up", tag)
            elif seen[reader][number]:
                books.doubled += 1
                self._example(books, "doubled", tag)
            else:
                seen[reader][number] = 1
                books.disordered += number < last[reader]
                last[reader] = number
        for number, (acknowledged, _) in claims.items():
            books.lost += acknowledged - sum(seen[number][1:acknowledged + 1])
        return books

    @staticmethod
    def _example(books, what, tag):
        if len(books.examples) < 5:
            books.examples.append(f"{what}: {tag}")


def identity(tag, data):
    """Of a read: its tag, or with user memory the reader's part of the tag and the number from there."""
    return tag if not data else tag[:16] + (json.loads(data) if isinstance(data, str) else data)["user"]


def stored_tags(db):
    """Through the view, as any SQLite tool would."""
    store = sqlite3.connect(f"file:{db}?mode=ro", uri=True, timeout=20)
    try:
        for tag, data in store.execute("SELECT tag, data FROM events WHERE type = 'tag.read' ORDER BY seq"):
            yield identity(tag, data)
    finally:
        store.close()
