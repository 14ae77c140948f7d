"""Who hears what the brokers pass on: a subscriber of MQTT and a reader of a JetStream stream, of the protocols just what is
needed for that."""

import json
import re
import socket
import threading
import time

from mqtt_wire import packet, text

ID = re.compile(rb'"id":"([^"]+)"')
ANSWERS = b"1"  # the subscription that requests are answered on
AT_ONCE = 10_000  # messages of a stream that are asked for


class MqttSubscriber:
    """Subscribes with QoS 0: the broker passes a message on before it confirms it, so what a killed broker has confirmed is
    on its way to us and not in a queue that dies with it. One thread a connection; `arrivals` outlives them."""

    def __init__(self, port, topic):
        self.port, self.topic = port, topic
        self.arrivals = []  # (id, when)
        self._socket = self._thread = None

    def connect(self):
        self._socket = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        stream = self._socket.makefile("rb", buffering=1 << 20)
        self._socket.sendall(packet(0x10, text("MQTT") + b"\x04\x02\x00\x00" + text("collector")))
        self._read(stream)
        self._socket.sendall(packet(0x82, b"\x00\x01" + text(self.topic) + b"\x00"))
        self._read(stream)
        self._socket.settimeout(None)
        self._thread = threading.Thread(target=self._listen, args=(stream,), daemon=True)
        self._thread.start()

    @staticmethod
    def _read(stream):
        head = stream.read(1)
        if not head:
            raise OSError("the broker has gone")
        shift = size = 0
        while True:
            byte = stream.read(1)[0]
            size |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return head[0], stream.read(size)

    def _listen(self, stream):
        try:
            while True:
                kind, body = self._read(stream)
                if kind & 0xF0 == 0x30:
                    now = time.time()
                    self.arrivals += [(each.decode(), now) for each in ID.findall(body)]
        except (OSError, IndexError, ValueError):
            pass  # the broker was killed

    def drain(self):
        """The broker is gone, and all that came from it is heard."""
        if self._thread:
            self._thread.join(60)

    def close(self):
        if self._socket:
            try:
                self._socket.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass  # it is gone already
            self.drain()
            self._socket.close()


class NatsClient:
    """One request after the other."""

    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=30)
        self._stream = self._socket.makefile("rb", buffering=1 << 20)
        self._stream.readline()
        self._socket.sendall(b'CONNECT {"verbose":false,"pedantic":false,"headers":true,"lang":"proof","version":"1"}\r\n'
                             b"SUB answers 1\r\nSUB messages 2\r\nPING\r\n")
        while self._stream.readline() != b"PONG\r\n":
            pass

    def _next(self):
        """Subscription, headers and payload of the next message."""
        while True:
            words = self._stream.readline().split()
            if not words:
                raise OSError("the server has gone")
            if words[0] == b"PING":
                self._socket.sendall(b"PONG\r\n")
            elif words[0] == b"MSG":
                return words[2], b"", self._stream.read(int(words[-1]) + 2)[:-2]
            elif words[0] == b"HMSG":
                head, whole = int(words[-2]), int(words[-1])
                body = self._stream.read(whole + 2)
                return words[2], body[:head], body[head:whole]

    def ask(self, subject, body):
        data = json.dumps(body).encode() if body is not None else b""
        self._socket.sendall(f"PUB {subject} answers {len(data)}\r\n".encode() + data + b"\r\n")
        while True:
            where, _, payload = self._next()
            if where == ANSWERS:
                return json.loads(payload)

    def ids(self, stream):
        """Of all messages of a stream, in its order. Asked for in batches: a server hangs up on who is pushed more than it reads."""
        info = self.ask(f"$JS.API.STREAM.INFO.{stream}", None)
        if "error" in info:
            return []
        count = info["state"]["messages"]
        config = {"ack_policy": "none", "deliver_policy": "all", "replay_policy": "instant", "headers_only": True}
        consumer = self.ask(f"$JS.API.CONSUMER.CREATE.{stream}", {"stream_name": stream, "config": config})
        if "error" in consumer:
            raise OSError(f"the stream cannot be read: {consumer['error']}")
        out = []
        for begin in range(0, count, AT_ONCE):
            batch = min(AT_ONCE, count - begin)
            asked = json.dumps({"batch": batch}).encode()
            self._socket.sendall(f"PUB $JS.API.CONSUMER.MSG.NEXT.{stream}.{consumer['name']} messages {len(asked)}\r\n".encode() +
                                 asked + b"\r\n")
            for _ in range(batch):
                _, headers, _ = self._next()
                found = re.search(rb"Nats-Msg-Id: *([^\r]+)", headers)
                if not found:
                    raise OSError(f"a message without an id: {headers!r}")
                out.append(found[1].decode())
        return out

    def close(self):
        self._socket.close()
