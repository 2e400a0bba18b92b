#!/usr/bin/env python3
"""A dataset with fields and time steps, by the real programs: its pictures, cuts, colours, appending under load.

    series_test.py BIN_FOLDER KILL_AT_STEP [unittest arguments]

KILL_AT_STEP is the library of tests/support/kill_at_step.cc.
"""

import contextlib
import hashlib
import itertools
import json
import math
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(__file__), '..', 'support'))
from flow_formulas import fluid  # noqa: E402
from server_process import Server  # noqa: E402

BIN = sys.argv.pop(1) if len(sys.argv) > 1 else '.'
KILL_AT_STEP = sys.argv.pop(1) if len(sys.argv) > 1 else ''
PATIENCE_S = 240  # far above what is needed
STEPS = 4
SMALL = ['--renderer', 'cpu', '--width', '160', '--height', '120', '--no-metadata', '--quiet']


def isoscope(*arguments, check=True):
  done = subprocess.run([os.path.join(BIN, 'isoscope'), *arguments], capture_output=True, text=True, timeout=PATIENCE_S)
  if check and done.returncode != 0:
    raise AssertionError(f'isoscope {" ".join(arguments)}: exit code {done.returncode}\n{done.stderr}')
  return done


def killed_at(step, *arguments):
  """Whether isoscope is killed before the step: its number, or the end of the path that it makes or removes."""
  environment = {**os.environ, 'LD_PRELOAD': KILL_AT_STEP, 'ISOSCOPE_TEST_KILL_AT': str(step),
                 'ASAN_OPTIONS': os.environ.get('ASAN_OPTIONS', '') + ':verify_asan_link_order=0'}
  done = subprocess.run([os.path.join(BIN, 'isoscope'), *arguments], capture_output=True, text=True,
                        env=environment, timeout=PATIENCE_S)
  if done.returncode not in (0, -signal.SIGKILL):
    raise AssertionError(f'isoscope {" ".join(arguments)}: exit code {done.returncode}\n{done.stderr}')
  return done.returncode != 0


def steps_of(directory):
  """The numbers of the steps that `isoscope info` lists."""
  dataset = json.loads(isoscope('info', directory, '--json').stdout)['datasets'][0]
  return [step['number'] for step in dataset['time_steps']]


def files_below(directory):
  """The digest of each file, by path."""
  digests = {}
  for folder, _, names in os.walk(directory):
    for name in names:
      path = os.path.join(folder, name)
      with open(path, 'rb') as file:
        digests[os.path.relpath(path, directory)] = hashlib.sha256(file.read()).hexdigest()
  return digests


def picture(folder, *arguments):
  """The bytes of the PNG that `isoscope render` writes."""
  with tempfile.TemporaryDirectory(dir=folder) as own:
    path = os.path.join(own, 'p.png')
    isoscope('render', *arguments, '--output', path)
    with open(path, 'rb') as file:
      return file.read()


def is_ready(coordinator, agent_count):
  """Whether all agents answer the coordinator, and their shards make whole datasets."""
  done = isoscope('info', '--server', coordinator, '--json', check=False)
  if done.returncode != 0:
    return False
  info = json.loads(done.stdout)
  return ([agent['state'] for agent in info['agents']] == ['reachable'] * agent_count and info['datasets'] != [] and
          all(dataset['missing_shards'] == [] for dataset in info['datasets']))


@contextlib.contextmanager
def cluster(*agent_directories):
  """The address of a coordinator, with an agent for each list of directories."""
  with contextlib.ExitStack() as servers:
    def start(program, *arguments):
      server = Server(os.path.join(BIN, program), *arguments)
      servers.callback(server.kill)
      if server.address is None:
        raise AssertionError(f'{program} does not start: {"".join(server.lines)}')
      return server.address

    agents = [start('isoscope-agent', '--renderer', 'cpu', *directories) for directories in agent_directories]
    coordinator = start('isoscope-coordinator', '--poll-seconds', '0.2',
                        *itertools.chain(*(['--agent', address] for address in agents)))
    end = time.monotonic() + PATIENCE_S
    while not is_ready(coordinator, len(agent_directories)):
      if time.monotonic() > end:
        raise AssertionError('the cluster does not come up')
      time.sleep(0.1)
    yield coordinator


