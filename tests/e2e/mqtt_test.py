"""Events to a real broker, and requests from it: seen by a client of our own that knows just enough of MQTT 3.1.1."""

import json
import socket
import threading
import unittest

import servers
from gantry_e2e import EVERY_READ, READER, EndToEnd, wait_for
from mqtt_wire import packet, text
from silion import SilionReader, new_epc


class Client:
    """Connects, subscribes to everything, and keeps what comes."""

    def __init__(self, port):
        self.messages = []
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        self._file = self._socket.makefile("rb")
        self._socket.sendall(packet(0x10, text("MQTT") + b"\x04\x02\x00\x3c" + text("watcher")))
        self._read()
        self._socket.sendall(packet(0x82, b"\x00\x01" + text("gantry/#") + b"\x00"))
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _read(self):
        kind, shift, size = self._file.read(1)[0], 0, 0
        while True:
            byte = self._file.read(1)[0]
            size |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return kind, self._file.read(size)

    def _listen(self):
        try:
            while True:
                kind, body = self._read()
                if kind & 0xF0 == 0x30:
                    size = int.from_bytes(body[:2], "big")
                    self.messages.append((body[2:2 + size].decode(), body[2 + size:]))
        except (OSError, IndexError, ValueError):
            pass  # the test is over

    def publish(self, topic, message):
        self._socket.sendall(packet(0x30, text(topic) + json.dumps(message).encode()))

    def on(self, topic):
        return [json.loads(body) for where, body in list(self.messages) if where == topic]

    def close(self):
        self._socket.close()


class Broker(EndToEnd):
    def setUp(self):
        broker = servers.Mosquitto(self.directory())
        self.addCleanup(broker.kill)
        broker.start()
        self.port = broker.port
        self.client = wait_for(self.connect, "the broker is there")
        self.addCleanup(self.client.close)

    def connect(self):
        try:
            return Client(self.port)
        except (OSError, IndexError):
            return None

    def site(self, more=""):
        return self.gateway(READER + EVERY_READ + f'[[sink]]\nname = "broker"\ntype = "mqtt"\n'
                            f'url = "mqtt://127.0.0.1:{self.port}"\nstart = "oldest"\n{more}')

    def test_events_come_by_reader_and_in_order(self):
        gateway = self.site()
        reader = SilionReader(gateway.port)
        self.addCleanup(reader.close)
        for _ in range(5):
            reader.tags(new_epc(), new_epc())
            reader.wait_for_ack()
        stored = lambda: [row["id"] for row in gateway.store().rows(
            "SELECT id FROM events WHERE reader IS NOT NULL ORDER BY seq")]
        topic = lambda: f"gantry/e2e/{gateway.events('tag.read')[0]['reader']}/events"
        wait_for(lambda: gateway.events("tag.read") and [each["id"] for each in self.client.on(topic())] == stored(),
                 lambda: f"all are there; {self.client.messages}")

    def test_a_request_is_answered_and_one_that_is_wrong_says_why(self):
        gateway = self.site("commands = true\n")
        wait_for(lambda: "up to date" == json.loads(gateway.cli("sink", "show", "broker", "--json").out)["state"], "connected")
        self.client.publish("gantry/e2e/request/status", {"id": "a-1"})
        answer = wait_for(lambda: self.client.on("gantry/e2e/response/status"), lambda: f"an answer; {self.client.messages}")[0]
        self.assertEqual("ok", answer["status"], answer)
        self.assertEqual("e2e", answer["data"]["id"])
        self.assertEqual("a-1", answer["id"])
        self.client.publish("gantry/e2e/request/gpio.get", {"reader": "nobody"})
        answer = wait_for(lambda: self.client.on("gantry/e2e/response/gpio.get"), "an answer")[0]
        self.assertEqual("error", answer["status"], answer)
        self.assertIn('there is no reader "nobody"', answer["error"])

    def test_without_the_word_nobody_commands(self):
        gateway = self.site()
        wait_for(lambda: "up to date" == json.loads(gateway.cli("sink", "show", "broker", "--json").out)["state"], "connected")
        self.client.publish("gantry/e2e/request/status", {})
        reader = SilionReader(gateway.port)  # what comes after it has come
        self.addCleanup(reader.close)
        reader.tags(new_epc())
        reader.wait_for_ack()
        wait_for(lambda: any(where.endswith("/events") and b"tag.read" in body for where, body in self.client.messages), "a read")
        self.assertEqual([], [where for where, _ in self.client.messages if "/response/" in where])


if __name__ == "__main__":
    unittest.main()
