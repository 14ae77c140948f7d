"""CAEN messages, and the ways to a reader, for the programs of caen_clients.py: docs/protocols/caen.md read a second
time, without any of the product's own code."""

import os
import select
import socket
import struct
import termios
import time
import tty
from enum import IntEnum
from typing import NamedTuple

from gantry_e2e import DEADLINE

VENDOR, REQUEST, REPLY, ABORT = 0x5358, 0x8001, 0x0001, b"\xAB"
RSSI, FRAMED, CONTINUOUS, COMPACT, TID, TRIGGER, XPC, PC = 1, 2, 4, 8, 0x10, 0x20, 0x40, 0x100  # inventory flags


class At(IntEnum):
    """Attributes."""
    COMMAND, RESULT = 0x01, 0x02
    EVENT_TYPE, TAG_ID_LEN, TIME, TAG_ID, TAG_TYPE = 0x0E, 0x0F, 0x10, 0x11, 0x12
    CHANNEL, CHANNEL_ADDRESS, TRIGGER, TRIGGER_TYPE, READ_POINT = 0x1E, 0x1F, 0x20, 0x21, 0x22
    TAG_VALUE, ADDRESS, LENGTH, BIT_RATE, POWER_GET, VSWR, PROTOCOL = 0x4D, 0x4E, 0x50, 0x51, 0x52, 0x53, 0x54
    STATUS, BOOLEAN, FIRMWARE = 0x56, 0x57, 0x5C
    BAUD, DATA_BITS, STOP_BITS, PARITY, FLOW = 0x60, 0x61, 0x62, 0x63, 0x64
    BITMASK, IO, CONFIG, CONFIG_VALUE, BANK, PAYLOAD, PASSWORD, NSI, Q = 0x67, 0x69, 0x6A, 0x6B, 0x71, 0x72, 0x73, 0x74, 0x75
    INFO, REGULATION, RF_CHANNEL, SUB_COMMAND, RSSI, XPC, PC = 0x76, 0x77, 0x78, 0x79, 0x7A, 0x7C, 0x7D
    POWER_SET, SOURCE = 0x96, 0xFB


class Do(IntEnum):
    """Commands."""
    RAW_READ_IDS, INVENTORY = 0x12, 0x13
    ADD_READ_TRIGGER, ADD_NOTIFY_TRIGGER, REMOVE_READ_TRIGGER, REMOVE_NOTIFY_TRIGGER = 0x3F, 0x40, 0x41, 0x42
    ALLOCATE_TRIGGER, DEALLOCATE_TRIGGER, ALLOCATE_CHANNEL, DEALLOCATE_CHANNEL = 0x49, 0x4A, 0x53, 0x54
    ADD_SOURCE, REMOVE_SOURCE, ADD_READ_POINT, REMOVE_READ_POINT = 0x5D, 0x5E, 0x5F, 0x60
    SET_POWER, SET_BIT_RATE, GET_POWER, SET_PROTOCOL = 0x64, 0x72, 0x73, 0x74
    READ_POINT_STATUS, CHECK_READ_POINT, GET_PROTOCOL, GET_FIRMWARE, GET_BIT_RATE = 0x76, 0x78, 0x79, 0x7C, 0x81
    SET_RS232, GET_IO, SET_IO, SET_IO_DIRECTION, GET_IO_DIRECTION = 0x83, 0x86, 0x87, 0x88, 0x89
    SET_CONFIG, GET_CONFIG = 0x8A, 0x8B
    PROGRAM, READ, WRITE, LOCK, KILL, SET_Q, GET_Q, GET_INFO = 0x95, 0x96, 0x97, 0x98, 0x99, 0x9B, 0x9C, 0x9E
    SET_HOPPING, GET_HOPPING, SET_REGULATION, GET_REGULATION = 0x9F, 0xA0, 0xA1, 0xA2
    SET_RF_CHANNEL, GET_RF_CHANNEL, CUSTOM, MATCH_IMPEDANCE = 0xA3, 0xA4, 0xA8, 0xB4