def etags(coordinator, targets):
  """The ETags that a gateway gives pictures, without the quotation marks; and whether each is immutable."""
  gateway = Server(os.path.join(BIN, 'isoscope-gateway'), '--server', coordinator, '--no-token')
  try:
    found = []
    for target in targets:
      with urllib.request.urlopen(f'http://{gateway.address}{target}', timeout=PATIENCE_S) as answer:
        found.append((answer.headers['ETag'], 'immutable' in answer.headers['Cache-Control']))
    return found
  finally:
    gateway.kill()


class SeriesTest(unittest.TestCase):
  @classmethod
  def setUpClass(cls):
    cls.temporary = tempfile.TemporaryDirectory(prefix='isoscope-series-')
    cls.folder = cls.temporary.name
    cls.source = cls.path('flow.pvd')
    isoscope('generate', 'flow', '--dims', '40,36,32', '--steps', str(STEPS), '--output', cls.source)
    for shards in (1, 3):
      isoscope('partition', cls.source, '--shards', str(shards), '--output', cls.path(f'flow{shards}'))

  @classmethod
  def tearDownClass(cls):
    cls.temporary.cleanup()

  @classmethod
  def path(cls, name):
    return os.path.join(cls.folder, name)

  def render(self, *arguments):
    return picture(self.folder, *SMALL, *arguments)

  def test_each_volume_draws_what_the_dataset_of_its_array_alone_draws(self):
    for array, field, isovalue in (('pressure', 'pressure', '-2'), ('temperature', 'temperature', '310'),
                                   ('velocity:1', 'velocity:y', '0.02')):
      for step in (0, STEPS - 1):
        alone = self.render(self.path(f'flow_{step:05}.vti:{array}'), f'--isovalue={isovalue}')
        for shards in (1, 3):
          for culling in ('depth', 'none'):
            self.assertEqual(alone, self.render(self.path(f'flow{shards}'), '--field', field, '--step', str(step),
                                                f'--isovalue={isovalue}', '--culling', culling),
                             f'{field}, step {step}, {shards} shards, culling {culling}')

  def test_a_collection_is_described_and_drawn_without_partitioning_it_first(self):
    text = isoscope('info', self.source).stdout
    for word in ('40 x 36 x 32', 'pressure [Pa]', 'velocity [m/s] (x, y, z)', f'{STEPS}, from 0 to'):
      self.assertIn(word, text)
    fields = json.loads(isoscope('info', self.source, '--json').stdout)['volume']['fields']
    self.assertEqual([field['name'] for field in fields], ['pressure', 'temperature', 'velocity'])
    os.environ['XDG_CACHE_HOME'] = self.path('cache')
    look = ['--field', 'temperature', '--isovalue', '310', '--step', '1']
    self.assertEqual(self.render(self.source, *look), self.render(self.path('flow1'), *look))

  def test_colours_of_a_field_do_not_depend_on_cuts_culling_and_memory(self):
    look = ['--field', 'velocity', '--isovalue', '0.1', '--step', '2', '--color-by', 'temperature:magma',
            '--azimuth', '35']
    first = self.render(self.path('flow1'), *look)
    at = look.index('--color-by')
    self.assertNotEqual(first, self.render(self.path('flow1'), *look[:at], *look[at + 2:]))
    for shards in (1, 3):
      for more in (['--culling', 'none'], ['--threads', '1'], ['--threads', '8'], ['--memory-limit', '128MiB']):
        self.assertEqual(first, self.render(self.path(f'flow{shards}'), *look, *more), f'{shards} shards, {more}')
    # The range is that of all steps: the colours of one step do not tell which others there are.
    with_range = self.render(self.path('flow1'), *look[:-4], '--color-by', f'temperature:magma:{self.range_of("temperature")}',
                             '--azimuth', '35')
    self.assertEqual(first, with_range)

  def pick(self, *arguments):
    return json.loads(isoscope('pick', *SMALL[:-2], *arguments, '--json').stdout)['points']

  def test_a_pick_tells_the_values_of_all_fields_whatever_the_cut(self):
    pixels = [word for x in range(2, 160, 6) for y in range(2, 120, 6) for word in ('--pixel', f'{x},{y}')]
    look = ['--field', 'temperature', '--isovalue', '305', '--step', '2', '--azimuth', '35', '--all-fields', *pixels]
    first = self.pick(self.path('flow1'), *look)
    self.assertEqual([], [point for point in first if point['is_hit'] != ('field_values' in point)])
    hits = [point for point in first if point['is_hit']]
    self.assertGreater(len(hits), 5)
    for point in hits:
      values = {f"{value['field']}:{value['component']}": value['value'] for value in point['field_values']}
      self.assertEqual(['pressure:', 'temperature:', 'velocity:x', 'velocity:y', 'velocity:z', 'velocity:magnitude'], list(values))
      self.assertEqual({'Pa', 'K', 'm/s'}, {value['unit'] for value in point['field_values']})
      pressure, temperature, velocity = fluid(point['position'], 0.2)
      # The surface is linear between samples that are 1/39 m apart, and so are the values on it.
      self.assertAlmostEqual(305, values['temperature:'], delta=1e-3)
      self.assertAlmostEqual(temperature, values['temperature:'], delta=2.5)
      self.assertAlmostEqual(pressure, values['pressure:'], delta=0.5)
      for name, expected in zip('xyz', velocity):
        self.assertAlmostEqual(expected, values[f'velocity:{name}'], delta=0.01)
      self.assertAlmostEqual(math.hypot(*velocity), values['velocity:magnitude'], delta=0.01)
    without_shard = [{key: value for key, value in point.items() if key != 'shard_index'} for point in first]
    for more in ([], ['--threads', '1'], ['--memory-limit', '128MiB']):
      other = self.pick(self.path('flow3'), *look, *more)
      self.assertEqual(without_shard, [{key: value for key, value in point.items() if key != 'shard_index'} for point in other], more)
    # On a cap there is no triangle: the values are those of the cell.
    clip = ['--clip-plane', '0,0,-1,0.05', '--caps']
    on_caps = [point for point in self.pick(self.path('flow3'), *look[:-len(pixels)], *clip, *pixels)
               if point['is_hit'] and abs(point['position'][2] + 0.05) < 1e-5]
    self.assertGreater(len(on_caps), 3)
    for point in on_caps:
      pressure, temperature, _ = fluid(point['position'], 0.2)
      self.assertGreater(temperature, 303)
      self.assertAlmostEqual(temperature, point['field_values'][1]['value'], delta=2.5)
      self.assertAlmostEqual(pressure, point['field_values'][0]['value'], delta=0.5)
    done = isoscope('pick', self.path('flow_00000.vti:pressure'), '--isovalue=-2', '--pixel', '80,60', '--all-fields', check=False)
    self.assertIn('has one field', done.stderr)
    table = isoscope('pick', *SMALL[:-2], self.path('flow1'), *look[:-len(pixels)], '--pixel', '80,60').stdout
    self.assertIn('velocity:magnitude', table)

  def test_a_mesh_says_its_field_and_step_and_not_the_number_of_shards(self):
    look = ['--field', 'velocity:x', '--isovalue', '0.02', '--step', 'last']
    for suffix, words in (('ply', ['comment field velocity:x\ncomment unit m/s\ncomment step 3\ncomment time 0.3']),
                          ('obj', ['# field velocity:x\n# unit m/s\n# step 3\n# time 0.3']),
                          ('stl', ['field velocity:x, unit m/s, step 3, time 0.3']),
                          ('glb', ['"extras":{"field":"velocity","component":"x","unit":"m/s","step":3,"time":0.3']),
                          ('vtp', ['Name="TimeStep" NumberOfTuples="1" format="ascii">3<', 'Name="TimeValue"'])):
      meshes = []
      for shards in (1, 3):
        path = self.path(f'mesh.{suffix}')
        isoscope('export', self.path(f'flow{shards}'), *look, '--output', path, '--quiet')
        with open(path, 'rb') as file:
          meshes.append(file.read())
      self.assertEqual(meshes[0], meshes[1], suffix)
      for word in words:
        self.assertIn(word.encode(), meshes[0], suffix)
    isoscope('export', self.path('flow_00003.vti:velocity:0'), '--isovalue', '0.02', '--output', self.path('plain.ply'), '--quiet')
    with open(self.path('plain.ply'), 'rb') as file:
      self.assertNotIn(b'comment field', file.read())

  def range_of(self, field):
    info = json.loads(isoscope('info', self.path('flow1'), '--json').stdout)['datasets'][0]
    for row in info['fields']:
      if row['name'] == field:
        least, most = row['components'][0]['value_range']
        return f'{least!r},{most!r}'
    raise AssertionError(f'info knows no field {field}')

  def test_reading_ahead_changes_no_picture(self):
    look = ['--field', 'temperature', '--isovalue', '310', '--color-by', 'velocity', '--step']
    for steps in ('0:3', '3:0:-1'):
      pictures = []
      for mode, more in (('off', []), ('samples', []), ('', []), ('', ['--threads', '1']),
                         ('', ['--memory-limit', '128MiB'])):
        with tempfile.TemporaryDirectory(dir=self.folder) as own:
          os.environ['ISOSCOPE_PLAY_AHEAD'] = mode
          isoscope('render', *SMALL, self.path('flow3'), *look, steps, '--output', os.path.join(own, '%d.png'), *more)
          del os.environ['ISOSCOPE_PLAY_AHEAD']
          names = sorted(os.listdir(own))
          self.assertEqual(len(names), STEPS)
          pictures.append([pathlib.Path(own, name).read_bytes() for name in names])
      for other in pictures[1:]:
        self.assertEqual(pictures[0], other, steps)

  def test_a_cluster_of_processes_draws_the_same(self):
    shards = sorted(os.path.join(self.path('flow3'), name) for name in os.listdir(self.path('flow3')) if 'shard-' in name)
    with cluster(shards[:1], shards[1:]) as server:
      for look in (['--field', 'pressure', '--isovalue=-2', '--time', '0.11'],
                   ['--field', 'temperature', '--isovalue', '310', '--step', 'first', '--color-by', 'velocity:x']):
        local = self.render(self.path('flow3'), *look)
        remote = picture(self.folder, '--server', server, *SMALL[2:], *look)
        self.assertEqual(local, remote, look)

  def test_a_gateway_tells_series_apart_that_differ_in_a_later_step(self):
    found = {}
    for name in ('same', 'other'):
      folder = self.path(f'etag-{name}')
      os.mkdir(folder)
      source = os.path.join(folder, 'flow.pvd')
      isoscope('generate', 'flow', '--dims', '10,9,8', '--steps', '4', '--output', source)
      if name == 'other':
        shutil.copy(os.path.join(folder, 'flow_00001.vti'), os.path.join(folder, 'flow_00003.vti'))
      flow = os.path.join(folder, 'flow')
      isoscope('partition', source, '--output', flow)
      dataset_id = json.loads(isoscope('info', flow, '--json').stdout)['datasets'][0]['dataset_id']
      with cluster([flow]) as server:
        found[name] = (dataset_id, etags(server, [
            f'/v1/datasets/{dataset_id}/render?isovalue=310&field=temperature&width=32&height=32&step={step}'
            for step in range(4)]))
    self.assertEqual(found['same'][0], found['other'][0], 'the id names the first step')
    same, other = found['same'][1], found['other'][1]
    self.assertEqual([a == b for a, b in zip(same, other)], [True, True, True, False])
    self.assertEqual([is_immutable for _, is_immutable in same], [True, False, False, False])

  def test_wrong_choices_name_those_that_there_are(self):
    for flags, words in ((['--field', 'heat'], ['"heat"', '"pressure"', '"velocity"']),
                         (['--field', 'velocity:w'], ['"w"', '"magnitude"']),
                         (['--step', str(STEPS)], [f'time_step is {STEPS}', f'0 to {STEPS - 1}']),
                         (['--color-by', 'heat'], ['"heat"', '"temperature"'])):
      done = isoscope('render', self.path('flow1'), *SMALL, '--isovalue', '1', *flags, '--output', self.path('x.png'), check=False)
      self.assertNotEqual(done.returncode, 0, flags)
      for word in words:
        self.assertIn(word, done.stderr, flags)
    self.assertFalse(os.path.exists(self.path('x.png')))

  def test_a_sweep_of_steps_writes_a_picture_each_and_an_animation(self):
    look = [self.path('flow1'), *SMALL, '--field', 'temperature', '--isovalue', '310', '--step', 'first:last']
    isoscope('render', *look, '--output', self.path('s-%d.png'))
    self.assertEqual([os.path.exists(self.path(f's-{i}.png')) for i in range(STEPS + 1)], [True] * STEPS + [False])
    isoscope('render', *look, '--output', self.path('s.webp'))
    self.assertGreater(os.path.getsize(self.path('s.webp')), 1000)

  def test_an_append_that_is_killed_anywhere_leaves_the_old_or_the_new_series(self):
    # Many small files are written safely, which takes long on a disk.
    memory = '/dev/shm' if os.access('/dev/shm', os.W_OK) else None
    own = tempfile.TemporaryDirectory(prefix='isoscope-killed-', dir=memory)
    self.addCleanup(own.cleanup)
    source, old, new, killed = (os.path.join(own.name, name) for name in ('small.pvd', 'old', 'new', 'killed'))
    isoscope('generate', 'flow', '--dims', '10,9,8', '--steps', '3', '--output', source)
    for folder, steps in ((old, '0:1'), (new, '0:2')):
      os.mkdir(folder)
      isoscope('partition', source, '--shards', '2', '--step', steps, '--output', os.path.join(folder, 'flow'))
    expected = files_below(os.path.join(new, 'flow'))
    flow = os.path.join(killed, 'flow')
    append = ['partition', source, '--step', '2', '--append', flow, '--quiet']
    listed = []
    for step in itertools.count(1):
      shutil.copytree(old, killed)
      is_killed = killed_at(step, *append)
      listed.append(len(steps_of(flow)))
      # Resuming or not, the next one removes what was left, or completes it. Then it may find the step there.
      again = isoscope(*append, *(['--resume'] if step % 2 == 0 else []), check=False)
      if again.returncode != 0:
        self.assertIn('the series has this field at time', again.stderr, step)
      self.assertEqual(files_below(flow), expected, step)
      shutil.rmtree(killed)
      if not is_killed:
        break
    # The manifest of the dataset is replaced near the end, after many steps of volumes.
    self.assertEqual(listed, sorted(listed))
    self.assertGreater(listed.count(2), 6 * 6)
    self.assertGreater(listed.count(3), 2)

  def test_appending_while_frames_are_drawn_loses_none(self):
    # Two agents on copies of their own, which are updated one after the other.
    for name in ('a', 'b'):
      folder = self.path(f'copy-{name}')
      os.mkdir(folder)
      isoscope('partition', self.source, '--shards', '2', '--step', '0:1', '--output', os.path.join(folder, 'flow'))
    copies = [os.path.join(self.path(f'copy-{name}'), 'flow') for name in 'ab']
    look = [*SMALL[2:], '--field', 'temperature', '--isovalue', '310']
    new = [*look, '--step', '3']
    with cluster([copies[0]], [copies[1]]) as server:
      before = picture(self.folder, '--server', server, *look, '--step', '1')
      failures, drawn, stopping = [], [0], threading.Event()

      def draw():
        while not stopping.is_set():
          try:
            if picture(self.folder, '--server', server, *look, '--step', '1') != before:
              failures.append('another picture')
          except AssertionError as error:
            failures.append(str(error))
          drawn[0] += 1

      thread = threading.Thread(target=draw)
      thread.start()
      try:
        # A process that is killed while it appends leaves the series as it was: while it writes volumes, while it
        # moves them into the series, and when all but the dataset's manifest are replaced.
        append = ['partition', self.source, '--step', '2:3', '--append', copies[0], '--resume', '--quiet']
        for at in ('append.partial/shard-00001-of-00002/field-001-component-0-step-00003',
                   'flow/shard-00001-of-00002/field-001-component-0-step-00003', 'flow/manifest.json'):
          self.assertTrue(killed_at(at, *append), at)
          self.assertEqual(steps_of(copies[0]), [0, 1], at)
        isoscope(*append)
        self.assertEqual(steps_of(copies[0]), [0, 1, 2, 3])
        isoscope('verify', copies[0])
        # One replica is enough for a new step; the other goes on with the old ones.
        end = time.monotonic() + PATIENCE_S
        while isoscope('render', '--server', server, *new, '--output', self.path('n.png'), check=False).returncode != 0:
          self.assertLess(time.monotonic(), end, 'the new step is never offered')
          time.sleep(0.1)
        with open(self.path('n.png'), 'rb') as file:
          self.assertEqual(file.read(), self.render(self.path('flow3'), '--field', 'temperature', '--isovalue', '310',
                                                    '--step', '3'))
        # The other copy gets the manifests before the folders, as a careless copy does.
        for shard in sorted(os.listdir(copies[0])):
          if shard.startswith('shard-'):
            shutil.copy(os.path.join(copies[0], shard, 'manifest.json'), os.path.join(copies[1], shard, 'manifest.json'))
        time.sleep(0.5)
        for shard in sorted(os.listdir(copies[0])):
          if shard.startswith('shard-'):
            for volume in sorted(os.listdir(os.path.join(copies[0], shard))):
              target = os.path.join(copies[1], shard, volume)
              if volume.startswith('field-') and not os.path.exists(target):
                shutil.copytree(os.path.join(copies[0], shard, volume), target + '.partial')
                os.rename(target + '.partial', target)
        time.sleep(0.5)
        drawn_before = drawn[0]
        while drawn[0] < drawn_before + 3 and time.monotonic() < end:
          time.sleep(0.05)
      finally:
        stopping.set()
        thread.join()
      self.assertEqual(failures, [])
      self.assertGreater(drawn[0], 3)


if __name__ == '__main__':
  unittest.main()
