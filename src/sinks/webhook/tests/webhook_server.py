#!/usr/bin/env python3
"""The receiver that the tests of the webhook sink talk to, over HTTP or HTTPS.

  webhook_server.py PORT DIR [--tls CERT KEY [CLIENT_CA]]

In DIR it keeps `ids`, one id it has taken a line, and `requests`, one JSON object a request; both outlive a kill -9.
What it does with a request stands in DIR/behaviour, a JSON object that is read anew for each:

  status 200, reason, headers {}, body ""   what it answers; ids are taken if the status is 2xx
  refuse [], refuse_status 422     a request that holds one of these ids is answered so
  refuse_every                     or one whose number, behind the last colon, this divides
  delay                            seconds from a request to what is done with it
  max_body                         one with more bytes is answered 413, or reset with too_large "reset"
  secret                           one whose signature is wrong or missing is answered 401
  mode     never | garbage | drop | close | cut | long | endless | headers | dribble, see Handler.special()

It prints `ready` when it listens."""

import gzip
import hashlib
import hmac
import http.server
import json
import os
import socket
import socketserver
import ssl
import struct
import sys
import threading
import time


def verify(secret: bytes, header: str, body: bytes, tolerance: int = 300) -> bool:
    """Is this `Gantry-Signature` right for the body as it came, and not older than `tolerance` seconds?"""
    parts = dict(part.split("=", 1) for part in header.split(",") if "=" in part)
    signed = parts.get("t", "").encode() + b"." + body
    wanted = hmac.new(secret, signed, hashlib.sha256).hexdigest()
    return hmac.compare_digest(wanted.encode(), parts.get("v1", "").encode()) and abs(time.time() - int(parts["t"])) <= tolerance


class Server(socketserver.ThreadingMixIn, http.server.HTTPServer):
    allow_reuse_address = True
    daemon_threads = True
    request_queue_size = 100

    def __init__(self, port, folder, tls):
        super().__init__(("127.0.0.1", port), Handler)
        self.folder = folder
        self.tls = tls
        self.lock = threading.Lock()
        self.connections = 0

    def behaviour(self):
        try:
            with open(os.path.join(self.folder, "behaviour"), encoding="utf-8") as file:
                return json.load(file)
        except FileNotFoundError:
            return {}

    def append(self, name, text):
        """On its way to the disk when this returns: a kill of this process does not lose it."""
        with self.lock:
            file = os.open(os.path.join(self.folder, name), os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
            os.write(file, text.encode())
            os.close(file)

    def handle_error(self, request, client_address):
        pass  # clients that hang up are what this is about


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    rbufsize = 1 << 20

    def setup(self):
        if self.server.tls:
            self.request.settimeout(10)
            self.request = self.server.tls.wrap_socket(self.request, server_side=True)
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with self.server.lock:
            self.server.connections += 1
            self.number = self.server.connections
        super().setup()

    def log_message(self, *args):
        pass

    def do_OPTIONS(self):
        self.answer(204, {}, b"")

    def do_POST(self):
        do = self.server.behaviour()
        length = int(self.headers["Content-Length"])
        too_large = "max_body" in do and length > do["max_body"]
        if too_large and do.get("too_large") == "reset":
            return self.reset()
        raw = self.rfile.read(length)
        body = gzip.decompress(raw) if self.headers["Content-Encoding"] == "gzip" else raw
        ids = [event["id"] for event in json.loads(body)]
        time.sleep(do.get("delay", 0))
        status = do.get("status", 200)
        if any(int(each.rsplit(":", 1)[1]) % do["refuse_every"] == 0 for each in ids if "refuse_every" in do):
            status = do.get("refuse_status", 422)
        if set(ids) & set(do.get("refuse", [])):
            status = do.get("refuse_status", 422)
        if too_large:
            status = 413
        if "secret" in do and not verify(do["secret"].encode(), self.headers["Gantry-Signature"] or "", raw):
            status = 401
        entry = {"time": time.time(), "connection": self.number, "path": self.path, "headers": dict(self.headers.items()), "ids": ids,
                 "length": length, "status": status, "first": json.loads(body)[0]}  # fmt: skip
        self.server.append("requests", json.dumps(entry) + "\n")
        if 200 <= status <= 299 and do.get("mode", "close") in ("close", "long"):
            self.server.append("ids", "".join(each + "\n" for each in ids))
        if do.get("mode", "") in ("", "close"):
            self.answer(status, do.get("headers", {}), do.get("body", "").encode(), do.get("reason"))
            self.close_connection = self.close_connection or do.get("mode") == "close"
        else:
            self.special(do["mode"])

    def answer(self, status, headers, body, reason=None):
        reason = reason if reason is not None else self.responses.get(status, ("",))[0]
        lines = [f"HTTP/1.1 {status} {reason}", *(f"{name}: {value}" for name, value in headers.items())]
        if status != 204:
            lines.append(f"Content-Length: {len(body)}")
        self.wfile.write("\r\n".join(lines).encode() + b"\r\n\r\n" + body)

    def special(self, mode):
        self.close_connection = True
        if mode == "never":  # it takes the request and says nothing, for as long as the client waits
            self.rfile.read(1)
        elif mode == "garbage":  # it does not speak HTTP
            self.wfile.write(b"\x16\x03\x01 no web server here\r\n" * 20)
        elif mode == "cut":  # it dies within a good answer
            self.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 1000\r\n\r\nhalf of it")
        elif mode == "long":  # a good answer with a body that nobody wants
            self.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 10000000\r\n\r\n" + b"x" * 10_000_000)
        elif mode == "endless":  # an answer whose body never ends
            self.wfile.write(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1\r\nx\r\n")
            self.rfile.read(1)
        elif mode == "headers":  # headers without end
            while True:
                self.wfile.write(b"HTTP/1.1 200 OK\r\n" + b"X-More: " + b"x" * 8000 + b"\r\n")
        elif mode == "dribble":  # headers that come one byte a moment, and never all of them
            for byte in b"HTTP/1.1 200 OK\r\nX-Slow: " + b"x" * 100_000:
                self.wfile.write(bytes([byte]))
                time.sleep(0.01)
        # "drop": it hangs up without a word

    def reset(self):
        self.request.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.rfile.close()
        self.close_connection = True
        self.request.close()


def main():
    port, folder = int(sys.argv[1]), sys.argv[2]
    tls = None
    if "--tls" in sys.argv:
        files = sys.argv[sys.argv.index("--tls") + 1 :]
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(files[0], files[1])
        if len(files) > 2:
            tls.load_verify_locations(files[2])
            tls.verify_mode = ssl.CERT_REQUIRED
    server = Server(port, folder, tls)
    print("ready", flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main()
