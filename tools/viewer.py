"""A viewer without a browser: it speaks to the gateway as the page does, and decodes nothing.

    async with Viewer(url) as viewer:
      await viewer.drag(state, seconds=10)
      print(viewer.figures())

Only Python's own library. For tools/measure_viewers.py and tests/integration/viewers_test.py.
"""

import asyncio
import base64
import dataclasses
import json
import math
import os
import struct
import time
import urllib.parse


@dataclasses.dataclass
class Frame:
  """A frame that came. Times are those of time.monotonic()."""
  number: int
  sequence: int
  is_exact: bool
  image: bytes
  bytes: int  # of the whole message
  header: dict
  arrived_at: float
  age_s: float  # since its state was sent


def percentile(values, share):
  """Returns the value below which `share` of the values lie; None of none."""
  ordered = sorted(values)
  return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else None


def turned(camera, angle):
  """Returns the camera turned about its up vector, through its target, by an angle in radians."""
  def vec(name):
    return [float(camera.get(name, {}).get(axis, 0)) for axis in 'xyz']
  eye, target, up = vec('eye'), vec('target'), vec('up')
  size = math.sqrt(sum(value * value for value in up))
  up = [value / size for value in up]
  arm = [a - b for a, b in zip(eye, target)]
  along = sum(a * b for a, b in zip(arm, up))
  across = [up[1] * arm[2] - up[2] * arm[1], up[2] * arm[0] - up[0] * arm[2], up[0] * arm[1] - up[1] * arm[0]]
  c, s = math.cos(angle), math.sin(angle)
  moved = [t + c * a + s * x + (1 - c) * along * u for t, a, x, u in zip(target, arm, across, up)]
  return {**camera, 'eye': dict(zip('xyz', moved))}


def nearer(camera, factor):
  """Returns the camera at 1 / factor of its distance from the target."""
  return {**camera, 'eye': {axis: float(camera.get('target', {}).get(axis, 0)) +
                            (float(camera.get('eye', {}).get(axis, 0)) - float(camera.get('target', {}).get(axis, 0))) / factor
                            for axis in 'xyz'}}


