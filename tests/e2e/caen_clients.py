"""Programs that talk to CAEN readers, made again from what the public ones do on the wire, and as strict as they are:
the order, the sizes and the waiting of each. Nothing of the product's own code, so that an error in its codec cannot
hide behind the same error here."""

import socket
import struct
import time

from caen_wire import (ABORT, COMPACT, CONTINUOUS, FRAMED, LONG, PC, REPLY, REQUEST, RSSI, TID, XPC, At, Broken, Do, Refused,
                       Seen, Wire, message, pair, read_header, text)
from gantry_e2e import DEADLINE

# --- the maker's light C library (2022) ---------------------------------------------------------------------

class Cursor:
    """The attributes of one message in the one order that the library knows, in the sizes that it has room for."""
    EXACT = {**{kind: 2 for kind in (At.COMMAND, At.RESULT, At.LENGTH, At.TAG_ID_LEN, At.ADDRESS, At.TAG_TYPE, At.RSSI,
                                     At.BIT_RATE, At.BOOLEAN, At.RF_CHANNEL, At.REGULATION, At.BITMASK, At.BANK, At.PC)},
             **{kind: 4 for kind in (At.PROTOCOL, At.POWER_GET, At.CONFIG_VALUE, At.STATUS, At.IO, At.VSWR, At.XPC)},
             At.TIME: 8}
    ROOM = {At.TAG_ID: 64, At.SOURCE: 30, At.READ_POINT: 5, At.INFO: 41, At.FIRMWARE: 30, At.TAG_VALUE: 65535}

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, kind):
        """The value, or None when another attribute stands here."""
        if self.at + 6 > len(self.data):
            raise Broken(f"attribute 0x{kind:02X} is missing: the message ends")
        if self.at > 0x7FFF:
            raise Broken("a message longer than its positions, which have 16 bits and a sign")
        _, length, found = struct.unpack_from(">HHH", self.data, self.at)
        if found != kind:
            return None
        value = self.data[self.at + 6:self.at + length]
        if length < 6 or self.at + length > len(self.data):
            raise Broken(f"attribute 0x{kind:02X} is longer than its message")
        if len(value) != self.EXACT.get(kind, len(value)) or len(value) > self.ROOM.get(kind, 8):
            raise Broken(f"attribute 0x{kind:02X} has {len(value)} bytes")
        self.at += length
        if kind in (At.SOURCE, At.READ_POINT, At.INFO, At.FIRMWARE):
            return text(value, self.ROOM[kind])
        return value if kind in (At.TAG_ID, At.TAG_VALUE, At.XPC, At.PC, At.TIME) else int.from_bytes(value, "big")

    def must(self, kind):
        if (value := self.take(kind)) is None:
            raise Broken(f"attribute 0x{kind:02X} is not where it must be: {self.data[self.at:].hex(' ')}")
        return value

    def tag(self, flags):
        """One tag, or None when none stands here."""
        said = {}
        if not flags & COMPACT:
            if (source := self.take(At.SOURCE)) is None:
                return None
            said = {"source": source, "read_point": self.must(At.READ_POINT),
                    "time": struct.unpack(">II", self.must(At.TIME)), "type": self.must(At.TAG_TYPE)}
            size = self.must(At.TAG_ID_LEN)
            if len(epc := self.must(At.TAG_ID)) != size:
                raise Broken(f"an id of {len(epc)} bytes, announced as {size}")
        elif (epc := self.take(At.TAG_ID)) is None:
            return None
        if flags & RSSI:
            said["rssi"] = struct.unpack(">h", struct.pack(">H", self.must(At.RSSI)))[0]
        if flags & TID:
            size = self.must(At.LENGTH)
            said["tid"] = self.must(At.TAG_VALUE).hex().upper() if size else ""
            if size > 64 or len(said["tid"]) != 2 * size:
                raise Broken(f"a TID of {len(said['tid']) // 2} bytes, announced as {size}")
        if flags & XPC:
            said["xpc"] = self.must(At.XPC)
        if flags & PC:
            said["pc"] = self.must(At.PC)
        return Seen(epc.hex().upper(), **said)


class Stream(Cursor):
    """Attributes that come one by one, each into a buffer that holds the longest id and no more."""

    def __init__(self, wire, first_patience, patience):
        super().__init__(b"")
        self._wire, self._patience, self._later = wire, first_patience, patience

    def take(self, kind):
        if self.at == len(self.data):
            head = self._wire.take(6, self._patience)
            reserved, length, _ = struct.unpack(">HHH", head)
            if reserved or not 6 <= length <= 6 + 64:
                raise Broken(f"no attribute: {head.hex(' ')}")
            self.data, self.at = head + self._wire.take(length - 6, self._patience), 0
            self._patience = self._later
        return super().take(kind)


