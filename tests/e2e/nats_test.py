"""Events into a real NATS JetStream, seen by a client of our own that knows just enough of its protocol: every one once
and in order, whoever dies."""

import base64
import json
import socket
import unittest

import servers
from gantry_e2e import EVERY_READ, READER, wait_for
from outage import NoDoubles, OutageTest


class Client:
    """One connection; asks and waits."""

    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        self._file = self._socket.makefile("rb")
        self._file.readline()  # INFO
        self._socket.sendall(b'CONNECT {"verbose":false,"pedantic":false,"headers":true}\r\nSUB answers 1\r\n')

    def ask(self, subject, question=None):
        body = json.dumps(question).encode() if question else b""
        self._socket.sendall(f"PUB {subject} answers {len(body)}\r\n".encode() + body + b"\r\n")
        while True:
            words = self._file.readline().split()
            if words[0] == b"PING":
                self._socket.sendall(b"PONG\r\n")
            elif words[0] in (b"MSG", b"HMSG"):
                size = int(words[-1])
                return json.loads(self._file.read(size + 2)[:size])

    def close(self):
        self._file.close()
        self._socket.close()


class JetStream(OutageTest):
    def setUp(self):
        self.server = servers.Nats(self.directory())
        self.addCleanup(self.server.kill)
        self.server.start()

    def section(self, more=""):
        return self.sink_section("nats", self.server.url, more)

    def messages(self):
        """Subject, message id and content of each, in the order of the stream."""
        client = Client(self.server.port)
        try:
            state = client.ask("$JS.API.STREAM.INFO.GANTRY").get("state", {"first_seq": 1, "last_seq": 0})
            out = []
            for number in range(state["first_seq"], state["last_seq"] + 1):
                message = client.ask("$JS.API.STREAM.MSG.GET.GANTRY", {"seq": number})["message"]
                heads = base64.b64decode(message["hdrs"]).decode().split("\r\n")
                ids = [line.split(":", 1)[1].strip() for line in heads if line.lower().startswith("nats-msg-id:")]
                out.append((message["subject"], ids[0], json.loads(base64.b64decode(message["data"]))))
            return out
        finally:
            client.close()

    def delivered(self):
        return [message_id for _, message_id, _ in self.messages()]


class Delivery(JetStream):
    def test_every_event_comes_in_order_on_its_readers_subject(self):
        gateway = self.gateway(READER + EVERY_READ + self.section())
        self.feed(gateway, 5)
        gateway.wait_for_events(50, "tag.read")
        wait_for(lambda: self.delivered() == self.stored_ids(gateway), "the stream has all, in order")
        in_store = {row["id"]: row for row in gateway.events()}
        for subject, message_id, event in self.messages():
            self.assertEqual(message_id, event["id"])
            self.assertEqual(in_store[message_id].get("tag"), event.get("tag"))
            if "reader" in event:
                self.assertEqual(f"gantry.e2e.{event['reader']}.events", subject)


class Deaths(NoDoubles, JetStream):
    pass


if __name__ == "__main__":
    unittest.main()
