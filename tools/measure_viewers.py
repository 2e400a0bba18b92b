#!/usr/bin/env python3
"""Measures viewers without a browser: a slow link, and many of whom some do not read.

    tools/measure_viewers.py INPUT|DIR --isovalue V [--viewers N] [--stalled K] [--link MBIT,MS] [--rate N]
                             [--seconds S] [--side PX] [--isoscope PROGRAM]

Starts `isoscope view`, which is gateway, coordinator and agent in one process, and connects N viewers (default 1),
each of which sends 60 views a second, a degree further each, and says at once that it has shown what came. With
--stalled, K of them send views and read nothing; then the other N - K are measured alone first.
With --link every viewer comes through a link of so many Mbit/s and milliseconds of round trip (tools/throttle.py).
Prints JSON: frames a second, age of the frames (from the view sent to its frame received), size of the pictures, the
time from the last view to its exact frame, and the server's memory before and after. Only Python's own library.
"""

import argparse
import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import urllib.parse

from throttle import Link
from viewer import Viewer


def memory_mib(pid):
  """Memory of a process of its own, in MiB."""
  with open(f'/proc/{pid}/smaps_rollup', encoding='ascii') as file:
    return sum(int(line.split()[1]) for line in file if line.startswith(('Private_Dirty:', 'Private_Clean:'))) / 1024


async def stall(viewer, view, seconds):
  """Sends views for so long, and reads nothing."""
  for step in range(round(60 * seconds)):
    viewer.send_state({**view, 'camera': {**view['camera'], 'eye': {**view['camera']['eye'], 'x': step}}})
    await viewer.writer.drain()
    await asyncio.sleep(1 / 60)


async def measure(url, flags, count, stalled_count, server):
  """Drags in `count` viewers, the last `stalled_count` of which do not read, and returns what came."""
  view = {'surfaces': [{'isovalue': flags.isovalue}], 'viewport': {'widthPx': flags.side, 'heightPx': flags.side}}
  async with contextlib.AsyncExitStack() as stack:
    viewers = [await stack.enter_async_context(Viewer(url, 4096 if i >= count - stalled_count else None))
               for i in range(count)]
    fitted = [await viewer.first(view) for viewer in viewers]
    before = memory_mib(server.pid)
    reading = count - stalled_count
    stalls = [asyncio.create_task(stall(viewer, fit, flags.seconds))
              for viewer, fit in zip(viewers[reading:], fitted[reading:])]
    await asyncio.gather(*(viewer.drag(fit, flags.seconds, rate=flags.rate, phase=45 * i)
                           for i, (viewer, fit) in enumerate(zip(viewers[:reading], fitted))))
    after = memory_mib(server.pid)
    for task in stalls:
      task.cancel()
    await asyncio.gather(*stalls, return_exceptions=True)
    figures = [viewer.figures(flags.seconds) for viewer in viewers[:reading]]
  rate = sum(one['framesPerSecond'] for one in figures)
  return {'viewers': count, 'stalled': stalled_count, 'framesPerSecond': round(rate, 1),
          'ofEachReader': round(rate / len(figures), 1), 'serverMiB': {'before': round(before), 'after': round(after)},
          'figures': figures if len(figures) == 1 else figures[:1]}


def bound(flags, figures):
  """Compares the age of the frames with the mark: the round trip and two frames."""
  limit = flags.link[1] + 2000 / figures['framesPerSecond']
  return {'roundTripAndTwoFramesMs': round(limit), 'isWithin': {name: age <= limit for name, age in figures['ageMs'].items()}}


async def run(flags, url, server):
  async with contextlib.AsyncExitStack() as stack:
    if flags.link is not None:
      port = urllib.parse.urlsplit(url).port
      link = await stack.enter_async_context(Link(port, *flags.link))
      url = urllib.parse.urlsplit(url)._replace(netloc=f'127.0.0.1:{link.port}').geturl()
    result = {'readers': await measure(url, flags, flags.viewers - flags.stalled, 0, server)}
    if flags.link is not None:
      result['age'] = bound(flags, result['readers']['figures'][0])
    if flags.stalled > 0:
      result['withStalled'] = await measure(url, flags, flags.viewers, flags.stalled, server)
      result['shareOfTheirRate'] = round(result['withStalled']['ofEachReader'] / result['readers']['ofEachReader'], 2)
    print(json.dumps(result, indent=2))


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument('input')
  parser.add_argument('--isovalue', type=float, required=True)
  parser.add_argument('--viewers', type=int, default=1)
  parser.add_argument('--stalled', type=int, default=0)
  parser.add_argument('--link', type=lambda text: [float(part) for part in text.split(',')], metavar='MBIT,MS')
  parser.add_argument('--rate', type=float, default=30, help='frames a second asked for; 1 keeps the full size')
  parser.add_argument('--seconds', type=float, default=10)
  parser.add_argument('--side', type=int, default=1024, help='pixels of the view on each axis')
  root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
  parser.add_argument('--isoscope', default=os.path.join(root, 'build/release/bin/isoscope'))
  flags = parser.parse_args()
  if not 0 <= flags.stalled < flags.viewers or flags.link is not None and len(flags.link) != 2:
    parser.error('--stalled must be less than --viewers, and --link two numbers, as in 10,150')
  signal.signal(signal.SIGTERM, lambda *_: sys.exit('measure_viewers.py: ended by a signal'))
  server = subprocess.Popen([flags.isoscope, 'view', flags.input, '--listen', '127.0.0.1:0', '--no-open'],
                            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
  try:
    url = server.stdout.readline().strip()
    if not url:
      sys.exit(f'measure_viewers.py: isoscope view {flags.input} did not start; try it by hand')
    asyncio.run(run(flags, url, server))
  finally:
    server.terminate()
    server.wait()


if __name__ == '__main__':
  main()
