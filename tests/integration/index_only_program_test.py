#!/usr/bin/env python3
"""Index-only datasets, by the real programs: made, drawn, verified, given levels, refused, served by agents.

    index_only_program_test.py BIN_FOLDER [unittest arguments]
"""

import http.server
import itertools
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(__file__), '..', 'support'))
from server_process import Server  # noqa: E402

BIN = sys.argv.pop(1) if len(sys.argv) > 1 else '.'
PATIENCE_S = 240  # far above what is needed
CUT = ['--block-cells', '8', '--quiet']
VIEW = ['--isovalue', '128', '--renderer', 'cpu', '--width', '96', '--height', '72', '--no-metadata', '--quiet']
DIMS = (150, 90, 70)


def run(program, *arguments, check=True):
  done = subprocess.run([os.path.join(BIN, program), *arguments], capture_output=True, text=True, timeout=PATIENCE_S)
  if check and done.returncode != 0:
    raise AssertionError(f'{program} {" ".join(arguments)}: exit code {done.returncode}\n{done.stderr}')
  return done


def isoscope(*arguments, check=True):
  return run('isoscope', *arguments, check=check)


def read(path):
  with open(path, 'rb') as file:
    return file.read()


def start_server(program, *arguments):
  return Server(os.path.join(BIN, program), *arguments)