LONG = {At.EVENT_TYPE, At.POWER_GET, At.VSWR, At.PROTOCOL, At.STATUS, At.BAUD, At.DATA_BITS, At.STOP_BITS, At.PARITY,
        At.FLOW, At.IO, At.CONFIG, At.CONFIG_VALUE, At.PAYLOAD, At.PASSWORD, At.POWER_SET}


class Broken(Exception):
    """What the program would call an error of communication: it cannot use what the reader sent."""


class Refused(Exception):
    """The reader's own result code, other than 0."""

    def __init__(self, code):
        super().__init__(f"result code {code}")
        self.code = code


def pair(kind, value):
    """An attribute: a number in the attribute's own size, a text with its NUL, or bytes as they are."""
    if isinstance(value, str):
        value = value.encode() + b"\0"
    elif isinstance(value, int):
        value = struct.pack(">B" if kind == At.SUB_COMMAND else ">I" if kind in LONG else ">H", value)
    return struct.pack(">HHH", 0, 6 + len(value), kind) + value


def message(command, *pairs, number=0):
    body = b"".join((pair(At.COMMAND, command), *pairs))
    return struct.pack(">HHIH", REQUEST, number, VENDOR, 10 + len(body)) + body


def read_header(head, versions=(REPLY,)):
    version, number, vendor, length = struct.unpack(">HHIH", head)
    if version not in versions or vendor != VENDOR:
        raise Broken(f"no header: {head.hex(' ')}")
    return number, length


class Seen(NamedTuple):
    """A tag of an inventory, as far as the program was told."""
    epc: str
    source: str = ""
    read_point: str = ""
    time: tuple = ()
    type: int = -1
    rssi: int = None
    tid: str = None
    xpc: bytes = None
    pc: bytes = None


def text(value, room):
    """What a C program has after copying it into a buffer of that size: without the NUL it reads on behind it."""
    if len(value) > room:
        raise Broken(f"{value!r} does not fit into {room} bytes")
    if value[-1:] != b"\0":
        raise Broken(f"{value!r} has no NUL at its end")
    return value[:value.index(0)].decode("ascii")


# --- the ways to a reader -----------------------------------------------------------------------------------

class Wire:
    """Bytes to and from a reader. What a read had already taken when its time was over is gone, as in the programs."""

    def __init__(self, descriptor):
        self._descriptor = descriptor

    def send(self, data):
        while data:
            data = data[os.write(self._descriptor, data):]

    def take(self, size, patience=DEADLINE):
        taken = bytearray()
        end = time.monotonic() + patience
        while len(taken) < size:
            if not select.select([self._descriptor], [], [], max(0.0, end - time.monotonic()))[0]:
                raise TimeoutError(f"{len(taken)} of {size} bytes: {taken.hex(' ')}")
            piece = os.read(self._descriptor, size - len(taken))
            if not piece:
                raise Broken("the reader closed the connection")
            if not taken:
                end = time.monotonic() + patience  # a first byte starts the patience again
            taken += piece
        return bytes(taken)

    def waits(self, patience):
        """Whether anything comes within that time."""
        return bool(select.select([self._descriptor], [], [], patience)[0])

    def forget_input(self):
        while self.waits(0) and os.read(self._descriptor, 65536):
            pass


class Tcp(Wire):
    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), DEADLINE)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(True)
        super().__init__(self._socket.fileno())

    def close(self):
        self._socket.close()


class Tty(Wire):
    """A serial line as those programs open it: raw, eight bits, no parity, one stop bit."""

    def __init__(self, path, speed=termios.B115200):
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
        super().__init__(descriptor)
        tty.setraw(descriptor, termios.TCSANOW)
        settings = termios.tcgetattr(descriptor)
        settings[2] = settings[2] & ~(termios.CSTOPB | termios.PARENB | termios.CRTSCTS) | termios.CREAD | termios.CLOCAL
        settings[4] = settings[5] = speed
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)

    def close(self):
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
