"""What is done with the whole store, beside a gateway that is busy and between two of its lives."""

import contextlib
import json
import os
import signal
import sqlite3
import threading
import unittest
from pathlib import Path

from gantry_e2e import EVERY_READ, READER, EndToEnd, wait_for
from silion import SilionReader, Tag, new_epc

ONE_READ_AN_EVENT = READER + EVERY_READ


class Load:
    """A reader that uploads as fast as it is acknowledged, until it is told to stop. Every tag is a new one."""

    def __init__(self, gateway, tags=20, fixed=None):
        self.reader = SilionReader(gateway.port)
        self.acknowledged, self._tags, self._fixed = [], tags, fixed
        self._stop, self.error = threading.Event(), None
        self._thread = threading.Thread(target=self._upload)
        self._thread.start()

    def _upload(self):
        try:
            while not self._stop.is_set():
                tags = self._fixed or [new_epc() for _ in range(self._tags)]
                # No two frames in a row are equal.
                strength = -30 - len(self.acknowledged) % 50
                self.reader.upload(*(Tag(tag, rssi=strength) for tag in tags))
                self.acknowledged.extend(tags)
        except Exception as error:  # pylint: disable=broad-except
            self.error = error

    def wait_for_more(self, tags=200):
        goal = len(self.acknowledged) + tags
        wait_for(lambda: len(self.acknowledged) >= goal or self.error, "more uploads")

    def stop(self):
        self._stop.set()
        self._thread.join()
        self.reader.close()
        if self.error:
            raise self.error
        return self.acknowledged


class StoreToolsTest(EndToEnd):
    def load(self, gateway, **more):
        load = Load(gateway, **more)
        self.addCleanup(load.reader.close)
        self.addCleanup(load._stop.set)  # pylint: disable=protected-access
        load.wait_for_more()
        return load

    def upload(self, gateway, count):
        """So many tags, each a read and what presence makes of it."""
        reader = SilionReader(gateway.port)
        tags = [new_epc() for _ in range(count)]
        reader.upload(*tags)
        reader.close()
        return tags

    def store_tool(self, gateway, *arguments):
        return json.loads(self.assert_done(gateway.cli("store", *arguments, "--json")).out)

    def ids(self, gateway):
        return [row["id"] for row in gateway.query()]


