"""Bounds of the store: first no acknowledgement, and the reader keeps its data; only
where the user chose so the oldest is dropped, and then counted and told."""

import subprocess
import threading
import unittest

from gantry_e2e import EVERY_READ, READER, EndToEnd, wait_for
from silion import SilionReader, Tag, new_epc

MIB = 1 << 20


def with_store(text, toml=READER):
    return toml + EVERY_READ + "[store]\n" + text


class Feeder:
    """A reader that uploads tags nobody has seen, and keeps the books: what was acknowledged, what is outstanding."""

    TAGS = 100  # a frame

    def __init__(self, gateway):
        self.reader = SilionReader(gateway.port)
        self.acknowledged, self.outstanding, self.frame = [], [], None

    def reconnect(self, gateway):
        self.reader.port = gateway.port
        self.reader.connect()
        if self.frame:
            self.reader.send(self.frame)

    def upload(self, timeout=20):
        """False: no acknowledgement came in time; the frame stays outstanding."""
        if self.frame is None:
            self.outstanding = [new_epc() for _ in range(self.TAGS)]
            self.frame = self.reader.tags(*self.outstanding)
        try:
            self.reader.wait_for_ack(timeout)
        except TimeoutError:
            return False
        self.acknowledged += self.outstanding
        self.outstanding, self.frame = [], None
        return True


class StoreTest(EndToEnd):
    def feeder(self, gateway):
        feeder = Feeder(gateway)
        self.addCleanup(feeder.reader.close)
        return feeder

    def feed_until_held(self, gateway, feeder):
        """Until no acknowledgement comes and the gateway says why."""
        def held():
            while feeder.upload(timeout=0.5):
                pass
            return gateway.status().get("store_trouble")
        return wait_for(held, "the store takes no more", 60)

    def assert_books_balance(self, gateway, feeder):
        stored = [row["tag"] for row in gateway.query("--type", "tag.read")]
        self.assertEqual(len(set(stored)), len(stored), "doubled")
        self.assertLessEqual(set(feeder.acknowledged), set(stored), "lost")
        self.assertLessEqual(set(stored), set(feeder.acknowledged + feeder.outstanding), "made up")


