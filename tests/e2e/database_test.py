"""Events into a real PostgreSQL: every one once, whoever dies, and the tags that are there now."""

import unittest
from pathlib import Path

import servers
from gantry_e2e import BINARY, EVERY_READ, READER, wait_for
from outage import NoDoubles, OutageTest
from silion import SilionReader, new_epc


class Database(OutageTest):
    def setUp(self):
        place = Path(BINARY).resolve().parent.parent / "postgres-template"
        self.server = servers.Postgres(self.directory(), template=place)
        self.addCleanup(self.server.kill)
        self.server.start()

    def section(self, more=""):
        return self.sink_section("postgres", self.server.url, more)

    def delivered(self):
        """What the table holds. A table has no order but that of its columns; where a row lies says nothing."""
        return [each[0] for each in self.server.rows("SELECT id FROM gantry.events ORDER BY seq")]

    def there(self):
        return self.server.rows("SELECT to_regclass('gantry.events')")[0][0] != ""


class Delivery(Database):
    def test_every_event_is_a_row_with_what_the_store_has(self):
        gateway = self.gateway(READER + EVERY_READ + self.section())
        self.feed(gateway, 10)
        gateway.wait_for_events(50, "tag.read")
        wait_for(lambda: self.there() and self.delivered() == self.stored_ids(gateway), "the table has all")
        columns = ("id", "seq", "type", "reader", "antenna", "zone", "technology", "tag", "epc", "reads")
        rows = self.server.rows(f"SELECT {', '.join(columns)} FROM gantry.events ORDER BY seq")
        stored = [[str(row.get(column, "")) for column in columns] for row in gateway.events()]
        self.assertEqual(stored, rows)

    def test_the_view_shows_the_tags_that_are_there_now(self):
        gateway = self.gateway(READER + '[presence]\nlose_after = "300ms"\n' + self.section("present_tags = true\n"))
        staying, going = new_epc(), new_epc()
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        reader.tags(staying, going)
        reader.wait_for_ack()

        def present():
            reader.tags(staying)
            reader.wait_for_ack()
            return self.there() and self.server.rows("SELECT tag, pc IS NULL AND xpc IS NULL FROM gantry.present_tags")

        wait_for(lambda: present() == [[staying, "t"]] and gateway.events("tag.lost", tag=going), "one has gone")


class Deaths(NoDoubles, Database):
    pass


if __name__ == "__main__":
    unittest.main()
