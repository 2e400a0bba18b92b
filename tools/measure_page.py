#!/usr/bin/env python3
"""Measures the page as a person sees it: frames shown while a view is dragged, and how late they are.

    tools/measure_page.py INPUT|DIR --isovalue V [--rate N] [--seconds S] [--side PX] [--minutes M]
                          [--isoscope PROGRAM]

Starts `isoscope view`, opens its page in Chromium without a screen, and drags the view on a circle with a
pointer event every 16 ms. Browser, gateway, coordinator and agents share this machine. Prints JSON:

  framesPerSecond, latencyMs   pictures shown while it is dragged; from the pointer's event to each of them
  exactAfterMs                 from the pointer's release to the exact picture
  deliveryMs                   of single moves with nothing else to do: from the state sent to the picture decoded,
                               without the time of drawing, so encoding, transport and decoding
  cpuMsPerFrame, memoryMiB     by kind of process. A page that n processes share counts 1/n in each
  pageMiB                      memory of all of Chromium's processes, less that with an empty page

With --minutes it drags for so long, and says every half a minute how much memory there is. Needs chromium,
chromium-driver and python3-selenium: run it with Debian's /usr/bin/python3.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

PATIENCE_S = 120

# Resolves when the drag has ended and the exact frame is shown.
DRAG = """
const [seconds, done] = arguments;
const view = isoscope.view;
const box = view.root.getBoundingClientRect();
const send = (type, x, y) => view.root.dispatchEvent(new PointerEvent(type, {
  bubbles: true, cancelable: true, pointerId: 1, pointerType: 'mouse', isPrimary: true, button: type === 'pointermove' ? -1 : 0,
  buttons: type === 'pointerup' ? 0 : 1, clientX: x, clientY: y }));
