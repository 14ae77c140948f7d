"""A Silion reader made of a socket and nothing of the product's own code: the frames of docs/protocols/silion.md,
built and read a second time, so that an error in the product's codec cannot hide behind the same error here."""

import itertools
import socket
import struct
import time
from typing import NamedTuple

from gantry_e2e import DEADLINE

ACK, CRC = 1, 2  # flag bits
ACK_WAIT = 6  # seconds; the gateway expects 5 to 60
TAGS, INPUTS, FIRST_SEEN, HEARTBEAT, FAULT, GET_INPUTS, SET_OUTPUTS, RESTART = 1, 2, 3, 4, 5, 0x16, 0x17, 0x18


class Tag(NamedTuple):
    epc: str
    antenna: int = 1
    reads: int = 1
    rssi: int = -50
    protocol: int = 5
    bank: bytes = b""


class Command(NamedTuple):
    code: int
    flags: int
    data: bytes


def crc16(data):
    """CRC-16/MODBUS; low byte first on the wire."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


def record(tag):
    epc = bytes.fromhex(tag.epc)
    head = struct.pack(">BBbBB", tag.antenna, tag.reads, tag.rssi, tag.protocol, len(epc))
    return head + epc + bytes([len(tag.bank)]) + tag.bank


def frame(name, code, data=b"", flags=0, status=0):
    name = name if isinstance(name, bytes) else name.encode()
    out = struct.pack(">BBHBBI", 0xFF, len(name), len(data), code, flags, status) + name + data
    return out + crc16(out) if flags & CRC else out


def tag_data(tags):
    return struct.pack(">H", len(tags)) + b"".join(map(record, tags))


_numbers = itertools.count(1)


def new_epc():
    """An SGTIN-96 that no test has used."""
    return f"3074257BF7194E40{next(_numbers):08X}"


class SilionReader:
    def __init__(self, port, name="gate-1", flags=ACK, source=None):
        self.port, self.name, self.flags, self.source = port, name, flags, source
        self.beats, self.socket, self._rest = 0, None, b""
        self.connect()

    def connect(self):
        self.close()
        self._rest = b""
        self.socket = socket.create_connection(("127.0.0.1", self.port), DEADLINE,
                                               (self.source, 0) if self.source else None)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self

    def close(self):
        if self.socket:
            self.socket.close()
            self.socket = None

    def reset(self):
        """As when the power goes: the peer hears a reset, not an orderly end."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close()

    # What it sends.

    def send(self, data):
        self.socket.sendall(data)
        return data

    def frame(self, code, data=b"", flags=0, status=0):
        return frame(self.name, code, data, flags | self.flags & CRC, status)

    def heartbeat(self, status=0):
        data = struct.pack(">BB4sBBI", 1, 10, bytes([10, 0, 0, 0]), 1, 1, self.beats)
        self.beats += 1
        return self.send(self.frame(HEARTBEAT, data, status=status))

    def tag_frame(self, *tags):
        tags = [Tag(tag) if isinstance(tag, str) else tag for tag in tags]
        return self.frame(TAGS, tag_data(tags), self.flags)

    def tags(self, *tags):
        """Sends them and returns the frame, to be sent again."""
        return self.send(self.tag_frame(*tags))

    def inputs(self, *states):
        data = bytes([len(states)]) + b"".join(bytes([i, state]) for i, state in enumerate(states, 1))
        return self.send(self.frame(INPUTS, data))

    def fault(self, error, text=b"\0" * 24):
        return self.send(self.frame(FAULT, text, status=100_000 + error))

    def answer(self, command, data=b"", status=0):
        return self.send(self.frame(command.code, data, command.flags & CRC, status))

    # What it hears.

    def _take(self, size, timeout):
        self.socket.settimeout(timeout)
        while len(self._rest) < size:
            piece = self.socket.recv(65536)
            if not piece:
                raise ConnectionError("the gateway closed the connection")
            self._rest += piece
        taken, self._rest = self._rest[:size], self._rest[size:]
        return taken

    def next_command(self, timeout=DEADLINE):
        head = self._take(6, timeout)
        if head[:2] != b"\xEE\0":
            raise AssertionError(f"no frame begins with {head.hex(' ')}")
        size, code, flags = struct.unpack(">HBB", head[2:])
        data = self._take(size, timeout)
        if flags & CRC and self._take(2, timeout) != crc16(head + data):
            raise AssertionError("the gateway's CRC is wrong")
        return Command(code, flags, data)

    def wait_for_ack(self, timeout=DEADLINE):
        command = self.next_command(timeout)
        if command != Command(TAGS, self.flags & CRC, b""):
            raise AssertionError(f"{command} is no acknowledgement")

    def hears_nothing_for(self, seconds):
        """The reader's own patience: the time after which it would send again."""
        try:
            self._rest = self._take(1, seconds) + self._rest
            return False
        except TimeoutError:
            return True

    def wait_for_the_end(self, timeout=DEADLINE):
        """Until the gateway has closed the connection; what it still said is thrown away."""
        self.socket.settimeout(timeout)
        try:
            while self.socket.recv(65536):
                pass
        except ConnectionError:
            pass

    def upload(self, *tags):
        """The whole exchange: tags, and the acknowledgement; asked for again as a reader does, for what follows an equal
        frame after its wait counts as a repeat, which is not always answered at once."""
        sent, end = self.tags(*tags), time.monotonic() + DEADLINE
        while True:
            try:
                self.wait_for_ack(ACK_WAIT)
                return sent
            except TimeoutError:
                if time.monotonic() > end:
                    raise
                self.send(sent)