class IndexOnlyTest(unittest.TestCase):

  def setUp(self):
    self.folder = os.path.realpath(tempfile.mkdtemp())
    self.addCleanup(shutil.rmtree, self.folder)
    self.volume = self.path('data', 'v.nrrd')
    os.makedirs(self.path('data'))
    isoscope('generate', 'gyroid', '--dims', ','.join(map(str, DIMS)), '--type', 'uint8', '--output', self.volume,
             '--quiet')

  def path(self, *names):
    return os.path.join(self.folder, *names)

  def partition(self, name, *more, check=True):
    """A dataset "d" in a folder of its own."""
    os.makedirs(self.path(name), exist_ok=True)
    dataset = self.path(name, 'd')
    done = isoscope('partition', self.volume, '--output', dataset, *CUT, *more, check=check)
    return dataset if check else done

  def picture(self, source, *more):
    output = self.path('p.png')
    if os.path.exists(output):
      os.remove(output)
    isoscope('render', source, '--output', output, *VIEW, *more)
    return read(output)

  def blocks_bytes(self, dataset):
    return sum(len(content) for path, content in self.files(dataset).items()
               if path.endswith('blocks.bin') and 'level' not in path)

  def test_pictures_are_those_of_the_copy(self):
    copied = self.partition('a', '--levels', '1')
    index_only = self.partition('b', '--levels', '1', '--shards', '3', '--index-only')
    self.assertLess(self.blocks_bytes(index_only), self.blocks_bytes(copied) / 2)  # overhangs
    self.assertTrue(
        os.path.exists(os.path.join(index_only, 'shard-00000-of-00003', 'level_1', 'blocks.bin')))
    for more in ([], ['--azimuth', '70', '--zoom', '3'], ['--level', '1'], ['--culling', 'none', '--threads', '1'],
                 ['--memory-limit', '128MiB']):
      self.assertEqual(self.picture(index_only, *more), self.picture(copied, *more), more)
    meshes = []
    for dataset in (copied, index_only):
      isoscope('export', dataset, '--isovalue', '128', '--output', self.path('m.ply'), '--quiet')
      meshes.append(read(self.path('m.ply')))
      os.remove(self.path('m.ply'))
    self.assertEqual(sorted(meshes[0]), sorted(meshes[1]))

  def peak_mib(self, *arguments):
    """The most that was resident of a command that succeeds, in MiB."""
    with open(self.path('errors'), 'w+') as errors:
      process = subprocess.Popen([os.path.join(BIN, 'isoscope'), *arguments], stdout=subprocess.DEVNULL, stderr=errors)
      alarm = threading.Timer(PATIENCE_S, process.kill)
      alarm.start()
      _, status, usage = os.wait4(process.pid, 0)
      alarm.cancel()
      process.returncode = os.waitstatus_to_exitcode(status)
      errors.seek(0)
      self.assertEqual(process.returncode, 0, errors.read())
    return usage.ru_maxrss / 1024

  # Breaks if each thread has a chunk of 1 MiB for meshes, or frees into an arena of malloc of its own.
  def test_memory_keeps_the_limit_with_any_number_of_threads(self):
    isoscope('generate', 'gyroid', '--dims', '256,256,256', '--type', 'uint8', '--output', self.path('w.nrrd'), '--quiet')
    limit_mib = 112
    pictures = set()
    for kind in ([], ['--index-only']):
      dataset = self.path('_'.join(['w', *kind]))
      isoscope('partition', self.path('w.nrrd'), '--output', dataset, '--levels', 'none', '--quiet', *kind)
      for threads in ('1', '8', '64'):
        peak = self.peak_mib('render', dataset, '--isovalue', '128', '--renderer', 'cpu', '--threads', threads,
                             '--memory-limit', f'{limit_mib}MiB', '--output', self.path('p.png'), '--no-metadata',
                             '--quiet')
        self.assertLessEqual(peak, limit_mib, (kind, threads))
        pictures.add(read(self.path('p.png')))
    self.assertEqual(len(pictures), 1)

  def test_a_small_limit_says_that_fewer_threads_draw(self):
    dataset = self.partition('few', '--index-only')
    render = ['render', dataset, '--isovalue', '128', '--renderer', 'cpu', '--width', '64', '--height', '64',
              '--output', self.path('p.png')]
    small = ['--threads', '64', '--memory-limit', '112MiB']
    note = r'isoscope: \d+ threads draw in place of 64: the memory limit of 112 MiB has no room for more; .*\n'
    self.assertRegex(isoscope(*render, *small).stderr, f'^{note}$')
    self.assertEqual(isoscope(*render, *small, '--quiet').stderr, '')
    self.assertEqual(isoscope(*render, '--threads', '2', '--memory-limit', '112MiB').stderr, '')

  # Breaks if the coordinator takes frames of several callers beside the agents of its process.
  def test_memory_of_a_server_keeps_the_limit_with_many_callers(self):
    isoscope('generate', 'gyroid', '--dims', '256,256,256', '--type', 'uint8', '--output', self.path('w.nrrd'), '--quiet')
    dataset = self.path('w')
    isoscope('partition', self.path('w.nrrd'), '--output', dataset, '--levels', '1', '--quiet')
    limit_mib = 160
    server = subprocess.Popen([os.path.join(BIN, 'isoscope'), 'serve', dataset, '--listen', '127.0.0.1:0',
                               '--renderer', 'cpu', '--threads', '64', '--memory-limit', f'{limit_mib}MiB'],
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
      address = server.stdout.readline().strip()
      callers = [subprocess.Popen([os.path.join(BIN, 'isoscope'), 'render', '--server', address, '--isovalue', '128',
                                   '--azimuth', str(20 * i), '--output', self.path(f'{i}.png'), '--quiet'])
                 for i in range(8)]
      self.assertEqual([caller.wait(PATIENCE_S) for caller in callers], [0] * 8)
      with open(f'/proc/{server.pid}/status') as file:
        peak_kib = int(re.search(r'VmHWM:\s+(\d+)', file.read())[1])
    finally:
      server.terminate()
      server.communicate()
    self.assertLessEqual(peak_kib / 1024, limit_mib)

  def test_info_and_verify(self):
    dataset = self.partition('b', '--shards', '2', '--index-only')
    info = json.loads(isoscope('info', dataset, '--json').stdout)['datasets'][0]
    self.assertEqual(info['in_source']['path'], self.volume)
    self.assertIn(f'in {self.volume}, read in chunks of', isoscope('info', dataset).stdout)
    self.assertIn('all checksums match', isoscope('verify', dataset).stdout)
    with open(self.volume, 'r+b') as file:
      file.seek(-1000, os.SEEK_END)
      byte = file.read(1)
      file.seek(-1000, os.SEEK_END)
      file.write(bytes([byte[0] ^ 4]))
    verified = isoscope('verify', dataset, check=False)
    self.assertEqual(verified.returncode, 1)
    self.assertIn('the source has changed', verified.stdout)
    self.assertIn(self.volume, verified.stdout)
    drawn = isoscope('render', dataset, '--output', self.path('p.png'), '--culling', 'none', *VIEW, check=False)
    self.assertEqual(drawn.returncode, 1)
    self.assertIn('the source has changed', drawn.stderr)
    self.assertFalse(os.path.exists(self.path('p.png')))
    os.rename(self.volume, self.path('data', 'w.nrrd'))
    isoscope('info', dataset)
    drawn = isoscope('render', dataset, '--output', self.path('p.png'), *VIEW, check=False)
    self.assertEqual(drawn.returncode, 1)
    self.assertIn(self.volume, drawn.stderr)
    self.assertIn('bring it back', drawn.stderr)
    verified = isoscope('verify', dataset, check=False)  # no damage of the dataset
    self.assertEqual(verified.returncode, 1)
    self.assertIn('NOT_FOUND', verified.stderr)
    self.assertIn('bring it back', verified.stderr)
    self.assertNotIn('damage', verified.stdout + verified.stderr)

  def test_levels_can_be_added(self):
    whole = self.partition('a', '--levels', '1', '--index-only')
    dataset = self.partition('b', '--levels', 'none', '--index-only')
    isoscope('partition', '--add-levels', dataset, '--levels', '1', '--quiet')
    for folder, _, names in os.walk(whole):
      for name in names:
        path = os.path.join(folder, name)
        self.assertEqual(read(path), read(os.path.join(dataset, os.path.relpath(path, whole))), path)
    isoscope('partition', '--drop-levels', dataset, '--quiet')
    plain = self.partition('c', '--levels', 'none', '--index-only')
    self.assertEqual(read(os.path.join(dataset, 'manifest.json')), read(os.path.join(plain, 'manifest.json')))

  def test_refusals(self):
    for more, word in ((['--compact'], '--compact'), (['--resume'], '--resume'),
                       (['--distribution', 'greedy'], '--distribution greedy'), (['--compression', 'lz4'], '--compression')):
      done = self.partition('e', '--index-only', *more, check=False)
      self.assertEqual(done.returncode, 2, done.stderr)
      self.assertIn(f"{word} can't be used with --index-only", done.stderr)
    done = self.partition('e', '--index-only', '--shards', '100', check=False)
    self.assertEqual(done.returncode, 1)
    self.assertIn('use at most as many shards', done.stderr)

  def files(self, folder):
    """The bytes of all files, by their paths below the folder."""
    return {
        os.path.relpath(os.path.join(below, name), folder): read(os.path.join(below, name))
        for below, _, names in os.walk(folder) for name in names
    }

  def test_parts_make_the_files_of_one_process(self):
    for more in ([], ['--time', '1.5']):
      whole = self.partition('a', '--index-only', '--shards', '2', '--levels', '1', *more)
      parts = os.path.join(self.path('b'), 'd')
      for part in range(3):
        self.partition('b', '--index-only', '--shards', '2', '--levels', '1', '--part', f'{part}/3', *more)
      isoscope('partition', '--finish', parts, '--quiet')
      self.assertEqual(self.files(parts), self.files(whole))
      for folder in (whole, parts):
        shutil.rmtree(folder)

  def test_steps_stay_in_the_source(self):
    store = self.path('data', 't.zarr')
    write_zarr_steps(store, steps=3)
    arguments = ['partition', store, '--axes', 'TZYX', *CUT, '--levels', '1']
    copied, dataset = self.path('copied'), self.path('steps')
    isoscope(*arguments, '--output', copied)
    isoscope(*arguments, '--output', dataset, '--index-only', '--shards', '3')
    self.assertLess(self.blocks_bytes(dataset), self.blocks_bytes(copied) / 2)
    info = json.loads(isoscope('info', dataset, '--json').stdout)['datasets'][0]
    self.assertEqual(info['in_source'], {'path': store, 'unit_dims': [32, 32, 32]})
    self.assertIn(f'in {store}, read in chunks of', isoscope('info', dataset).stdout)
    pictures = [self.picture(copied, '--step', str(step)) for step in range(3)]
    self.assertEqual(len(set(pictures)), 3)
    self.assertEqual([self.picture(dataset, '--step', str(step)) for step in range(3)], pictures)
    self.assertIn('all checksums match', isoscope('verify', dataset).stdout)
    appended = isoscope('partition', store, '--axes', 'TZYX', '--append', dataset, '--quiet', check=False)
    self.assertEqual(appended.returncode, 1)
    self.assertIn('index-only', appended.stderr)
    plain = self.path('plain')
    isoscope('partition', store, '--axes', 'TZYX', *CUT, '--levels', 'none', '--index-only', '--shards', '3',
             '--output', plain)
    isoscope('partition', '--add-levels', plain, '--levels', '1', '--quiet')
    self.assertEqual({name: data for name, data in self.files(plain).items() if '.json' not in name},
                     {name: data for name, data in self.files(dataset).items() if '.json' not in name})
    # An agent opens each step when a frame needs it.
    agent = start_server('isoscope-agent', '--renderer', 'cpu', '--shard', dataset, '--allow-source', self.path('data'))
    self.addCleanup(agent.stop)
    coordinator = start_server('isoscope-coordinator', '--agent', agent.address)
    self.addCleanup(coordinator.stop)

    def serve(step):
      output = self.path('served.png')
      if os.path.exists(output):
        os.remove(output)
      done = isoscope('render', '--server', coordinator.address, '--output', output, *VIEW[:2], '--width', '96',
                      '--height', '72', '--no-metadata', '--quiet', '--step', str(step), check=False)
      return read(output) if done.returncode == 0 else done.stderr

    self.assertEqual(serve(1), pictures[1])
    self.assertEqual(serve(0), pictures[0])
    # One step changes: the others are drawn on.
    for name in os.listdir(store):
      if name.startswith('2.'):
        with open(os.path.join(store, name), 'r+b') as file:
          file.write(bytes(4096))
    self.assertIn('the source has changed', serve(2))
    self.assertEqual(serve(1), pictures[1])
    verified = isoscope('verify', dataset, check=False)
    self.assertEqual(verified.returncode, 1)
    self.assertIn('the source has changed', verified.stdout)

  def test_series_without_leave_to_read_are_refused(self):
    store = self.path('data', 't.zarr')
    write_zarr_steps(store, steps=2)
    dataset = self.path('d')
    isoscope('partition', store, '--axes', 'TZYX', *CUT, '--output', dataset, '--index-only')
    agent = start_server('isoscope-agent', '--renderer', 'cpu', '--shard', dataset)
    self.addCleanup(agent.stop)
    coordinator = start_server('isoscope-coordinator', '--agent', agent.address)
    self.addCleanup(coordinator.stop)
    done = isoscope('render', '--server', coordinator.address, '--output', self.path('no.png'), *VIEW[:2], '--quiet',
                    check=False)
    self.assertEqual(done.returncode, 1)
    self.assertIn('may not read', done.stderr)
    self.assertNotIn(self.path('data'), done.stderr)

  def test_vtk_files_of_steps(self):
    for step in range(2):
      write_vti(self.path('data', f'run_{step}.vti'), slope=8 + 4 * step)
    pattern = self.path('data', 'run_*.vti')
    isoscope('partition', pattern, *CUT, '--output', self.path('copied'))
    isoscope('partition', pattern, *CUT, '--output', self.path('d'), '--index-only')
    for step in ('0', '1'):
      self.assertEqual(self.picture(self.path('d'), '--step', step), self.picture(self.path('copied'), '--step', step))

  def test_agents_read_what_is_allowed(self):
    dataset = self.partition('b', '--shards', '2', '--index-only')
    expected = self.picture(dataset)
    refused = start_server('isoscope-agent', '--renderer', 'cpu', '--shard', dataset)
    refused.stop()
    self.assertNotEqual(refused.process.returncode, 0)
    self.assertIn('--allow-source', ''.join(refused.lines))
    moved = self.path('elsewhere')
    os.rename(self.path('data'), moved)
    # Breaks if the flag takes the folder behind its value, too.
    agent = start_server('isoscope-agent', '--renderer', 'cpu', '--allow-source', self.path('data') + '=' + moved, dataset)
    self.addCleanup(agent.stop)
    coordinator = start_server('isoscope-coordinator', '--agent', agent.address)
    self.addCleanup(coordinator.stop)
    output = self.path('served.png')
    isoscope('render', '--server', coordinator.address, '--output', output, *VIEW[:2], '--width', '96', '--height',
             '72', '--no-metadata', '--quiet')
    self.assertEqual(read(output), expected)
    # Another agent meets changed samples: an error, which keeps the folder to itself.
    agent.stop()
    coordinator.stop()
    with open(os.path.join(moved, 'v.nrrd'), 'r+b') as file:
      header = file.read(4096).index(b'\n\n') + 2
      file.seek(header)
      file.write(bytes(DIMS[0] * DIMS[1] * DIMS[2]))
    agent = start_server('isoscope-agent', '--renderer', 'cpu', '--shard', dataset, '--allow-source',
                   self.path('data') + '=' + moved)
    self.addCleanup(agent.stop)
    coordinator = start_server('isoscope-coordinator', '--agent', agent.address)
    self.addCleanup(coordinator.stop)
    done = isoscope('render', '--server', coordinator.address, '--isovalue', '129', '--culling', 'none', '--output',
                    self.path('no.png'), '--quiet', check=False)
    self.assertEqual(done.returncode, 1)
    self.assertIn('the source has changed', done.stderr)
    self.assertNotIn(moved, done.stderr)

  # What vanishes under a running agent is told as at its start, and read again once it is back.
  def test_a_source_that_vanishes_under_an_agent(self):
    dataset = self.partition('b', '--index-only')
    expected = self.picture(dataset)
    agent = start_server('isoscope-agent', '--renderer', 'cpu', '--shard', dataset, '--allow-source', self.path('data'))
    self.addCleanup(agent.stop)
    coordinator = start_server('isoscope-coordinator', '--agent', agent.address)
    self.addCleanup(coordinator.stop)

    def frame():
      return isoscope('render', '--server', coordinator.address, '--output', self.path('served.png'), *VIEW[:2],
                      '--width', '96', '--height', '72', '--no-metadata', '--quiet', check=False)

    os.rename(self.path('data'), self.path('elsewhere'))
    gone = frame()
    self.assertEqual(gone.returncode, 1)
    for words in ('NOT_FOUND', 'its samples are in v.nrrd', 'No such file', 'bring it back', '--allow-source'):
      self.assertIn(words, gone.stderr)
    self.assertNotIn(self.folder, gone.stderr)
    os.rename(self.path('elsewhere'), self.path('data'))
    done = frame()
    self.assertEqual(done.returncode, 0, done.stderr)
    self.assertEqual(read(self.path('served.png')), expected)
    self.assertIn('source_unreadable', ''.join(agent.lines))
    self.assertNotIn('shard_damaged', ''.join(agent.lines))

  # Symptom: a chunk that was wrong once stayed in memory.
  def test_a_source_that_is_back_as_it_was_is_read_again(self):
    store = self.path('data', 'v.zarr')
    write_zarr(store)
    dataset = self.path('d')
    isoscope('partition', store, '--index-only', '--output', dataset, *CUT)
    expected = self.picture(dataset)
    agent = start_server('isoscope-agent', '--renderer', 'cpu', '--shard', dataset, '--allow-source', self.path('data'))
    self.addCleanup(agent.stop)
    coordinator = start_server('isoscope-coordinator', '--agent', agent.address)
    self.addCleanup(coordinator.stop)

    def frame():
      return isoscope('render', '--server', coordinator.address, '--output', self.path('served.png'), *VIEW[:2],
                      '--width', '96', '--height', '72', '--no-metadata', '--quiet', check=False)

    chunk = os.path.join(store, '1.1.1')
    samples = read(chunk)
    with open(chunk, 'wb') as file:
      file.write(bytes(255 - sample for sample in samples))
    changed = frame()
    self.assertIn('DATA_LOSS', changed.stderr)
    self.assertIn('partition it anew', changed.stderr)
    with open(chunk, 'wb') as file:
      file.write(samples)
    end = time.monotonic() + PATIENCE_S
    while frame().returncode != 0 and time.monotonic() < end:
      time.sleep(0.2)
    self.assertEqual(read(self.path('served.png')), expected)

  def test_addresses_are_read_where_they_are_allowed_and_agents_follow_nobody(self):
    store = self.path('data', 'v.zarr')
    write_zarr(store)
    server = StoreServer(self.path('data'))
    self.addCleanup(server.close)
    address = f'http://127.0.0.1:{server.port}/v.zarr'
    dataset = self.path('d')
    isoscope('partition', address, '--index-only', '--output', dataset, *CUT)
    copied = self.path('copied')
    isoscope('partition', store, '--output', copied, *CUT)
    expected = self.picture(copied)
    render = ['render', dataset, '--output', self.path('p.png'), *VIEW]
    asked = server.count
    refused = isoscope(*render, check=False)
    self.assertEqual(refused.returncode, 1)
    self.assertIn(f'ISOSCOPE_ALLOW_SOURCE={address}', refused.stderr)
    self.assertEqual(server.count, asked, 'asked before it was allowed')
    self.addCleanup(os.environ.pop, 'ISOSCOPE_ALLOW_SOURCE')
    os.environ['ISOSCOPE_ALLOW_SOURCE'] = f'http://127.0.0.1:{server.port}'
    self.assertEqual(self.picture(dataset), expected)
    steps = self.path('data', 't.zarr')
    write_zarr_steps(steps, steps=2)
    for source, output, *more in ((steps, 'e'), (f'http://127.0.0.1:{server.port}/t.zarr', 'f', '--index-only')):
      isoscope('partition', source, '--axes', 'TZYX', *CUT, '--output', self.path(output), *more)
    for step in ('0', '1'):
      self.assertEqual(self.picture(self.path('f'), '--step', step), self.picture(self.path('e'), '--step', step))
    server.redirects = True
    self.assertEqual(self.picture(dataset), expected)
    # The variable stands for the agent's flag, too.
    agent = start_server('isoscope-agent', '--renderer', 'cpu', '--shard', dataset)
    self.addCleanup(agent.stop)
    coordinator = start_server('isoscope-coordinator', '--agent', agent.address)
    self.addCleanup(coordinator.stop)
    served = ['render', '--server', coordinator.address, '--isovalue', '128', '--output', self.path('q.png'), '--quiet']
    done = isoscope(*served, check=False)
    self.assertEqual(done.returncode, 1)
    self.assertIn('another host', done.stderr)


class StoreServer:
  """Serves a folder whole; then redirects chunks to the same server by another name."""

  def __init__(self, folder):
    outer = self
    self.count = 0
    self.redirects = False

    class Handler(http.server.SimpleHTTPRequestHandler):
      protocol_version = 'HTTP/1.1'

      def __init__(self, *arguments):
        super().__init__(*arguments, directory=folder)

      def do_GET(self):
        outer.count += 1
        is_chunk = os.path.basename(self.path)[0].isdigit()
        if outer.redirects and is_chunk and self.headers['Host'].startswith('127.0.0.1'):
          self.send_response(302)
          self.send_header('Location', f'http://localhost:{outer.port}{self.path}')
          self.send_header('Content-Length', '0')
          self.end_headers()
        else:
          super().do_GET()

      def log_message(self, *_):
        pass

    self.server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler)
    self.port = self.server.server_address[1]
    threading.Thread(target=self.server.serve_forever, daemon=True).start()

  def close(self):
    self.server.shutdown()
    self.server.server_close()


