"""A TCP proxy on loopback that can be a bad network: stopped without a word, cut, refused. One thread serves all."""

import asyncio
import socket
import struct
import threading

PIECE = 256 << 10


class Loop:
    """The thread that all proxies share."""

    _loop = None
    _lock = threading.Lock()

    @classmethod
    def get(cls):
        with cls._lock:
            if cls._loop is None:
                cls._loop = asyncio.new_event_loop()
                threading.Thread(target=cls._loop.run_forever, daemon=True).start()
        return cls._loop

    @classmethod
    def run(cls, coroutine):
        return asyncio.run_coroutine_threadsafe(coroutine, cls.get()).result(60)


class Proxy:
    """Stands in front of a port of 127.0.0.1. While it is `stalled` no byte passes and no connection gets through, and
    nobody is told: as behind a switch without power. What was said meanwhile passes afterwards, if both still want it."""

    def __init__(self, target, port=0):
        self.target = target
        self._port, self._server, self._writers = port, None, set()
        self._clear = None
        Loop.run(self._begin())

    async def _begin(self):
        self._clear = asyncio.Event()
        self._clear.set()
        await self._listen()

    async def _listen(self):
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self._port, limit=PIECE)
        self._port = self._server.sockets[0].getsockname()[1]

    @property
    def port(self):
        return self._port

    async def _serve(self, reader, writer):
        self._writers.add(writer)
        other = None
        try:
            await self._clear.wait()
            to_reader, other = await asyncio.open_connection("127.0.0.1", self.target, limit=PIECE)
            self._writers.add(other)
            for each in (writer, other):
                each.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            done, pending = await asyncio.wait([asyncio.ensure_future(self._pass(reader, other, True)),
                                                asyncio.ensure_future(self._pass(to_reader, writer, False))])
            for each in done | pending:
                each.exception()
        except OSError:
            pass  # nobody is there: the client sees a close
        finally:
            for each in (writer, other):
                if each is not None:
                    self._writers.discard(each)
                    each.close()

    async def _write(self, writer, piece, to_target):
        writer.write(piece)
        await writer.drain()

    async def _pass(self, reader, writer, to_target):
        try:
            while True:
                await self._clear.wait()
                piece = await reader.read(PIECE)
                await self._clear.wait()
                if not piece:
                    break
                await self._write(writer, piece, to_target)
        except OSError:
            pass
        finally:
            try:
                writer.close()
            except OSError:
                pass

    def stall(self):
        Loop.run(self._set(False))

    def heal(self):
        Loop.run(self._set(True))

    async def _set(self, clear):
        if clear:
            self._clear.set()
        else:
            self._clear.clear()

    def cut(self):
        """Every connection is reset; new ones are welcome."""
        Loop.run(self._cut())

    async def _cut(self):
        for each in list(self._writers):
            handle = each.get_extra_info("socket")
            if handle is not None:
                try:
                    handle.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                except OSError:
                    pass  # it has just been closed
            each.transport.abort()

    def refuse(self):
        """Nobody listens any more, and every connection is reset."""
        Loop.run(self._refuse())

    async def _refuse(self):
        if self._server:
            self._server.close()
            self._server = None
        await self._cut()

    def welcome(self):
        async def listen():
            if self._server is None:
                await self._listen()
        Loop.run(listen())

    def close(self):
        Loop.run(self._refuse())