class UnderLoad(StoreToolsTest):
    def test_backups_checks_and_exports_see_a_whole_store(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        load = self.load(gateway)
        backup, exported = gateway.home / "backup.db", gateway.home / "events.csv"
        for _ in range(3):
            safe = list(load.acknowledged)
            made = self.store_tool(gateway, "backup", "--force", backup)
            in_backup = gateway.query("--type", "tag.read", "--db", backup)
            self.assertLessEqual(set(safe), {row["tag"] for row in in_backup}, "acknowledged, but not in the backup")
            self.assertEqual(made["last_seq"], made["events"])
            self.assertEqual(0o600, backup.stat().st_mode & 0o777)
            self.assertTrue(self.store_tool(gateway, "check")["sound"])
            self.assert_done(gateway.cli("events", "export", "--format", "csv", "-o", exported))
            self.assertGreater(len(exported.read_text().splitlines()), made["events"])
            load.wait_for_more()
        acknowledged = load.stop()
        stored = [row["tag"] for row in gateway.query("--type", "tag.read")]
        self.assertEqual(acknowledged, stored)
        self.assertNotIn("held", " ".join(gateway.messages()))

    def test_an_export_is_gone_on_with_behind_its_last_number(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        load = self.load(gateway)
        exported, after = [], 0
        for _ in range(3):
            part = self.assert_done(gateway.cli("events", "export", "--after", after)).json_lines()
            exported += part
            after = part[-1]["seq"]
            load.wait_for_more()
        load.stop()
        exported += self.assert_done(gateway.cli("events", "export", "--after", after)).json_lines()
        self.assertEqual(list(range(1, len(exported) + 1)), [row["seq"] for row in exported])

    def test_compacting_gives_room_back_and_nobody_waits_for_it(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        tags = [new_epc() for _ in range(200)]
        load = self.load(gateway, fixed=tags)
        wait_for(lambda: gateway.status()["store_bytes"] > 1_700_000, "almost two megabytes of events", 60)
        load.stop()
        gateway.stop()
        gateway.toml += '[store]\nkeep = "1s"\n'
        gateway.start()
        wait_for(lambda: len(gateway.query("--limit", 100)) < 10, "old events are deleted", 60)
        load = self.load(gateway, fixed=tags)
        compacted = self.store_tool(gateway, "compact")
        self.assertLess(compacted["bytes_after"], compacted["bytes_before"])
        load.wait_for_more()
        load.stop()
        wait_for(lambda: self.store_tool(gateway, "compact") and gateway.db.stat().st_size < 1_500_000, "a small file")
        self.assertTrue(self.store_tool(gateway, "check")["sound"])
        self.assertIn("bytes_after", gateway.ask("GET", "/api/v1/store").json()["compaction"])
        gateway.stop()
        self.assertTrue(self.store_tool(gateway, "check")["sound"])
        # Without a gateway the command does it itself.
        self.assertLessEqual(self.store_tool(gateway, "compact")["bytes_after"], 1_500_000)

    def test_a_gateway_that_is_stopped_does_not_wait_for_a_compaction(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        self.upload(gateway, 100)
        self.assertEqual(202, gateway.ask("POST", "/api/v1/store/compact").status)
        self.assertEqual(405, gateway.ask("GET", "/api/v1/store/compact").status)
        gateway.stop()
        self.assertTrue(self.store_tool(gateway, "check")["sound"])


class Restored(StoreToolsTest):
    def test_no_id_comes_twice(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        backup = gateway.home / "backup.db"
        first = self.upload(gateway, 20)
        self.store_tool(gateway, "backup", backup)
        kept = self.ids(gateway)
        lost = self.upload(gateway, 30)
        ever = self.ids(gateway)
        self.assert_refused(gateway.cli("store", "restore", backup), "another gateway is running in", "stop it first")
        for epoch, end in enumerate((gateway.stop, gateway.kill), 1):
            end()
            restored = self.store_tool(gateway, "restore", backup)
            self.assertEqual(epoch, restored["epoch"])
            self.assertTrue(restored["numbers_go_on"])
            gateway.start()
            self.assertEqual(kept, self.ids(gateway)[:len(kept)], "what was in the backup keeps its ids")
            self.assertNotIn(lost[0], {row.get("tag") for row in gateway.query()})
            more = self.upload(gateway, 10)
            new = self.ids(gateway)[len(kept):]
            self.assertEqual(restored["next_id"], new[0])
            self.assertTrue(all(each.startswith(f"e2e:{epoch}:") for each in new), new)
            self.assertEqual(set(), set(new) & set(ever))
            in_view = lambda: [row["id"] for row in gateway.store().rows("SELECT id FROM events ORDER BY seq")]
            wait_for(lambda: in_view() == self.ids(gateway), "the view has the same ids")
            gateway.store().close()
            gateway._stores.clear()  # pylint: disable=protected-access
            ever += new
            numbers = [int(each.rsplit(":", 1)[1]) for each in ever]
            self.assertEqual(len(set(numbers)), len(numbers), "nor does a number")
            self.assertEqual(set(first + more), {row["tag"] for row in gateway.query("--type", "tag.read")})
        self.assertTrue(self.store_tool(gateway, "check")["sound"])
        gateway.stop()
        aside = gateway.data / "set-aside-1" / "gantry.db"
        self.assertLessEqual(set(lost), {row.get("tag") for row in gateway.query("--db", aside)}, "it is not deleted")

    def test_in_a_new_place_the_epoch_is_one_that_nobody_can_have_used(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        self.upload(gateway, 5)
        backup = gateway.home / "backup.db"
        self.store_tool(gateway, "backup", backup)
        gateway.stop()
        gateway.data = gateway.home / "elsewhere"
        restored = self.store_tool(gateway, "restore", backup)
        self.assertGreater(restored["epoch"], 1_700_000_000)
        gateway.start()
        self.upload(gateway, 5)
        self.assertTrue(self.ids(gateway)[-1].startswith(f"e2e:{restored['epoch']}:"))


class Damaged(StoreToolsTest):
    def setUp(self):
        self.running = self.gateway(ONE_READ_AN_EVENT)
        self.upload(self.running, 100)
        self.ever = self.ids(self.running)
        self.running.stop()

    def test_it_is_set_aside_with_an_alarm_and_the_gateway_goes_on(self):
        gateway = self.running
        damaged = gateway.db.read_bytes()[:20_000]
        gateway.db.write_bytes(damaged)
        check = gateway.cli("store", "check")
        self.assertEqual(1, check.code)
        self.assertIn("gantry store restore FILE", check.err)
        gateway.start()
        gateway.wait_for_message(r"gantry\.db: .*; it is set aside in .*set-aside-\d+ and a new store begins")
        asides = gateway.status()["stores_set_aside"]
        self.assertEqual(1, len(asides))
        self.assertEqual(damaged, (Path(asides[0]) / "gantry.db").read_bytes())
        self.upload(gateway, 10)
        self.assertEqual(set(), set(self.ids(gateway)) & set(self.ever))
        epoch = asides[0].rsplit("-", 1)[1]
        self.assertTrue(all(each.startswith(f"e2e:{epoch}:") for each in self.ids(gateway)))
        gateway.restart()
        self.assertEqual(asides, gateway.status()["stores_set_aside"], "until somebody takes it away")

    def test_what_can_be_read_can_be_saved(self):
        gateway = self.running
        with contextlib.closing(sqlite3.connect(gateway.db)) as db:
            seq = db.execute("SELECT seq FROM event_rows WHERE tag IS NOT NULL ORDER BY seq LIMIT 1 OFFSET 20").fetchone()[0]
            db.execute("UPDATE event_rows SET reads = reads + 1 WHERE seq = ?", (seq,))
            db.commit()
        check = gateway.cli("store", "check")
        self.assertEqual(1, check.code)
        self.assertIn(f"event {seq} is not as it was stored", check.out)
        out = gateway.home / "saved.jsonl"
        self.assertEqual(1, gateway.cli("events", "export", "-o", out).code)
        self.assertFalse(out.exists())
        saved = gateway.cli("events", "export", "--skip-damaged", "-o", out)
        self.assertEqual(1, saved.code, saved.err)
        self.assertIn("all else was exported", saved.err)
        numbers = [json.loads(line)["seq"] for line in out.read_text().splitlines()]
        last = self.store_of(gateway, "SELECT next_seq - 1 FROM state")
        self.assertEqual([each for each in range(1, last + 1) if each != seq], numbers)

    def store_of(self, gateway, sql):
        with contextlib.closing(sqlite3.connect(gateway.db)) as db:
            return db.execute(sql).fetchone()[0]


class Versions(StoreToolsTest):
    def test_there_and_back_with_a_backlog(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        self.upload(gateway, 100)
        gateway.stop()
        before = gateway.query()
        self.assert_refused(gateway.cli("store", "downgrade", "--to", "9999"), "cannot go back to version 9999")
        gone = self.store_tool(gateway, "downgrade", "--to", "1", "--yes")
        self.assertEqual(1, gone["to"])
        self.assert_refused(gateway.cli("events", "query"), "has version 1", "start the gateway once")
        gateway.start()
        rows = gateway.query()
        self.assertEqual(before, rows[:len(before)])
        self.assertTrue(self.store_tool(gateway, "check")["sound"])

    @unittest.skipUnless(os.environ.get("GANTRY_FAILPOINTS"), "needs a build with failpoints")
    def test_killed_in_the_middle_of_an_upgrade_nothing_is_lost(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        self.upload(gateway, 100)
        gateway.stop()
        before = gateway.query()
        self.store_tool(gateway, "downgrade", "--to", "1", "--yes")
        for failpoint in ("migration_step", "migration_commit"):
            gateway.env = {"GANTRY_FAILPOINT": failpoint}
            self.assertEqual(-signal.SIGKILL, gateway.launch().wait())
            self.assert_refused(gateway.cli("events", "query"), "has version 1")
        gateway.env = None
        gateway.start()
        self.assertEqual(before, gateway.query()[:len(before)])
        self.assertTrue(self.store_tool(gateway, "check")["sound"])

    def test_a_newer_store_is_left_alone_and_the_way_back_is_told(self):
        gateway = self.gateway(ONE_READ_AN_EVENT)
        gateway.stop()
        with contextlib.closing(sqlite3.connect(gateway.db)) as db:
            version = db.execute("PRAGMA user_version").fetchone()[0]
            db.execute("PRAGMA user_version = 9999")
        process = gateway.launch()
        self.assertEqual(1, process.wait())
        self.assertIn("has version 9999", process.err.text())
        self.assertIn(f"`gantry store downgrade --to {version}`", process.err.text())


if __name__ == "__main__":
    unittest.main()