class Held(StoreTest):
    def test_a_full_store_holds_the_readers_and_loses_nothing(self):
        gateway = self.gateway(with_store('max_size = "1MiB"\non_full = "hold_readers"\n'))
        feeder = self.feeder(gateway)
        trouble = self.feed_until_held(gateway, feeder)
        self.assertRegex(trouble, "max_size|full")
        gateway.wait_for_message("readers are held until it works again")
        self.assert_books_balance(gateway, feeder)
        self.assertGreater(len(feeder.acknowledged), 1000)
        self.assertLessEqual(gateway.db.stat().st_size, MIB * 1.1)
        # With more room it goes on where it was: the outstanding frame comes again.
        gateway.stop()
        gateway.toml = gateway.toml.replace("1MiB", "64MiB")
        gateway.start()
        feeder.reconnect(gateway)
        self.assertTrue(feeder.upload())
        self.assertTrue(feeder.upload())
        self.assert_books_balance(gateway, feeder)

    def test_the_list_of_readers_says_that_they_are_held(self):
        gateway = self.gateway(with_store('max_size = "1MiB"\n'))
        feeder = self.feeder(gateway)
        self.feed_until_held(gateway, feeder)
        self.assertRegex(gateway.reader_info("gate-1")["state"], "^connected, held: .*full")
        self.assertIn("connected, held: ", gateway.cli("reader", "list").out)

    def test_it_can_be_killed_while_it_is_full(self):
        gateway = self.gateway(with_store('max_size = "1MiB"\n'))
        feeder = self.feeder(gateway)
        self.feed_until_held(gateway, feeder)
        gateway.kill()
        gateway.toml = gateway.toml.replace("1MiB", "64MiB")
        gateway.start()
        feeder.reconnect(gateway)
        self.assertTrue(feeder.upload())
        self.assert_books_balance(gateway, feeder)

    def test_held_readers_cost_no_memory(self):
        gateway = self.gateway(with_store('max_size = "1MiB"\n'))
        self.feed_until_held(gateway, self.feeder(gateway))
        # These ask for no acknowledgement, so nothing but the socket can stop them.
        before, stop = gateway.process.memory_mib(), threading.Event()
        pushers = [SilionReader(gateway.port, f"gate-{i}", flags=0) for i in range(2, 6)]
        sent = [0] * len(pushers)

        def push(i):
            pushers[i].socket.settimeout(1)
            tags = [Tag(new_epc()) for _ in range(1000)]
            try:
                while not stop.is_set() and sent[i] < 64 * MIB:
                    sent[i] += len(pushers[i].tags(*tags))
            except TimeoutError:
                pass  # the socket is full: that is the back-pressure
        threads = [threading.Thread(target=push, args=(i,)) for i in range(len(pushers))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
        stop.set()
        self.assertLess(max(sent), 64 * MIB)
        if not gateway.process.is_sanitized():
            self.assertLess(gateway.process.memory_mib() - before, 64)
        for pusher in pushers:
            pusher.close()


class Dropped(StoreTest):
    def test_drop_oldest_goes_on_and_tells_what_it_dropped(self):
        gateway = self.gateway(with_store('max_size = "1MiB"\non_full = "drop_oldest"\n'))
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        tags, acknowledged = sorted(new_epc() for _ in range(500)), []  # who is present is never dropped, so a few

        def upload(frames):
            for _ in range(frames):
                strength = -30 - len(acknowledged) // 500 % 60  # no two frames in a row are equal
                reader.upload(*(Tag(tag, rssi=strength) for tag in tags))
                acknowledged.extend((tag, strength) for tag in tags)

        def dropping():
            upload(10)
            return gateway.query("--type", "overflow")
        wait_for(dropping, "an overflow event", 60)
        upload(20)

        def balance():
            rows = gateway.query()
            dropped = sum(row["count"] for row in rows if row["type"] == "overflow")
            return rows[-1]["seq"] == len(rows) + dropped and (rows, dropped)
        rows, dropped = wait_for(balance, "what is stored and what was dropped make all there was")
        self.assertGreater(dropped, 0)
        overflow = next(row for row in rows if row["type"] == "overflow")
        self.assertEqual("store", overflow["scope"])
        self.assertLess(overflow["since"], overflow["time"])
        gateway.wait_for_message(r"the store is full: \d+ events dropped")
        self.assertNotIn("held", " ".join(gateway.messages()), "room is made at once, so no reader waits for it")
        self.assertLessEqual(gateway.db.stat().st_size, MIB * 1.1)
        # What is left is the newest.
        stored = [(row["tag"], row["rssi_dbm"]) for row in rows if row["type"] == "tag.read"]
        self.assertEqual(acknowledged[-len(stored):], stored)
        # Whatever was dropped when it died is told by the next process, and the first events that told are carried over.
        for _ in range(3):
            upload(20)
            gateway.kill_and_restart()
            reader.port = gateway.port
            reader.connect()
            upload(10)
            rows, dropped_by_now = wait_for(balance, "the balance after a crash")
            self.assertGreater(dropped_by_now, dropped)
            dropped = dropped_by_now

    def test_a_store_that_present_tags_fill_says_so(self):
        gateway = self.gateway(with_store('max_size = "1MiB"\non_full = "drop_oldest"\n') + '[presence]\nlose_after = "1h"\n')
        feeder = self.feeder(gateway)
        said = lambda: "tags present now fill it" in (gateway.status().get("store_trouble") or "")
        wait_for(lambda: not feeder.upload(timeout=0.5) and said(), "the reason why it is full", 60)
        gateway.wait_for_message("store.max_size is too small for them; raise store.max_size")
        gateway.stop()
        gateway.toml = gateway.toml.replace("1MiB", "64MiB")
        gateway.start()
        feeder.reconnect(gateway)
        self.assertTrue(feeder.upload())
        self.assertEqual(set(feeder.acknowledged), {row["tag"] for row in gateway.present()})

    def test_events_go_when_they_are_too_old(self):
        gateway = self.gateway(with_store('keep = "1s"\n') + '[presence]\nlose_after = "1h"\n')
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        tag = new_epc()
        reader.upload(tag)
        last = gateway.status()["last_seq"]
        wait_for(lambda: gateway.events() == [], "all events are deleted")
        self.assertEqual([tag], [row["tag"] for row in gateway.present()], "who is there is no event")
        gateway.kill_and_restart()
        reader.port = gateway.port
        reader.connect().upload(new_epc())
        self.assertGreater(gateway.wait_for_events(1)[0]["seq"], last, "numbers never come again")


class FullDisk(StoreTest):
    def setUp(self):
        self.disk = self.directory()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", self.disk], capture_output=True, check=False)
        if mounted.returncode != 0:
            self.skipTest("a file system cannot be mounted here")
        self.addCleanup(subprocess.run, ["umount", "-l", self.disk], check=False)

    def test_when_there_is_space_again_it_goes_on_by_itself(self):
        gateway = self.gateway(with_store("", READER), start=False)
        gateway.data = self.disk / "data"
        gateway.start()
        feeder = self.feeder(gateway)
        ballast = self.disk / "ballast"
        for round_trip in range(3):
            self.assertTrue(feeder.upload())
            with ballast.open("wb", buffering=0) as file:
                try:
                    while file.write(b"\0" * 4096):
                        pass
                except OSError:
                    pass
            trouble = self.feed_until_held(gateway, feeder)
            self.assertRegex(trouble, "full|space")
            self.assert_books_balance(gateway, feeder)
            ballast.unlink()
            self.assertTrue(feeder.upload(timeout=10), f"round {round_trip}")
            wait_for(lambda: "store_trouble" not in gateway.status(), "all is well again")
            self.assert_books_balance(gateway, feeder)
        gateway.kill_and_restart()
        feeder.reconnect(gateway)
        self.assertTrue(feeder.upload())
        self.assert_books_balance(gateway, feeder)
        gateway.stop()


if __name__ == "__main__":
    unittest.main()
