"""A network that does something to the bytes between readers and the gateway."""

import asyncio
import itertools
import random
import socket
import struct

from .proxy import Loop, Proxy

ACK_SIZE = 6  # bytes of a Silion acknowledgement without a CRC


class Rough(Proxy):
    """What readers say comes byte by byte, late in the middle, gathered, or only up to a place, where both ends are reset."""

    places = itertools.count(1)  # of the next reset, in the bytes of a connection; all proxies share them

    def __init__(self, target, readers_dial):
        self._readers_dial = readers_dial
        self._held, self._passed = {}, {}
        self.be_smooth()
        self.resets = self.swallowed = self.stalls = self.gathered = self.segments = self.left_out = 0
        super().__init__(target)

    def be_smooth(self):
        self.segment = self.stall = self.gather = self.leave_out = 0
        self.reset = self.deaf = self.twice = False

    async def _write(self, writer, piece, to_target):
        if to_target != self._readers_dial:  # the gateway speaks
            if self.deaf:
                self.swallowed += len(piece)
                return
            await super()._write(writer, piece, to_target)
        elif self.reset:
            await self._up_to_a_place(writer, piece, to_target)
        elif size := self.segment:
            for at in range(0, len(piece), size):
                await super()._write(writer, piece[at:at + size], to_target)
                self.segments += 1
                await asyncio.sleep(0)
        elif self.gather or writer in self._held:  # nothing overtakes what is held
            self._gather(writer, piece)
        elif self.stall and len(piece) > 1 and random.random() < 0.2:
            at = random.randrange(1, len(piece))
            await super()._write(writer, piece[:at], to_target)
            self.stalls += 1
            await asyncio.sleep(self.stall)
            await super()._write(writer, piece[at:], to_target)
        elif self.twice:
            await super()._write(writer, piece * 2, to_target)
        elif self.leave_out and random.random() < self.leave_out:
            self.left_out += 1
        else:
            await super()._write(writer, piece, to_target)

    async def _up_to_a_place(self, writer, piece, to_target):
        if writer not in self._passed:
            self._passed[writer] = [0, next(Rough.places)]
        passed, place = self._passed[writer]
        await super()._write(writer, piece[:place - passed], to_target)
        self._passed[writer][0] += len(piece)
        if passed + len(piece) >= place:
            del self._passed[writer]
            self.resets += 1
            self._reset(writer)
            raise ConnectionResetError

    @staticmethod
    def _reset(writer):
        handle = writer.get_extra_info("socket")
        if handle is not None:
            handle.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        writer.transport.abort()

    def _gather(self, writer, piece):
        if writer in self._held:
            self._held[writer].append(piece)
            return
        self._held[writer] = [piece]

        async def let_go():
            await asyncio.sleep(self.gather)
            pieces = self._held.pop(writer)
            self.gathered = max(self.gathered, len(pieces))
            writer.write(b"".join(pieces))
        Loop.get().create_task(let_go())
