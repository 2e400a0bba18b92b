#!/usr/bin/env python3
"""Viewers of a real `isoscope view`, on links that are slow and with readers that stall: what comes, and how much.

    viewers_test.py ISOSCOPE [unittest arguments]

How fast it is, tools/measure_viewers.py says; here nothing depends on time but how long the test takes.
"""

import asyncio
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import unittest
import urllib.parse
import urllib.request

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..', 'tools'))
from throttle import Link  # noqa: E402
from viewer import Viewer, turned  # noqa: E402

ISOSCOPE = sys.argv.pop(1) if len(sys.argv) > 1 else 'isoscope'
PATIENCE_S = 240  # far above what is needed
SIDE = 512
# Frames under way at a time (InteractiveSchedule::kMaxCredits), and as many whose acknowledgement is on its way.
MOST_UNDER_WAY = 2 * 8


def limited(test):
  """Runs a coroutine of a test to its end, within PATIENCE_S."""
  def run(self):
    asyncio.run(asyncio.wait_for(test(self), PATIENCE_S))
  run.__name__ = test.__name__
  return run


def of_small_pictures(frames):
  """Whether half of the moving pictures have half of the view's height at most."""
  heights = sorted(frame.header['frame']['extent']['heightPx'] for frame in frames if not frame.is_exact)
  return bool(heights) and heights[len(heights) // 2] <= SIDE / 2


class ViewersTest(unittest.TestCase):
  @classmethod
  def setUpClass(cls):
    cls.folder = tempfile.TemporaryDirectory(prefix='isoscope-viewers-')
    volume = os.path.join(cls.folder.name, 'g.nrrd')
    subprocess.run([ISOSCOPE, 'generate', 'gyroid', '--dims', '64,64,64', '--type', 'uint8', '--output', volume], check=True,
                   stdout=subprocess.DEVNULL)
    cls.view = {'surfaces': [{'isovalue': 128}], 'viewport': {'widthPx': SIDE, 'heightPx': SIDE}}
    cls.server = subprocess.Popen([ISOSCOPE, 'view', volume, '--no-open', '--listen', '127.0.0.1:0', '--renderer', 'cpu'],
                                  stdout=subprocess.PIPE, text=True,
                                  env={**os.environ, 'XDG_CACHE_HOME': cls.folder.name})
    cls.url = cls.server.stdout.readline().strip()
    assert cls.url, f'isoscope view {volume} did not start'
    query = urllib.parse.parse_qs(urllib.parse.urlsplit(cls.url).query)
    cls.dataset, cls.token = query['dataset'][0], query['token'][0]

  @classmethod
  def tearDownClass(cls):
    cls.server.terminate()
    cls.server.wait()
    cls.server.stdout.close()
    cls.folder.cleanup()

  def render(self, view):
    """The picture that an ordinary request gets."""
    address = urllib.parse.urljoin(self.url, f'/v1/datasets/{urllib.parse.quote(self.dataset)}/render')
    request = urllib.request.Request(address, data=json.dumps(view).encode(),
                                     headers={'Authorization': f'Bearer {self.token}'})
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
      return reply.read()

  @limited
  async def test_on_a_slow_link_pictures_shrink_no_queue_grows_and_the_last_one_is_exact(self):
    port = urllib.parse.urlsplit(self.url).port
    async with Link(port, mbit=0.5, round_trip_ms=80, up_mbit=20) as link, \
        Viewer(f'http://127.0.0.1:{link.port}/?token={self.token}') as viewer:
      first = await viewer.first(self.view)
      view, exact, sent_before = *await viewer.drag(first, seconds=4), 0
      # A busy machine may draw too few pictures for the link to be known.
      while not of_small_pictures(viewer.frames):
        sent_before = viewer.sequence
        view, exact = await viewer.drag(view, seconds=4)
      moving = [frame for frame in viewer.frames if not frame.is_exact]
      self.assertEqual(sorted(frame.sequence for frame in moving), [frame.sequence for frame in moving], 'a frame came late')
      self.assertLess(len(moving), (viewer.sequence - sent_before) / 2, 'each state was drawn: none was replaced by a newer one')
      late = [frame for frame in moving if frame.arrived_at > viewer.sent_at[exact.sequence]]
      self.assertLessEqual(len(late), MOST_UNDER_WAY, 'more frames were on the way than have a credit')
      self.assertTrue(exact.image == self.render(view), 'the exact frame is not that of RenderIsosurface')

  @limited
  async def test_of_eight_viewers_the_one_that_does_not_read_holds_nobody_up_and_nothing_piles_up_for_it(self):
    async with contextlib.AsyncExitStack() as stack:
      viewers = [await stack.enter_async_context(Viewer(self.url)) for _ in range(7)]
      stalled = await stack.enter_async_context(Viewer(self.url, read_buffer_bytes=4096))
      fitted = [await viewer.first(self.view) for viewer in [*viewers, stalled]]
      stalled.frames.clear()

      async def only_send():
        for step in range(180):
          stalled.send_state({**fitted[-1], 'camera': turned(fitted[-1]['camera'], 0.02 * step)})
          await asyncio.sleep(1 / 60)

      ends = (await asyncio.gather(*(viewer.drag(view, seconds=3, phase=45 * i)
                                     for i, (viewer, view) in enumerate(zip(viewers, fitted))), only_send()))[:-1]
      for view, exact in ends:
        self.assertTrue(exact.image == self.render(view), 'the exact frame is not that of RenderIsosurface')
      # It reads again: the answer to what it asked last comes, and few before it.
      last = {**fitted[-1], 'camera': turned(fitted[-1]['camera'], 1)}
      exact = await stalled.read_exact(stalled.send_state(last))
      self.assertTrue(exact.image == self.render(last))
      self.assertLess(len(stalled.frames), 180 / 4, 'frames were kept for a viewer that does not read')


if __name__ == '__main__':
  unittest.main()
