"""The process between the parties: one listening port for each link, which passes bytes on, or worse.

    proxy.py

Commands come as lines of JSON on standard input, each is answered by one on standard output:

    {"do": "open", "link": NAME, "port": PORT, "to": PORT}     {"ok": true}
    {"do": "set", "link": NAME, "delay_s": S, ...}             sets all that is named below; the rest is as it was
    {"do": "cut", "link": NAME}                                resets all connections
    {"do": "counts"}                                           {"ok": true, "flipped": {NAME: BITS}, ...}

    refuse        true: new connections are reset
    stalled       true: connections stay, no byte moves
    delay_s       each piece of data waits so long
    bytes_per_s   at most so many bytes a second, each way of each connection; 0: no limit
    flip_every    a bit flips every so many bytes in the mean; 0: none
    seed          of the places of these bits

It ends when standard input does, and so with the harness.
"""

import asyncio
import json
import random
import socket
import struct
import sys

PIECE = 16384


class Corrupter:
    """Flips a bit every `every` bytes in the mean, at places that `seed` decides."""

    def __init__(self, every, seed):
        self._chance = random.Random(seed)
        self._rate = 1.0 / every
        self._next = self._chance.expovariate(self._rate)
        self.flipped = 0

    def __call__(self, data):
        """Returns `data` with bits flipped; counts them."""
        if self._next >= len(data):
            self._next -= len(data)
            return data
        data = bytearray(data)
        while self._next < len(data):
            data[int(self._next)] ^= 1 << self._chance.randrange(8)
            self.flipped += 1
            self._next += 1 + self._chance.expovariate(self._rate)
        self._next -= len(data)
        return bytes(data)


class Link:
    """One listening port and its connections."""

    def __init__(self, name, to):
        self.name, self.to = name, to
        self.refuse, self.delay_s, self.bytes_per_s = False, 0.0, 0.0
        self.flowing = asyncio.Event()
        self.flowing.set()
        self.corrupter = None
        self.flipped = 0
        self.moved = 0
        self.writers = set()

    def set(self, values):
        self.refuse = bool(values.get("refuse", self.refuse))
        self.delay_s = float(values.get("delay_s", self.delay_s))
        self.bytes_per_s = float(values.get("bytes_per_s", self.bytes_per_s))
        if "stalled" in values:
            (self.flowing.clear if values["stalled"] else self.flowing.set)()
        if "flip_every" in values:
            every = float(values["flip_every"])
            self.corrupter = Corrupter(every, values.get("seed", 0)) if every > 0 else None

    def cut(self):
        for writer in list(self.writers):
            reset(writer)

    async def serve(self, reader, writer):
        if self.refuse:
            reset(writer)
            return
        self.writers.add(writer)
        other_writer = None
        try:
            other_reader, other_writer = await asyncio.open_connection("127.0.0.1", self.to)
            self.writers.add(other_writer)
            ways = [
                asyncio.ensure_future(self.pump(reader, other_writer)),
                asyncio.ensure_future(self.pump(other_reader, writer)),
            ]
            # Whichever end closes, both do: gRPC does not use half-closed connections.
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
        except OSError:
            pass
        finally:
            for end in filter(None, (writer, other_writer)):
                self.writers.discard(end)
                reset(end)

    async def pump(self, reader, writer):
        try:
            while data := await reader.read(PIECE):
                await self.flowing.wait()
                if self.delay_s:
                    await asyncio.sleep(self.delay_s)
                if self.bytes_per_s:
                    await asyncio.sleep(len(data) / self.bytes_per_s)
                if self.corrupter:
                    before = self.corrupter.flipped
                    data = self.corrupter(data)
                    self.flipped += self.corrupter.flipped - before
                self.moved += len(data)
                writer.write(data)
                await writer.drain()
        except OSError:
            pass


def reset(writer):
    """Closes with a reset: data under way are lost, as when a machine dies."""
    sock = writer.get_extra_info("socket")
    if sock is not None:
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        except OSError:
            pass
    writer.transport.abort()


class Proxy:
    def __init__(self):
        self.links = {}

    async def obey(self, command):
        do = command.pop("do")
        if do == "counts":
            return {
                "ok": True,
                "flipped": {name: link.flipped for name, link in self.links.items()},
                "moved": {name: link.moved for name, link in self.links.items()},
            }
        name = command.pop("link")
        if do == "open":
            link = Link(name, command["to"])
            await asyncio.start_server(link.serve, "127.0.0.1", command["port"])
            self.links[name] = link
        elif do == "set":
            self.links[name].set(command)
        elif do == "cut":
            self.links[name].cut()
        else:
            raise ValueError(f"no command: {do}")
        return {"ok": True}

    async def run(self):
        loop = asyncio.get_running_loop()
        commands = asyncio.StreamReader()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(commands), sys.stdin)
        while line := await commands.readline():
            try:
                answer = await self.obey(json.loads(line))
            except (OSError, ValueError, KeyError) as error:
                answer = {"ok": False, "error": f"{line!r}: {error!r}"}
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    asyncio.run(Proxy().run())