def write_vti(path, slope):
  """A ball as appended raw data."""
  dims = (40, 30, 20)
  samples = bytes(
      max(0, 255 - slope * int(math.dist((k, j, i), (10, 15, 20))))
      for k, j, i in itertools.product(*map(range, reversed(dims))))
  extent = ' '.join(f'0 {size - 1}' for size in dims)
  with open(path, 'wb') as file:
    file.write(f'<VTKFile type="ImageData" byte_order="LittleEndian" header_type="UInt64"><ImageData '
               f'WholeExtent="{extent}" Origin="0 0 0" Spacing="1 1 1"><Piece Extent="{extent}"><PointData>'
               '<DataArray Name="p" type="UInt8" format="appended" offset="0"/></PointData></Piece></ImageData>'
               '<AppendedData encoding="raw">_'.encode('ascii'))
    file.write(len(samples).to_bytes(8, 'little') + samples)
    file.write(b'</AppendedData></VTKFile>')


def write_zarr_steps(path, steps):
  """Balls of other radii, in chunks of 1 x 16 x 16 x 16."""
  os.makedirs(path)
  side, chunk = 48, 16
  with open(os.path.join(path, '.zarray'), 'w', encoding='ascii') as file:
    json.dump({'zarr_format': 2, 'shape': [steps] + [side] * 3, 'chunks': [1] + [chunk] * 3, 'dtype': '|u1',
               'order': 'C', 'compressor': None, 'filters': None, 'fill_value': 0}, file)
  for t, z, y, x in itertools.product(range(steps), *[range(0, side, chunk)] * 3):
    samples = bytes(
        max(0, 255 - (8 + 2 * t) * int(math.dist((k, j, i), (24, 24, 24))))
        for k, j, i in itertools.product(range(z, z + chunk), range(y, y + chunk), range(x, x + chunk)))
    with open(os.path.join(path, f'{t}.{z // chunk}.{y // chunk}.{x // chunk}'), 'wb') as file:
      file.write(samples)


def write_zarr(path):
  """A ball in chunks of 16 x 16 x 16 without a codec."""
  os.makedirs(path)
  side, chunk = 48, 16
  with open(os.path.join(path, '.zarray'), 'w', encoding='ascii') as file:
    json.dump({'zarr_format': 2, 'shape': [side] * 3, 'chunks': [chunk] * 3, 'dtype': '|u1', 'order': 'C',
               'compressor': None, 'filters': None, 'fill_value': 0}, file)
  for z, y, x in itertools.product(range(0, side, chunk), repeat=3):
    samples = bytes(
        max(0, 255 - 8 * int(math.dist((k, j, i), (24, 24, 24))))
        for k, j, i in itertools.product(range(z, z + chunk), range(y, y + chunk), range(x, x + chunk)))
    with open(os.path.join(path, f'{z // chunk}.{y // chunk}.{x // chunk}'), 'wb') as file:
      file.write(samples)


if __name__ == '__main__':
  unittest.main()