const centre = [box.left + box.width / 2, box.top + box.height / 2];
let before = null;
const first = view.stats().framesShown;
const start = performance.now();
send('pointerdown', ...centre);
const timer = setInterval(() => {
  const t = (performance.now() - start) / 1000;
  const at = [centre[0] + 150 * Math.sin(t), centre[1] + 100 * Math.sin(0.7 * t)];
  send('pointermove', ...at);
  if (before === null && t > 1) before = { time: performance.now(), frames: view.stats().framesShown };
  if (t < seconds + 1) return;
  clearInterval(timer);
  const end = performance.now();
  const stats = view.stats();
  send('pointerup', ...at);
  const wait = setInterval(() => {
    if (!view.isExact) return;
    clearInterval(wait);
    done({ framesInAll: view.stats().framesShown - first, framesPerSecond: 1000 * (stats.framesShown - before.frames) / (end - before.time),
      latencyMs: stats.latencyMs, localResponseMs: stats.localResponseMs, roundTripMs: stats.roundTripMs,
      decodeMs: stats.decodeMs, renderer: stats.renderer, width: stats.width, height: stats.height,
      exactAfterMs: performance.now() - end });
  }, 5);
}, 16);
"""


# Resolves with a number for each of 40 single moves: what the picture took besides drawing.
DELIVERY = """
const [done] = arguments;
const view = isoscope.view;
const STEPS = ['occluderSelectionDuration', 'occluderRenderingDuration', 'visibilityCullingDuration', 'compositeDuration'];
const taken = [];
const move = () => view.setCamera({ ...view.camera, up: view.camera.up.map((value, i) => value + 1e-3 * Math.sin(taken.length + i)) });
let timer = 0;
const listen = ({ detail }) => {
  // After an exact picture, too: a quick one that came just before it was not shown.
  clearTimeout(timer);
  timer = setTimeout(move, 50);
  if (detail.isExact || detail.roundTripMs === null) return;
  const durations = detail.header.frame.statistics.durations;
  const drawn = STEPS.reduce((sum, name) => sum + 1000 * parseFloat(durations[name] ?? '0'), 0);
  const encode = 1000 * parseFloat(durations.encodeDuration ?? '0');
  taken.push([detail.roundTripMs + detail.decodeMs - drawn, encode, detail.decodeMs, detail.roundTripMs - drawn - encode]);
  if (taken.length < 40) return;
  clearTimeout(timer);
  view.removeEventListener('frame', listen);
  const summary = ['all', 'encode', 'decode', 'transport'].map((name, i) => {
    const sorted = taken.map((one) => one[i]).sort((a, b) => a - b);
    return [name, { p50: sorted[20], p95: sorted[38] }];
  });
  done(Object.fromEntries(summary));
};
view.addEventListener('frame', listen);
move();
"""


def processes_of(pid):
  """Yields (kind, process number) of a process and all that it started; Chromium names its kinds."""
  children = {}
  for name in filter(str.isdigit, os.listdir('/proc')):
    try:
      with open(f'/proc/{name}/stat') as file:
        children.setdefault(int(file.read().rsplit(')', 1)[1].split()[1]), []).append(int(name))
    except (OSError, IndexError, ValueError):
      continue
  todo = [pid]
  while todo:
    one = todo.pop()
    todo += children.get(one, [])
    try:
      with open(f'/proc/{one}/cmdline') as file:
        words = file.read().replace('\0', ' ').split()
    except OSError:
      continue
    kind = next((word[len('--type='):] for word in words if word.startswith('--type=')), '')
    name = os.path.basename(words[0]) if words else ''
    yield kind if kind else 'browser' if name == 'chromium' else name, one


def cpu_ms(pid):
  """Processor time by kind of process, in milliseconds."""
  times = {}
  for kind, one in processes_of(pid):
    try:
      with open(f'/proc/{one}/stat') as file:
        fields = file.read().rsplit(')', 1)[1].split()
    except OSError:
      continue
    times[kind] = times.get(kind, 0) + (int(fields[11]) + int(fields[12])) * 1000 / os.sysconf('SC_CLK_TCK')
  return times


def memory_mib(pid):
  """Memory by kind of process, in MiB; a page that n processes share counts 1/n in each."""
  shares = {}
  for kind, one in processes_of(pid):
    try:
      with open(f'/proc/{one}/smaps_rollup') as file:
        share = sum(int(line.split()[1]) for line in file if line.startswith('Pss:'))
    except (OSError, IndexError, ValueError):
      continue
    shares[kind] = shares.get(kind, 0) + share / 1024
  return shares


def total(shares):
  return round(sum(share for kind, share in shares.items() if kind != 'chromedriver'))


def remember(browser, driver, flags, empty_mib):
  """Drags for minutes, and returns the memory after each half."""
  curve = []
  for half in range(round(2 * flags.minutes)):
    begin = time.monotonic()
    shown = browser.execute_async_script(DRAG, 25)
    heap = browser.execute_script('return performance.memory.usedJSHeapSize') / 2 ** 20
    shares = memory_mib(driver.process.pid)
    curve.append({'minutes': (half + 1) / 2, 'pageMiB': total(shares) - empty_mib, 'renderer': round(shares.get('renderer', 0)),
                  'jsHeapMiB': round(heap, 1), 'framesPerSecond': round(shown['framesPerSecond'], 1)})
    print(json.dumps(curve[-1]), file=sys.stderr, flush=True)
    time.sleep(max(0, begin + 30 - time.monotonic()))
  return curve


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument('input')
  parser.add_argument('--isovalue', required=True)
  parser.add_argument('--rate', type=float, default=30, help='frames a second asked for; 1 keeps the full size')
  parser.add_argument('--seconds', type=float, default=10)
  parser.add_argument('--minutes', type=float, default=0, help='drags for so long, for the memory')
  parser.add_argument('--side', type=int, default=1024, help='pixels of the view on each axis')
  root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
  parser.add_argument('--isoscope', default=os.path.join(root, 'build/release/bin/isoscope'))
  flags = parser.parse_args()

  signal.signal(signal.SIGTERM, lambda *_: sys.exit('measure_page.py: ended by a signal'))
  server = subprocess.Popen([flags.isoscope, 'view', flags.input, '--isovalue', flags.isovalue, '--no-open'],
                            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
  browser = None
  try:
    url = server.stdout.readline().strip()
    if not url:
      sys.exit(f'measure_page.py: isoscope view {flags.input} did not start; try it by hand')
    options = Options()
    options.binary_location = '/usr/bin/chromium'
    for argument in ('--headless=new', '--no-sandbox', '--disable-dev-shm-usage', '--force-device-scale-factor=1'):
      options.add_argument(argument)
    driver = Service('/usr/bin/chromedriver')
    browser = webdriver.Chrome(service=driver, options=options)
    browser.set_script_timeout(flags.seconds + PATIENCE_S)
    browser.set_window_size(flags.side + 400, flags.side + 300)
    browser.get('about:blank')
    time.sleep(1)
    empty_mib = total(memory_mib(driver.process.pid))
    page, words = url.split('&dataset=')
    # The wait for the exact picture ends only without limits.
    browser.get(f'{page}#surface={flags.isovalue}&dataset={words.split("&")[0]}&exact-limit=none,none&fit=surface')
    end = time.monotonic() + PATIENCE_S
    while not browser.execute_script('return window.isoscope && isoscope.view.isExact'):
      if time.monotonic() > end:
        sys.exit('measure_page.py: no exact picture came: ' + browser.execute_script('return document.body.innerText'))
      time.sleep(0.1)
    shown = browser.execute_script('return isoscope.view.state.surfaces[0].isovalue')
    if shown != float(flags.isovalue):
      sys.exit(f'measure_page.py: the page shows the isovalue {shown} in place of {flags.isovalue}')
    browser.execute_script('const v = document.getElementById("view"); v.style.width = v.style.height = arguments[0] + "px";'
                           'v.style.flex = "none"; isoscope.view.options.targetFramesPerSecond = arguments[1];',
                           flags.side, flags.rate)
    time.sleep(1)
    before = {**cpu_ms(driver.process.pid), **cpu_ms(server.pid)}
    result = browser.execute_async_script(DRAG, flags.seconds)
    after = {**cpu_ms(driver.process.pid), **cpu_ms(server.pid)}
    result['cpuMsPerFrame'] = {kind: round((after[kind] - before.get(kind, 0)) / result['framesInAll'], 1) for kind in after}
    shares = memory_mib(driver.process.pid)
    result['memoryMiB'] = {kind: round(share) for kind, share in shares.items()}
    result['pageMiB'] = total(shares) - empty_mib
    result['deliveryMs'] = browser.execute_async_script(DELIVERY)
    if flags.minutes > 0:
      result['memory'] = remember(browser, driver, flags, empty_mib)
    print(json.dumps(result, indent=2))
  finally:
    if browser is not None:
      browser.quit()
    server.terminate()
    server.wait()


if __name__ == '__main__':
  main()