class LightLibrary:
    """Counts its messages, empties its input before each, and wants the answer within five seconds."""
    PATIENCE, FIRST_PATIENCE = 5.0, 0.5

    def __init__(self, wire):
        self.wire, self.number, self._flags = wire, 0, 0

    def _exchange(self, command, *pairs):
        number, self.number = self.number, (self.number + 1) % 0x10000
        self.wire.forget_input()
        self.wire.send(message(command, *pairs, number=number))
        answered, length = read_header(self.wire.take(10, self.PATIENCE))
        if answered != number or 0 < length < 10:
            raise Broken(f"answer {answered} of {length} bytes to message {number}")
        undefined = length == 0
        reply = Cursor(self.wire.take(8 if undefined else length - 10, self.PATIENCE))
        if reply.must(At.COMMAND) != command:
            raise Broken("the answer to another command")
        return reply, undefined

    def call(self, command, *pairs, out=()):
        """The values asked for. One that is not there at success is memory that the program never wrote."""
        reply, _ = self._exchange(command, *pairs)
        values = [reply.take(kind) for kind in out]
        if code := reply.must(At.RESULT):
            raise Refused(code)
        if None in values or reply.at != len(reply.data):
            raise Broken(f"too little or too much in {reply.data.hex(' ')}")
        return values[0] if len(values) == 1 else tuple(values)

    def info(self):
        model, blank, serial = self.call(Do.GET_INFO, out=[At.INFO]).partition(" ")
        if not model or not blank or len(model) > 19 or len(serial) > 19:
            raise Broken(f"neither model nor serial number: {model!r} {serial!r}")
        return model, serial

    @staticmethod
    def _tag(source, epc):
        return pair(At.SOURCE, source), pair(At.TAG_ID_LEN, len(epc)), pair(At.TAG_ID, epc)

    @staticmethod
    def _password(password):
        return (pair(At.PASSWORD, password),) if password else ()

    def read(self, source, epc, bank, address, length, password=0):
        data = self.call(Do.READ, *self._tag(source, epc), pair(At.BANK, bank), pair(At.ADDRESS, address),
                         pair(At.LENGTH, length), *self._password(password), out=[At.TAG_VALUE])
        if len(data) != length:
            raise Broken(f"{len(data)} bytes into a buffer of {length}")
        return data

    def write(self, source, epc, bank, address, data, password=0):
        self.call(Do.WRITE, *self._tag(source, epc), pair(At.BANK, bank), pair(At.ADDRESS, address),
                  pair(At.LENGTH, len(data)), pair(At.TAG_VALUE, data), *self._password(password))

    def lock(self, source, epc, payload, password=0):
        self.call(Do.LOCK, *self._tag(source, epc), pair(At.PAYLOAD, payload), *self._password(password))

    def kill(self, source, epc, password):
        self.call(Do.KILL, *self._tag(source, epc), pair(At.PASSWORD, password))

    def program(self, source, epc, nsi=0, password=0):
        self.call(Do.PROGRAM, *self._tag(source, epc), pair(At.NSI, nsi), *self._password(password))

    @staticmethod
    def _mask(mask):
        bank, first_bit, bits, data = mask
        return pair(At.BANK, bank), pair(At.LENGTH, bits), pair(At.TAG_ID, data), pair(At.ADDRESS, first_bit)

    def _inventory(self, source, flags, mask):
        return self._exchange(Do.INVENTORY, pair(At.SOURCE, source), *(self._mask(mask) if mask else ()),
                              *((pair(At.BITMASK, flags),) if flags else ()))

    def inventory(self, source="Source_0", flags=0, mask=None):
        """All that one call finds; `mask`: bank, first bit, number of bits, bytes."""
        reply, undefined = self._inventory(source, flags, mask)
        if undefined:
            raise Broken("a stream, though none was asked for")
        tags = []
        while tag := reply.tag(flags):
            tags.append(tag)
        if code := reply.must(At.RESULT):
            raise Refused(code)
        if reply.at != len(reply.data):
            raise Broken("something behind the result")
        return tags

    def start_stream(self, source="Source_0", flags=FRAMED | CONTINUOUS, mask=None):
        reply, undefined = self._inventory(source, flags, mask)
        if not undefined:  # the library would not notice, and wait for tags that never come
            raise Refused(reply.must(At.RESULT))
        self._flags = flags

    def next_of_stream(self):
        """A tag, the result code that ends the stream, or None: nothing came in half a second."""
        stream = Stream(self.wire, self.FIRST_PATIENCE, self.PATIENCE)
        try:
            tag = stream.tag(self._flags)
        except TimeoutError:
            if stream.data:
                raise Broken("half a tag, and then nothing") from None
            return None
        return stream.must(At.RESULT) if tag is None else tag

    def abort(self):
        self.wire.send(ABORT)

    def drain(self):
        """As the programs do after an abort: until a result code, however long that takes."""
        end = time.monotonic() + DEADLINE
        tags = []
        while not isinstance(found := self.next_of_stream(), int):
            if found is not None:
                tags.append(found)
            if time.monotonic() > end:
                raise Broken("no result code ends the stream")
        return tags, found


