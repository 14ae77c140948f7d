"""Bounds of the disk while a destination is away: the store fills, readers that wait for acknowledgement wait, what others
send is counted when it finds no more room; and when the destination is back all of it goes on by itself."""

import itertools
import threading
import time
import unittest

import sink_test
import store_test
from gantry_e2e import READER, wait_for
from silion import SilionReader, Tag, new_epc

SMALL = 'max_size = "1MiB"\non_full = "hold_readers"\n'
STAY = '[presence]\nlose_after = "1h"\n'
TAGS = [new_epc() for _ in range(300)]  # few, so that presence leaves room for events


def numbered_frames():
    """No two reads of all these frames are alike."""
    for antenna, strength in itertools.product(range(1, 9), range(-100, 0)):
        yield [Tag(tag, antenna, 1, strength) for tag in TAGS]


def reads_in(events, reader):
    return [(event["tag"], event["antenna"], event["rssi_dbm"]) for event in events
            if event["type"] == "tag.read" and event["reader"] == reader]


class Books(sink_test.Receiver):
    """Keeps all that it was given, each event once."""

    def __init__(self):
        self.events = {}
        super().__init__()

    def take(self, events):
        status = super().take(events)
        if status == 200:
            self.events.update((event["id"], event) for event in events)
        return status

    def all(self):
        return list(self.events.values())

    def in_order(self):
        return sorted(self.all(), key=lambda event: event["seq"])


class WaitingReader:
    """Sends its frames one after the other, each when the one before is acknowledged."""

    def __init__(self, gateway):
        self.reader, self.frames = SilionReader(gateway.port), numbered_frames()
        self.acknowledged, self.outstanding = [], None

    def upload(self, timeout):
        if self.outstanding is None:
            self.outstanding = next(self.frames)
            self.reader.tags(*self.outstanding)
        try:
            self.reader.wait_for_ack(timeout)
        except TimeoutError:
            return False
        self.acknowledged += [(tag.epc, f"Ant{tag.antenna}", float(tag.rssi)) for tag in self.outstanding]
        self.outstanding = None
        return True

    def come_back(self, gateway):
        self.reader.port = gateway.port
        self.reader.connect()
        if self.outstanding:
            self.reader.tags(*self.outstanding)


class SinkAway(sink_test.SinkTest):
    def books(self):
        books = Books()
        self.addCleanup(books.close)
        return books

    def site(self, books, more=""):
        return self.gateway(store_test.with_store(SMALL) + STAY + self.webhook(books, 'start = "oldest"\nretry_max = "200ms"') + more)

    def waiting_reader(self, gateway):
        waiting = WaitingReader(gateway)
        self.addCleanup(waiting.reader.close)
        return waiting

    def fill(self, gateway, waiting):
        def held():
            while waiting.upload(timeout=0.5):
                pass
            return "store_trouble" in gateway.status()
        wait_for(held, "the store takes no more", 90)

    def test_readers_that_wait_go_on_by_themselves_when_it_is_back(self):
        books = self.books()
        books.status = 503
        gateway = self.site(books)
        waiting = self.waiting_reader(gateway)
        for _ in range(2):
            self.fill(gateway, waiting)
            self.assertFalse(waiting.upload(timeout=1), "nothing is acknowledged while the store is full")
            self.assertRegex(gateway.reader_info("gate-1")["state"], "^connected, held: .*full")
            books.status = 200
            self.assertTrue(waiting.upload(timeout=60), "it goes on by itself")
            wait_for(lambda: "store_trouble" not in gateway.status(), "all is well again", 60)
            books.status = 503
        books.status = 200
        wait_for(lambda: set(waiting.acknowledged) <= set(reads_in(books.all(), "gate-1")), "all are delivered", 60)
        self.assertEqual(waiting.acknowledged, reads_in(books.in_order(), "gate-1"), "once, and in order")
        self.assertNotIn("overflow", {event["type"] for event in books.all()}, "nothing was lost")

    def test_of_readers_that_do_not_wait_every_lost_read_is_counted(self):
        books = self.books()
        books.status = 503
        gateway = self.site(books)
        plain = SilionReader(gateway.port, "gate-2", flags=0)
        self.addCleanup(plain.close)
        plain.tags(TAGS[0])
        gateway.wait_for_events(1, "tag.read", reader="gate-2")
        waiting = self.waiting_reader(gateway)
        self.fill(gateway, waiting)
        sent, told = 1, threading.Event()
        watch = threading.Thread(target=lambda: (gateway.wait_for_message("keeps nothing itself", 90), told.set()))
        watch.start()
        plain.socket.settimeout(90)
        for number in itertools.count():
            if told.is_set() or not watch.is_alive():
                break
            plain.tags(Tag(TAGS[number % 300], 1 + number % 8, 1, -100 + number % 99))
            sent += 1
            time.sleep(0.001)  # each a report of its own, and not more than are delivered in a while
        watch.join()
        self.assertTrue(told.is_set(), gateway.log())
        self.assertFalse(waiting.upload(timeout=0.5), "who waits is not counted, he waits")
        books.status = 200
        self.assertTrue(waiting.upload(timeout=60))

        def balance():
            events = books.all()
            lost = [event for event in events if event["type"] == "overflow"]
            return sum(event["count"] for event in lost) + len(reads_in(events, "gate-2")) == sent and lost
        lost = wait_for(balance, lambda: f"{sent} sent; {len(reads_in(books.all(), 'gate-2'))} stored", 100)
        for event in lost:
            self.assertEqual(("gateway", "gate-2"), (event["scope"], event["reader"]))
            self.assertGreater(event["count"], 0)
            self.assertLess(event["since"], event["time"])
        wait_for(lambda: set(waiting.acknowledged) <= set(reads_in(books.all(), "gate-1")), "all are delivered", 60)

    def test_one_that_is_taken_out_of_the_configuration_holds_nothing_any_more(self):
        books = self.books()
        books.status = 503
        gateway = self.site(books)
        waiting = self.waiting_reader(gateway)
        self.fill(gateway, waiting)
        gateway.stop()
        directory = self.directory()
        gateway.toml = store_test.with_store(SMALL, READER) + STAY + self.archive(directory, 'start = "oldest"')
        gateway.start()
        gateway.wait_for_message('"hook" is no longer configured: events that it has not had are kept no longer')
        waiting.come_back(gateway)
        for _ in range(20):
            self.assertTrue(waiting.upload(timeout=60), "the other sink has what there was")
        wait_for(lambda: set(waiting.acknowledged) <= set(reads_in(self.lines(directory), "gate-1")), "all are in the file", 60)


if __name__ == "__main__":
    unittest.main()
