"""What every sink with a server must bear, through the whole product: its server killed, the gateway killed, and a crash
at the worst place. A test class says what its server is and which ids it holds."""

import contextlib
import json
import os
import unittest

from gantry_e2e import EVERY_READ, READER, EndToEnd, wait_for
from silion import SilionReader, new_epc

KILLS = 5


def without_doubles(ids):
    return list(dict.fromkeys(ids))


class OutageTest(EndToEnd):
    """`server` (start, kill), section() and delivered() are the test class's own."""

    def sink_section(self, kind, url, more=""):
        return (f'[[sink]]\nname = "there"\ntype = "{kind}"\nurl = "{url}"\nstart = "oldest"\nbatch = 7\n'
                f'retry_min = "50ms"\nretry_max = "200ms"\n{more}\n')

    def section(self, more=""):
        raise NotImplementedError

    def delivered(self):
        """The ids that the server holds, in the order of their arrival; doubles, if it keeps them."""
        raise NotImplementedError

    def there(self):
        """There is something to ask for."""
        return True

    def held(self):
        return self.delivered() if self.there() else []

    def feed(self, gateway, frames, names=("gate-1", "gate-2"), tags=5):
        """From each reader, in turn; what is acknowledged is in the store."""
        readers = [SilionReader(gateway.port, name) for name in names]
        for _ in range(frames):
            for reader in readers:
                reader.tags(*[new_epc() for _ in range(tags)])
                reader.wait_for_ack()
        for reader in readers:
            reader.close()

    def stored_ids(self, gateway):
        return [row["id"] for row in gateway.store().rows("SELECT id FROM events ORDER BY seq")]

    def sink(self, gateway):
        return json.loads(self.assert_done(gateway.cli("sink", "show", "there", "--json")).out)

    def wait_until_all_are_there(self, gateway, doubles):
        """Each id of the store, reader by reader in order; as often as the kind of server promises."""
        def complete():
            stored = gateway.store().rows("SELECT id, reader FROM events ORDER BY seq")
            held = self.held()
            if not doubles and len(held) != len(set(held)):
                raise AssertionError(f"{len(held) - len(set(held))} doubles")
            reader_of = {row["id"]: row.get("reader") for row in stored}
            for reader in set(reader_of.values()):
                arrived = [each for each in without_doubles(held) if reader_of.get(each) == reader]
                if arrived != [row["id"] for row in stored if row.get("reader") == reader]:
                    return False
            return len(set(held)) == len(stored)
        wait_for(complete, lambda: f"{len(set(self.held()))} of {len(self.stored_ids(gateway))} are there, in order; "
                                   f"{self.sink(gateway)}", deadline=60)

    def check_server_killed_and_back(self, doubles):
        gateway = self.gateway(READER + EVERY_READ + self.section())
        self.feed(gateway, 3)
        self.wait_until_all_are_there(gateway, doubles)
        for _ in range(2):
            self.server.kill()
            self.feed(gateway, 3)
            wait_for(lambda: "trouble" in self.sink(gateway), "the gateway says that the server is away")
            self.assertGreater(self.sink(gateway)["behind"], 0)
            self.server.start()
            self.wait_until_all_are_there(gateway, doubles)
        wait_for(lambda: "trouble" not in self.sink(gateway), "the trouble is over")
        self.assertEqual(90, gateway.reads_of())

    def check_gateway_killed(self, doubles):
        gateway = self.gateway(READER + EVERY_READ + self.section())
        for _ in range(KILLS):
            self.feed(gateway, 4)
            gateway.kill_and_restart()
        self.feed(gateway, 1)
        self.wait_until_all_are_there(gateway, doubles)
        self.assertEqual(KILLS * 40 + 10, gateway.reads_of())

    @unittest.skipUnless(os.environ.get("GANTRY_FAILPOINTS"), "this build has no failpoints")
    def check_crash_between_delivery_and_mark(self, doubles):
        gateway = self.gateway(READER + EVERY_READ + self.section(), env={"GANTRY_FAILPOINT": "sink_delivered"})
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        with contextlib.suppress(OSError):  # that the reader is there is an event, which may have been the end
            reader.tags(new_epc())
        wait_for(lambda: not gateway.running(), "it has ended in the middle")
        first = wait_for(self.held, "something was delivered before")
        gateway.process.wait()
        gateway.env = None
        gateway.start()
        self.feed(gateway, 1)  # comes after what was delivered before
        self.wait_until_all_are_there(gateway, doubles)
        again = [each for each in first if self.held().count(each) > 1]
        self.assertEqual(first if doubles else [], again, "delivered again, and dropped where that is promised")


class NoDoubles:
    """Beside an OutageTest: the tests of a server that drops the ids that it has."""

    def test_a_server_that_is_killed_and_comes_back_has_every_event_once(self):
        self.check_server_killed_and_back(doubles=False)

    def test_a_gateway_that_is_killed_again_and_again_leaves_every_event_once(self):
        self.check_gateway_killed(doubles=False)

    def test_a_crash_between_delivery_and_mark_leaves_no_double(self):
        self.check_crash_between_delivery_and_mark(doubles=False)