# --- libcaenrfid and libavp (2011) --------------------------------------------------------------------------

class Libcaenrfid:
    """Sends message id 0 for ever and looks at no id: one answer too many, and all later ones are another's. It never
    empties its input. What it lacks in an answer makes it fail with its own error, not with the reader's code."""

    def __init__(self, wire):
        self.wire, self._rest, self._at = wire, b"", 0

    def _exchange(self, command, *pairs):
        self.wire.send(message(command, *pairs))
        _, length = read_header(self.wire.take(10))
        if length < 10:
            raise Broken("a message without a length")
        self._rest, self._at = self.wire.take(length - 10), 0
        if self._number(At.COMMAND) != command:
            raise Broken("the answer to another command")

    def _pull(self, kind, size):
        """The fixed part of an attribute, whose length is to be `size` at most; None: it is another one."""
        part = self._rest[self._at:self._at + size]
        if len(part) < size:
            return None
        _, length, found = struct.unpack_from(">HHH", part)
        if found != kind:
            return None
        self._at += size
        return length, part[6:]

    def _number(self, kind):
        size = {At.TIME: 8}.get(kind, 4 if kind in LONG else 2)
        if (found := self._pull(kind, 6 + size)) is None:
            return None
        length, value = found
        if length != 6 + size:
            raise Broken(f"attribute 0x{kind:02X} says {length} bytes")
        return int.from_bytes(value, "big")

    def _bytes(self, kind, room):
        if (found := self._pull(kind, 6)) is None:
            return None
        size = found[0] - 6
        value = self._rest[self._at:self._at + size]
        if not 0 <= size <= room or len(value) != size:
            raise Broken(f"attribute 0x{kind:02X} has {size} bytes, there is room for {room}")
        self._at += size
        return value

    def _finish(self):
        if (code := self._number(At.RESULT)) is None:
            raise Broken("no result code")
        if self._at != len(self._rest):
            raise Broken("something behind the result")
        if code:
            raise Refused(code)

    def get(self, command, *pairs, out=None):
        self._exchange(command, *pairs)
        value = self._number(out) if out else None
        self._finish()
        if out and value is None:
            raise Broken("the value is not there")
        return value

    def firmware(self):
        self._exchange(Do.GET_FIRMWARE)
        if not (release := self._bytes(At.FIRMWARE, 64)):
            raise Broken("no firmware release")  # whatever the result
        self._finish()
        return text(release, 64)

    def inventory(self, source="Source_0", mask=b"", first=0, flags=0):
        """The mask's length goes out in bytes; without a mask its attribute is empty."""
        masked = (pair(At.LENGTH, len(mask)), pair(At.TAG_ID, mask), pair(At.ADDRESS, first)) if mask or flags else ()
        self._exchange(Do.INVENTORY, *((pair(At.SOURCE, source),) if source else ()), *masked,
                       *((pair(At.BITMASK, flags),) if flags else ()))
        tags = []
        while (name := self._bytes(At.SOURCE, 24)) is not None:
            point = self._bytes(At.READ_POINT, 5)  # the copy has room for 5
            when, kind, size = self._number(At.TIME), self._number(At.TAG_TYPE), self._number(At.TAG_ID_LEN)
            epc = self._bytes(At.TAG_ID, 64)
            if None in (point, when, kind, size, epc) or len(epc) != size:
                raise Broken("half a tag")
            rssi = self._number(At.RSSI)  # kept without a sign
            tags.append(Seen(epc.hex().upper(), text(name, 24), text(point, 5), divmod(when, 1 << 32), kind, rssi))
        self._finish()
        return tags

    def read(self, tag, bank, address, length, password=0):
        epc = bytes.fromhex(tag.epc)
        self._exchange(Do.READ, pair(At.SOURCE, tag.source), pair(At.TAG_ID_LEN, len(epc)), pair(At.TAG_ID, epc),
                       pair(At.BANK, bank), pair(At.ADDRESS, address), pair(At.LENGTH, length),
                       *((pair(At.PASSWORD, password),) if password else ()))
        if (data := self._bytes(At.TAG_VALUE, 132)) is None:
            raise Broken("no data")  # the reader's code is lost
        self._finish()
        return data

    def on_tag(self, command, tag, *pairs, password=0):
        """Write, lock and kill; a password of 0 is left out."""
        epc = bytes.fromhex(tag.epc)
        self._exchange(command, pair(At.SOURCE, tag.source), pair(At.TAG_ID_LEN, len(epc)), pair(At.TAG_ID, epc), *pairs,
                       *((pair(At.PASSWORD, password),) if password else ()))
        self._finish()


