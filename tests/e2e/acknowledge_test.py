"""An acknowledged read is in the store, once, whatever is killed when."""

import os
import time
import unittest

from gantry_e2e import EVERY_READ, READER, EndToEnd, Store, wait_for
from silion import ACK, CRC, GET_INPUTS, TAGS, Command, SilionReader, new_epc

LEDGER = READER + EVERY_READ
QUICK_REPEATS = READER + 'ack_wait = "1s"\n' + EVERY_READ


class Acknowledgements(EndToEnd):
    def reader(self, gateway, name="gate-1", **more):
        reader = SilionReader(gateway.port, name, **more)
        self.addCleanup(reader.close)
        return reader

    def repeats(self, gateway, name="gate-1"):
        return gateway.reader_info(name)["counters"]["repeats"]


class Promise(Acknowledgements):
    def missing_at_the_acknowledgement(self, gateway, frames):
        """How many of so many frames are not in the store when their acknowledgement is here."""
        reader, missing = self.reader(gateway), 0
        store = Store(gateway.db)  # a connection of its own, as another process has it
        self.addCleanup(store.close)
        for _ in range(frames):
            tag = new_epc()
            reader.upload(tag)
            missing += store.number("SELECT count(*) FROM present_tags WHERE tag = ?", tag) == 0
        return missing

    def test_what_is_acknowledged_is_in_the_store(self):
        gateway = self.gateway(LEDGER)
        self.assertEqual(0, self.missing_at_the_acknowledgement(gateway, 200))
        self.assertEqual(200, gateway.reads_of())

    @unittest.skipUnless(os.environ.get("GANTRY_FAILPOINTS"), "needs a build with failpoints")
    def test_this_test_would_notice_an_acknowledgement_before_the_commit(self):
        gateway = self.gateway(LEDGER, env={"GANTRY_FAILPOINT": "ack_before_commit"})
        self.assertLess(0, self.missing_at_the_acknowledgement(gateway, 200))

    def test_it_is_there_after_a_kill_at_the_acknowledgement(self):
        gateway = self.gateway(LEDGER)
        tags = []
        for _ in range(5):
            reader = self.reader(gateway)
            for _ in range(10):
                tags.append(new_epc())
                reader.upload(tags[-1])
            gateway.kill_and_restart()
            self.assertEqual(sorted(tags), sorted(row["tag"] for row in gateway.events("tag.read")))

    def test_without_the_flag_there_is_no_acknowledgement(self):
        gateway = self.gateway(LEDGER)
        reader = self.reader(gateway, flags=0)
        silent = [new_epc() for _ in range(3)]
        for tag in silent:
            reader.tags(tag)
        for tag in silent:
            gateway.wait_for_events(1, "tag.read", tag=tag)
        # Were there one, it would come before the answer to a command that is given now.
        asking = self.under_way(gateway.begin("gpio", "get", "gate-1"))
        command = reader.next_command()
        self.assertEqual(GET_INPUTS, command.code)
        reader.answer(command, bytes([1, 1, 0]))
        self.assertEqual(0, asking.wait())

    def test_heartbeats_inputs_and_faults_are_never_acknowledged(self):
        gateway = self.gateway(LEDGER)
        reader = self.reader(gateway)
        reader.heartbeat()
        reader.send(reader.frame(2, bytes([1, 1, 1]), ACK))
        reader.send(reader.frame(5, b"\0" * 24, ACK, status=100_011))
        gateway.wait_for_events(1, "reader.fault")
        reader.upload(new_epc())  # the first that comes is this one's
        asking = self.under_way(gateway.begin("gpio", "get", "gate-1"))
        self.assertEqual(GET_INPUTS, reader.next_command().code)

    def test_a_frame_without_tags_is_acknowledged_too(self):
        gateway = self.gateway(LEDGER)
        self.reader(gateway).upload()


