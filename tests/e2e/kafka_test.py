"""Events into a Kafka cluster (librdkafka's mock of one, a process of its own): in order for each key, at least once and
under ids that never change, whoever dies."""

import json
import unittest
from pathlib import Path

import servers
from gantry_e2e import BINARY, EVERY_READ, READER, wait_for
from outage import OutageTest


class Cluster(OutageTest):
    def setUp(self):
        program = Path(BINARY).resolve().parent / "gantry_kafka_cluster"
        self.server = servers.KafkaCluster(program)
        self.addCleanup(self.server.close)
        self.server.order("topic", "gantry.events", 3)

    def section(self, more=""):
        """librdkafka tries again by itself for as long as it may, so that is short."""
        return self.sink_section("kafka", self.server.url, 'key = "reader"\ntimeout = "2s"\n' + more)

    def messages(self):
        """Partition, key and content of each, partition by partition."""
        lines = [line.split("\t", 2) for line in self.server.order("read", "gantry.events")]
        return [(partition, key, json.loads(value)) for partition, key, value in lines]

    def delivered(self):
        return [event["id"] for _, _, event in self.messages()]


class Delivery(Cluster):
    def test_every_event_comes_in_its_readers_order(self):
        gateway = self.gateway(READER + EVERY_READ + self.section())
        self.feed(gateway, 5, names=("gate-1", "gate-2", "gate-3"))
        gateway.wait_for_events(75, "tag.read")
        wait_for(lambda: len(self.delivered()) == len(self.stored_ids(gateway)), "all are there")
        self.wait_until_all_are_there(gateway, doubles=False)
        partitions = {}
        for partition, key, event in self.messages():
            self.assertEqual(event.get("reader", ""), key)
            partitions.setdefault(key, set()).add(partition)
        for reader in ("gate-1", "gate-2", "gate-3"):
            self.assertEqual(1, len(partitions[reader]), "a reader's events stay in one partition")


class Deaths(Cluster):
    def test_brokers_that_go_and_come_back_have_every_event(self):
        self.check_server_killed_and_back(doubles=True)

    def test_a_gateway_that_is_killed_again_and_again_loses_nothing(self):
        self.check_gateway_killed(doubles=True)

    def test_a_crash_between_delivery_and_mark_delivers_twice_under_one_id(self):
        self.check_crash_between_delivery_and_mark(doubles=True)


if __name__ == "__main__":
    unittest.main()