# --- a C++ library for serial lines (2013 to 2020) ----------------------------------------------------------

class SerialLibrary:
    """Takes attributes wherever they stand, and the result from the last one. Counts its messages, checks no id."""

    def __init__(self, wire):
        self.wire, self._number = wire, 0

    def ask(self, command, *pairs):
        """All attributes of the answer, in order."""
        number, self._number = self._number, (self._number + 1) % 0x10000
        self.wire.send(message(command, *pairs, number=number))
        _, length = read_header(self.wire.take(10))
        return split(self.wire.take(length - 10))

    def get(self, command, *pairs, out=None):
        found = self.ask(command, *pairs)
        if found[-1][0] != At.RESULT:
            raise Broken("the last attribute is no result code")
        if code := int.from_bytes(found[-1][1], "big"):
            raise Refused(code)
        return dict(found)[out] if out else None

    def inventory(self, source="Source_0", mask=b"", flags=RSSI | TID):
        """Always with a mask, even an empty one, whose length it gives in bytes."""
        found = self.ask(Do.INVENTORY, pair(At.SOURCE, source), pair(At.LENGTH, len(mask)), pair(At.TAG_ID, mask),
                         pair(At.ADDRESS, 0), pair(At.BITMASK, flags))
        last, tags = {}, []
        for kind, value in found:
            if kind == At.TAG_ID:  # it uses what came before without asking whether it came
                tags.append(Seen(value.hex().upper(), text(last[At.SOURCE], 30), text(last[At.READ_POINT], 5),
                                 struct.unpack(">II", last[At.TIME]), int.from_bytes(last[At.TAG_TYPE], "big")))
            elif kind == At.TAG_VALUE:
                tags[-1] = tags[-1]._replace(tid=value.hex().upper())
            elif kind == At.RSSI:
                tags[-1] = tags[-1]._replace(rssi=struct.unpack(">h", value)[0])
            last[kind] = value
        if found[-1] != (At.RESULT, b"\0\0"):
            raise Refused(int.from_bytes(found[-1][1], "big"))
        return tags


def split(data):
    """As the Rust codec does it: each attribute whole, nothing left over."""
    found = []
    while data:
        if len(data) < 6:
            raise Broken(f"{len(data)} bytes are no attribute")
        _, length, kind = struct.unpack_from(">HHH", data)
        if not 6 <= length <= len(data):
            raise Broken(f"an attribute of {length} bytes where {len(data)} are left")
        found.append((kind, data[6:length]))
        data = data[length:]
    if not found:
        raise Broken("a message without attributes")
    return found


class RustCodec:
    """Only a codec: refuses messages of more than 4095 bytes."""

    def __init__(self, wire):
        self.wire = wire

    def ask(self, command, *pairs, number=1):
        self.wire.send(message(command, *pairs, number=number))
        answered, length = read_header(self.wire.take(10))
        if answered != number or not 10 < length <= 0xFFF:
            raise Broken(f"message {answered} of {length} bytes")
        return split(self.wire.take(length - 10))


# --- a host of notification channels ------------------------------------------------------------------------

class NotifyHost:
    """Listens for a reader, and takes its reports in whichever form (section 9 leaves the numbers open)."""

    def __init__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(DEADLINE)
        self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self.wire = self._peer = None

    def accept(self):
        self._peer = self._listener.accept()[0]
        self._peer.setblocking(True)
        self.wire = Wire(self._peer.fileno())
        return self

    def hang_up(self):
        self._peer.close()

    def close(self):
        for each in (self._peer, self._listener):
            if each:
                each.close()

    def next(self):
        """The events of a report as (epc, source, event, time), or "kill"."""
        _, length = read_header(self.wire.take(10), (REPLY, REQUEST))
        (kind, value), *rest = split(self.wire.take(length - 10))
        if kind != At.COMMAND or len(value) != 2:
            raise Broken("no message begins like this")
        if not rest:
            return "kill"
        if rest.pop() != (At.RESULT, b"\0\0") or len(rest) % 5:
            raise Broken(f"no report: {rest}")
        events = []
        for i in range(0, len(rest), 5):
            kinds, values = zip(*rest[i:i + 5])
            if kinds != (At.TIME, At.TAG_ID_LEN, At.TAG_ID, At.SOURCE, At.EVENT_TYPE):
                raise Broken(f"not the order of table 3.1: {kinds}")
            if int.from_bytes(values[1], "big") != len(values[2]):
                raise Broken("an id of another length than announced")
            events.append((values[2].hex().upper(), text(values[3], 30), int.from_bytes(values[4], "big"),
                           struct.unpack(">II", values[0])))
        return events
