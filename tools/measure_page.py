#!/usr/bin/env python3
"""Measures the page as a person sees it: frames shown while a view is dragged, and how late they are.

    tools/measure_page.py INPUT|DIR --isovalue V [--rate N] [--seconds S] [--side PX] [--isoscope PROGRAM]

Starts `isoscope view`, opens its page in Chromium without a screen, and drags the view on a circle with a
pointer event every 16 ms. Browser, gateway, coordinator and agents share this machine. Prints JSON: frames a
second, milliseconds from pointer to displayed, from release to the exact frame, and the memory of all of
Chromium's processes. Needs chromium, chromium-driver and python3-selenium.
"""

import argparse
import json
import os
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
    done({ framesPerSecond: 1000 * (stats.framesShown - before.frames) / (end - before.time),
      latencyMs: stats.latencyMs, localResponseMs: stats.localResponseMs, roundTripMs: stats.roundTripMs,
      decodeMs: stats.decodeMs, renderer: stats.renderer, width: stats.width, height: stats.height,
      exactAfterMs: performance.now() - end });
  }, 5);
}, 16);
"""


def memory_mib(pid):
  """Resident memory of a process and all that it started, in MiB; shared pages count in each."""
  children = {}
  for name in filter(str.isdigit, os.listdir('/proc')):
    try:
      with open(f'/proc/{name}/stat') as file:
        parent = int(file.read().rsplit(')', 1)[1].split()[1])
      with open(f'/proc/{name}/smaps_rollup') as file:
        share = sum(int(line.split()[1]) for line in file if line.startswith('Pss:'))
    except (OSError, IndexError, ValueError):
      continue
    children.setdefault(parent, []).append((int(name), share))
  todo, total = [pid], 0
  while todo:
    for child, share in children.get(todo.pop(), []):
      todo.append(child)
      total += share
  return total / 1024


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument('input')
  parser.add_argument('--isovalue', required=True)
  parser.add_argument('--rate', type=float, default=30, help='frames a second asked for; 1 keeps the full size')
  parser.add_argument('--seconds', type=float, default=10)
  parser.add_argument('--side', type=int, default=1024, help='pixels of the view on each axis')
  root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
  parser.add_argument('--isoscope', default=os.path.join(root, 'build/release/bin/isoscope'))
  flags = parser.parse_args()

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
    browser.get(url)
    end = time.monotonic() + PATIENCE_S
    while not browser.execute_script('return window.isoscope && isoscope.view.isExact'):
      if time.monotonic() > end:
        sys.exit('measure_page.py: no exact picture came: ' + browser.execute_script('return document.body.innerText'))
      time.sleep(0.1)
    browser.execute_script('const v = document.getElementById("view"); v.style.width = v.style.height = arguments[0] + "px";'
                           'v.style.flex = "none"; isoscope.view.options.targetFramesPerSecond = arguments[1];',
                           flags.side, flags.rate)
    time.sleep(1)
    result = browser.execute_async_script(DRAG, flags.seconds)
    result['chromiumMiB'] = round(memory_mib(driver.process.pid))
    print(json.dumps(result, indent=2))
  finally:
    if browser is not None:
      browser.quit()
    server.terminate()
    server.wait()


if __name__ == '__main__':
  main()