class Repeats(Acknowledgements):
    def test_a_repeat_after_a_lost_acknowledgement_is_acknowledged_and_not_counted(self):
        gateway = self.gateway(QUICK_REPEATS)
        reader = self.reader(gateway)
        tag = new_epc()
        sent = reader.upload(tag)
        for lost in range(1, 3):  # the reader does not get it, waits, and sends the same again
            self.assertTrue(reader.hears_nothing_for(1.1))
            reader.send(sent)
            reader.wait_for_ack()
            self.assertEqual(lost, self.repeats(gateway))
        self.assertEqual(1, gateway.reads_of(tag))
        reader.upload(new_epc())
        self.assertEqual(2, gateway.reads_of())

    def test_an_equal_frame_after_a_heartbeat_is_a_new_one(self):
        gateway = self.gateway(QUICK_REPEATS)
        reader = self.reader(gateway)
        tag = new_epc()
        for _ in range(3):
            reader.upload(tag)
            reader.heartbeat()
        self.assertEqual(3, gateway.reads_of(tag))
        self.assertEqual(0, self.repeats(gateway))

    def test_an_equal_frame_sooner_than_any_reader_repeats_is_a_new_one(self):
        gateway = self.gateway(LEDGER)  # the reader waits five seconds
        reader = self.reader(gateway)
        tag = new_epc()
        for _ in range(3):
            reader.upload(tag)
        self.assertEqual(3, gateway.reads_of(tag))

    def first_on_a_new_connection(self, between):
        gateway = self.gateway(LEDGER)
        reader = self.reader(gateway)
        tag = new_epc()
        sent = reader.upload(tag)
        between(gateway, reader)
        reader.port = gateway.port
        reader.connect().send(sent)
        reader.wait_for_ack()
        self.assertEqual(1, gateway.reads_of(tag))
        self.assertEqual(1, self.repeats(gateway))
        reader.heartbeat()
        reader.upload(tag)  # it is done with that: this one is new
        self.assertEqual(2, gateway.reads_of(tag))

    def test_the_same_frame_first_on_a_new_connection(self):
        self.first_on_a_new_connection(lambda gateway, reader: reader.reset())

    def test_the_same_frame_first_after_the_gateway_was_killed(self):
        self.first_on_a_new_connection(lambda gateway, reader: gateway.kill_and_restart())

    def test_the_same_frame_first_after_the_gateway_was_stopped(self):
        self.first_on_a_new_connection(lambda gateway, reader: gateway.restart())

    def test_an_equal_frame_on_a_new_connection_is_new_when_the_acknowledgement_had_arrived(self):
        gateway = self.gateway(LEDGER)
        reader = self.reader(gateway)
        tag = new_epc()
        sent = reader.upload(tag)
        reader.heartbeat()  # a reader that waits sends none, so it got its acknowledgement
        wait_for(lambda: gateway.reader_info("gate-1")["counters"]["frames"] == 2, "the heartbeat is taken")
        reader.reset()
        gateway.wait_for_events(1, "reader.disconnected")
        gateway.kill_and_restart()
        reader.port = gateway.port
        reader.connect().send(sent)
        reader.wait_for_ack()
        self.assertEqual(2, gateway.reads_of(tag))

    def test_a_reader_that_repeats_for_a_killed_gateway_loses_nothing(self):
        gateway = self.gateway(LEDGER)
        reader, sent = self.reader(gateway), 0
        for round_trip in range(6):
            tags = [new_epc() for _ in range(3)]
            sent += 3
            frame = reader.tags(*tags)
            gateway.kill()  # before, in, or after the commit
            gateway.start()
            reader.port = gateway.port
            reader.connect().send(frame)
            reader.wait_for_ack()
            self.assertEqual(sent, gateway.reads_of(), f"after kill {round_trip + 1}")


class OneConnection(Acknowledgements):
    def test_the_newest_connection_wins(self):
        gateway = self.gateway(LEDGER)
        old = self.reader(gateway)
        old.upload(new_epc())
        new = self.reader(gateway)
        new.heartbeat()
        old.wait_for_the_end()
        new.upload(new_epc())
        self.assertEqual(2, gateway.reads_of())
        down = gateway.wait_for_events(1, "reader.disconnected")
        self.assertEqual(["a newer connection took its place"], [row["reason"] for row in down])
        gateway.wait_for_message("gate-1: a new connection from 127.0.0.1:.* takes the place")
        readers = gateway.ask("GET", "/api/v1/readers").json()["readers"]
        self.assertEqual([("gate-1", True)], [(each["name"], each["connected"]) for each in readers])

    def test_what_was_under_way_on_the_old_one_is_neither_lost_nor_doubled(self):
        gateway = self.gateway(LEDGER)
        tags, reader = [], self.reader(gateway)
        for _ in range(20):
            tags.append(new_epc())
            sent = reader.tags(tags[-1])  # its acknowledgement is not waited for
            old, reader = reader, self.reader(gateway)
            reader.send(sent)
            reader.wait_for_ack()
            old.wait_for_the_end()
        self.assertEqual(sorted(tags), sorted(row["tag"] for row in gateway.events("tag.read")))

    def test_many_readers_at_once_are_kept_apart(self):
        gateway = self.gateway(LEDGER)
        readers = [self.reader(gateway, f"gate-{i}") for i in range(30)]
        expected = {reader.name: [new_epc() for _ in range(10)] for reader in readers}
        for i in range(10):
            for reader in readers:
                reader.tags(expected[reader.name][i])
            for reader in readers:
                reader.wait_for_ack()
        stored = {reader.name: [row["tag"] for row in gateway.events("tag.read", reader=reader.name)] for reader in readers}
        self.assertEqual(expected, stored)


class Checksums(Acknowledgements):
    def test_a_reader_that_uses_a_crc_is_answered_with_one(self):
        gateway = self.gateway(LEDGER)
        reader = self.reader(gateway, flags=ACK | CRC)
        reader.heartbeat()
        tag = new_epc()
        reader.tags(tag)
        self.assertEqual(Command(TAGS, CRC, b""), reader.next_command())
        self.assertEqual(1, gateway.reads_of(tag))

    def test_a_frame_with_a_wrong_crc_is_neither_stored_nor_acknowledged(self):
        gateway = self.gateway(LEDGER)
        reader = self.reader(gateway, flags=ACK | CRC)
        reader.heartbeat()
        bad, good = new_epc(), new_epc()
        spoilt = bytearray(reader.frame(TAGS, b"\0\1" + bytes([1, 1, 0xCE, 5, 12]) + bytes.fromhex(bad) + b"\0", reader.flags))
        spoilt[-5] ^= 1
        reader.send(spoilt)
        reader.tags(good)
        reader.wait_for_ack()
        self.assertEqual([good], [row["tag"] for row in gateway.events("tag.read")])
        self.assertEqual(1, gateway.reader_info("gate-1")["counters"]["bad_checksum"])
        self.assertTrue(reader.hears_nothing_for(0.1))  # one acknowledgement, not two


class Latency(Acknowledgements):
    def test_one_reader_gets_its_acknowledgements_at_once(self):
        gateway = self.gateway(LEDGER)
        reader, times = self.reader(gateway), []
        for _ in range(100):
            begun = time.monotonic()
            reader.upload(new_epc())
            times.append(time.monotonic() - begun)
        self.assertLess(sorted(times)[50], 0.25, times)


if __name__ == "__main__":
    unittest.main()