class Viewer:
  """One WebSocket to a gateway. Not thread-safe; one event loop."""

  def __init__(self, url, read_buffer_bytes=None):
    """`url`: of the page, with its token if it has one. `read_buffer_bytes`: of the socket, for a viewer that stalls."""
    self.address = urllib.parse.urlsplit(url)
    self.read_buffer_bytes = read_buffer_bytes
    self.sequence = 0
    self.sent_at = {}
    self.frames = []
    self.reader = self.writer = None

  async def __aenter__(self):
    self.reader, self.writer = await asyncio.open_connection(
        self.address.hostname, self.address.port, limit=self.read_buffer_bytes or 2 ** 16)
    token = urllib.parse.parse_qs(self.address.query).get('token')
    path = '/v1/interact'
    bearer = f'Authorization: Bearer {token[0]}\r\n' if token else ''
    key = base64.b64encode(os.urandom(16)).decode()
    self.writer.write((f'GET {path} HTTP/1.1\r\nHost: {self.address.netloc}\r\nUpgrade: websocket\r\n{bearer}'
                       f'Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n').encode())
    status = (await self.reader.readuntil(b'\r\n\r\n')).split(b'\r\n')[0].decode()
    if ' 101 ' not in status:
      raise ConnectionError(f'{self.address.netloc}{path} answers a WebSocket with: {status}')
    return self

  async def __aexit__(self, *_):
    self.writer.close()

  def write(self, opcode, payload):
    size = len(payload)
    head = bytes([0x80 | opcode]) + (bytes([0x80 | size]) if size < 126 else struct.pack('>BH', 0xFE, size)
                                     if size < 65536 else struct.pack('>BQ', 0xFF, size))
    # The mask is for proxies; of zeros it costs nothing.
    self.writer.write(head + bytes(4) + payload)

  def send(self, message):
    self.write(1, json.dumps(message).encode())

  def send_state(self, frame, rate=30):
    """Sends a view, a RenderIsosurfaceRequest as JSON, and returns its number."""
    self.sequence += 1
    self.sent_at[self.sequence] = time.monotonic()
    self.send({'viewState': {'sequenceNumber': str(self.sequence), 'frame': frame, 'targetFramesPerSecond': rate}})
    return self.sequence

  async def read_message(self):
    """Returns the next binary message. Raises ConnectionError with the reason if the gateway closes."""
    whole = b''
    while True:
      first, second = await self.reader.readexactly(2)
      size = second & 127
      if size >= 126:
        size = int.from_bytes(await self.reader.readexactly(2 if size == 126 else 8), 'big')
      payload = await self.reader.readexactly(size)
      opcode = first & 15
      if opcode == 8:
        raise ConnectionError(f'the gateway closed: {payload[2:].decode(errors="replace")}')
      if opcode == 9:
        self.write(10, payload)
        continue
      whole += payload
      if first & 0x80:
        return whole

  async def read(self):
    """Returns the next frame, and acknowledges it. Raises RuntimeError with the server's message if it failed."""
    message = await self.read_message()
    json_size = struct.unpack('<I', message[:4])[0]
    header = json.loads(message[4:4 + json_size])
    image_size = header['image']['bytes']
    sequence, number = int(header.get('sequenceNumber', 0)), int(header.get('frameNumber', 0))
    now = time.monotonic()
    self.send({'frameShown': {'frameNumber': str(number), 'decodeDuration': '0s'}})
    if 'error' in header:
      raise RuntimeError(header['error'].get('message', 'the frame failed without a reason'))
    frame = Frame(number, sequence, header.get('isExact', False), message[4 + json_size:4 + json_size + image_size],
                  len(message), header, now, now - self.sent_at.get(sequence, now))
    self.frames.append(frame)
    return frame

  async def read_exact(self, sequence):
    """Reads on until the exact frame of a state has come, and returns it."""
    while True:
      frame = await self.read()
      if frame.is_exact and frame.sequence == sequence:
        return frame

  async def first(self, frame, zoom=1):
    """Shows `frame`, fitted to the surface, and returns it with the camera that the server chose, nearer by `zoom`."""
    fitted = {**frame, 'cameraFit': 'CAMERA_FIT_SURFACE'}
    exact = await self.read_exact(self.send_state(fitted))
    return {**frame, 'camera': nearer(exact.header['frame']['camera'], zoom)}

  async def drag(self, frame, seconds, states_per_second=60, rate=30, degrees=1, phase=0):
    """Turns a view by `degrees` with each state, and returns once the exact frame of the last state has come."""
    last = None
    end = time.monotonic() + seconds

    async def send():
      nonlocal last
      step, start = 0, time.monotonic()
      while time.monotonic() < end:
        step += 1
        view = {**frame, 'camera': turned(frame['camera'], math.radians(phase + degrees * step))}
        sequence = self.send_state(view, rate)
        await self.writer.drain()
        await asyncio.sleep(max(0, start + step / states_per_second - time.monotonic()))
      last = (sequence, view)

    self.frames.clear()
    sender = asyncio.create_task(send())
    try:
      while True:
        frame_shown = await self.read()
        if last is not None and frame_shown.is_exact and frame_shown.sequence == last[0]:
          return last[1], frame_shown
    finally:
      sender.cancel()

  def figures(self, seconds):
    """Returns what a drag of `seconds` showed: frames a second, age in milliseconds, sizes."""
    moving = [frame for frame in self.frames if not frame.is_exact]
    ages = [1000 * frame.age_s for frame in moving]
    heights = [int(frame.header['frame']['extent']['heightPx']) for frame in moving]
    return {'framesPerSecond': round(len(moving) / seconds, 1),
            'ageMs': {'p50': round(percentile(ages, 0.5) or 0), 'p95': round(percentile(ages, 0.95) or 0)},
            'heightPx': percentile(heights, 0.5),
            'pictureKib': round((percentile([len(frame.image) for frame in moving], 0.5) or 0) / 1024, 1),
            'messageKib': round((percentile([frame.bytes for frame in moving], 0.5) or 0) / 1024, 1),
            'exactAfterMs': round(1000 * self.frames[-1].age_s)}
