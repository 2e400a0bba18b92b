#!/usr/bin/env python3
"""Measures how soon a notebook's first cell shows a picture.

    tools/measure_notebook.py INPUT|DIR --isovalue V [--programs FOLDER] [--rounds N]

Executes a notebook of two cells in a new kernel, as Debian's Notebook does, N times (default 5). The first cell
imports isoscope and asks a server that runs for a picture, which it shows; the second asks for another one. Prints
JSON: milliseconds of both cells, from the kernel's messages, and whether the notebook as HTML holds the PNG. Needs
python3-nbclient, python3-nbconvert and python3-ipykernel: run it with Debian's /usr/bin/python3.
"""

import argparse
import datetime
import json
import os
import pathlib
import subprocess
import sys

import nbclient
import nbconvert
import nbformat

ROOT = pathlib.Path(__file__).resolve().parents[1]


def milliseconds(cell):
  """Returns the time from the kernel's begin of the cell to its result."""
  times = cell.metadata['execution']
  begin, end = (datetime.datetime.fromisoformat(times[name].replace('Z', '+00:00'))
                for name in ('iopub.execute_input', 'shell.execute_reply'))
  return (end - begin).total_seconds() * 1000


def picture_of(cell):
  return next((output['data']['image/png'] for output in cell.outputs if 'image/png' in output.get('data', {})), '')


def execute(address, isovalue):
  source = [f'import isoscope\nclient = isoscope.connect("{address}")\ndata = next(iter(client))\n'
            f'data.render({isovalue}, size=(1024, 1024))',
            f'data.render({isovalue}, size=(1024, 1024), azimuth=30)']
  notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in source])
  nbclient.NotebookClient(notebook, timeout=120, kernel_name='python3').execute()
  return notebook


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument('input')
  parser.add_argument('--isovalue', required=True)
  parser.add_argument('--programs', default=ROOT / 'build/release/bin', type=pathlib.Path)
  parser.add_argument('--rounds', type=int, default=5)
  flags = parser.parse_args()
  os.environ['PYTHONPATH'] = os.pathsep.join(filter(None, [str(ROOT / 'clients/python/src'), os.environ.get('PYTHONPATH')]))
  server = subprocess.Popen([flags.programs / 'isoscope', 'serve', flags.input, '--listen', '127.0.0.1:0'],
                            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
  try:
    address = server.stdout.readline().strip().split()[-1]
    notebooks = [execute(address, flags.isovalue) for _ in range(flags.rounds)]
  finally:
    server.terminate()
    server.wait()
  html, _ = nbconvert.HTMLExporter().from_notebook_node(notebooks[-1])
  text = ''.join(html.split())
  cells = [sorted(milliseconds(notebook.cells[i]) for notebook in notebooks) for i in range(2)]
  print(json.dumps({
      'firstPictureMs': {'median': round(cells[0][flags.rounds // 2]), 'most': round(cells[0][-1])},
      'nextPictureMs': {'median': round(cells[1][flags.rounds // 2]), 'most': round(cells[1][-1])},
      'htmlHoldsPictures': all(picture_of(cell) and ''.join(picture_of(cell).split()) in text for cell in notebooks[-1].cells),
  }, indent=2))


if __name__ == '__main__':
  sys.exit(main())
