#!/usr/bin/env python3
"""A slow link: a TCP proxy that delays and throttles, for measurements and tests.

    tools/throttle.py UPSTREAM_PORT [--listen PORT] [--mbit N] [--round-trip MS] [--queue KIB]

Each direction has a rate, half of the round trip, and a router's queue; all connections share them. What does not
fit the queue is not read, so that the sender feels it. Loopback only. Only Python's own library.
"""

import argparse
import asyncio
import socket

PIECE_BYTES = 4096  # at least; of a fast link what it carries in PIECE_S
PIECE_S = 0.001
# The sockets at both ends must hold less than the link does; by default the kernel would buffer megabytes.
SOCKET_PIECES = 4


class Direction:
  """One direction of the link: says when a piece has passed it."""

  def __init__(self, mbit, round_trip_ms, queue_kib):
    self.seconds_per_byte = 8 / (mbit * 1e6)
    self.piece_bytes = max(PIECE_BYTES, int(PIECE_S / self.seconds_per_byte))
    self.delay_s = round_trip_ms / 2000
    self.queue_s = queue_kib * 1024 * self.seconds_per_byte
    self.busy_until = 0.0
    self.bytes = 0

  async def send(self, size):
    """Waits for room in the queue, and returns when `size` bytes arrive at the other end."""
    loop = asyncio.get_running_loop()
    while self.busy_until - loop.time() > self.queue_s:
      await asyncio.sleep(self.busy_until - loop.time() - self.queue_s)
    self.busy_until = max(self.busy_until, loop.time()) + size * self.seconds_per_byte
    self.bytes += size
    return self.busy_until + self.delay_s


class Link:
  """The proxy. `port` is the one that it listens on; use it as an async context manager."""

  def __init__(self, upstream_port, mbit=10, round_trip_ms=150, queue_kib=64, port=0, up_mbit=None):
    """`mbit` is the rate towards the client; and from it, unless `up_mbit` says otherwise."""
    self.upstream_port = upstream_port
    self.port = port
    self.up = Direction(up_mbit or mbit, round_trip_ms, queue_kib)
    self.down = Direction(mbit, round_trip_ms, queue_kib)
    self.server = None
    self.tasks = set()

  async def __aenter__(self):
    self.server = await asyncio.start_server(self.accept, '127.0.0.1', self.port)
    self.port = self.server.sockets[0].getsockname()[1]
    return self

  async def __aexit__(self, *_):
    self.server.close()
    for task in list(self.tasks):
      task.cancel()
    await asyncio.gather(*self.tasks, return_exceptions=True)

  async def accept(self, reader, writer):
    self.tasks.add(asyncio.current_task())
    upstream = socket.socket()
    upstream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_PIECES * self.down.piece_bytes)
    upstream.setblocking(False)
    up_writer = None
    try:
      await asyncio.get_running_loop().sock_connect(upstream, ('127.0.0.1', self.upstream_port))
      up_reader, up_writer = await asyncio.open_connection(sock=upstream, limit=self.down.piece_bytes)
      await asyncio.gather(pump(reader, up_writer, self.up), pump(up_reader, writer, self.down))
    except (ConnectionError, asyncio.CancelledError):
      pass  # one side has gone, and so does the other
    finally:
      self.tasks.discard(asyncio.current_task())
      for one in (writer, up_writer):
        if one is not None:
          one.close()


async def pump(reader, writer, direction):
  """Passes bytes on, until the reader ends."""
  on_the_way = asyncio.Queue()  # bounded by the queue and the delay

  async def put():
    while True:
      data = await reader.read(direction.piece_bytes)
      if not data:
        await on_the_way.put((asyncio.get_running_loop().time() + direction.delay_s, data))
        return
      await on_the_way.put((await direction.send(len(data)), data))

  async def take():
    while True:
      at, data = await on_the_way.get()
      await asyncio.sleep(max(0, at - asyncio.get_running_loop().time()))
      if not data:
        writer.close()
        return
      writer.write(data)
      await writer.drain()

  await asyncio.gather(put(), take())


async def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument('upstream_port', type=int)
  parser.add_argument('--listen', type=int, default=0, help='default: a free port')
  parser.add_argument('--mbit', type=float, default=10, help='Mbit/s of each direction (default: 10)')
  parser.add_argument('--round-trip', type=float, default=150, help='milliseconds (default: 150)')
  parser.add_argument('--queue', type=float, default=64, help='KiB of the queue of each direction (default: 64)')
  flags = parser.parse_args()
  async with Link(flags.upstream_port, flags.mbit, flags.round_trip, flags.queue, flags.listen) as link:
    print(f'http://127.0.0.1:{link.port}/', flush=True)
    await link.server.serve_forever()


if __name__ == '__main__':
  try:
    asyncio.run(main())
  except KeyboardInterrupt:
    pass
