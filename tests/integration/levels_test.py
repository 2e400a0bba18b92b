#!/usr/bin/env python3
"""Levels of datasets, by the real programs: made, added, dropped, killed at every step, verified and listed.

    levels_test.py BIN_FOLDER KILL_AT_STEP [unittest arguments]

KILL_AT_STEP is the library of tests/support/kill_at_step.cc.
"""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

BIN = sys.argv.pop(1) if len(sys.argv) > 1 else '.'
KILL_AT_STEP = sys.argv.pop(1) if len(sys.argv) > 1 else ''
PATIENCE_S = 240  # far above what is needed
CUT = ['--shards', '2', '--block-cells', '4x5x6', '--quiet']
VIEW = ['--isovalue', '128', '--renderer', 'cpu', '--width', '96', '--height', '72', '--no-metadata', '--quiet']


def isoscope(*arguments, check=True, kill_at=None):
  environment = dict(os.environ)
  if kill_at is not None:
    environment.update(LD_PRELOAD=KILL_AT_STEP, ISOSCOPE_TEST_KILL_AT=str(kill_at),
                       ASAN_OPTIONS=os.environ.get('ASAN_OPTIONS', '') + ':verify_asan_link_order=0')
  done = subprocess.run([os.path.join(BIN, 'isoscope'), *arguments], capture_output=True, text=True, env=environment,
                        timeout=PATIENCE_S)
  if check and done.returncode != 0:
    raise AssertionError(f'isoscope {" ".join(arguments)}: exit code {done.returncode}\n{done.stderr}')
  return done


def files_below(directory):
  """The digest of each file, by path."""
  digests = {}
  for folder, _, names in os.walk(directory):
    for name in names:
      path = os.path.join(folder, name)
      with open(path, 'rb') as file:
        digests[os.path.relpath(path, directory)] = hashlib.sha256(file.read()).hexdigest()
  return digests


def levels_of(directory):
  return json.loads(isoscope('info', directory, '--json').stdout)['datasets'][0].get('levels', [])


class LevelsTest(unittest.TestCase):

  def setUp(self):
    self.folder = tempfile.mkdtemp()
    self.addCleanup(shutil.rmtree, self.folder)
    self.volume = self.path('v.nrrd')
    isoscope('generate', 'gyroid', '--dims', '41,38,33', '--type', 'uint8', '--output', self.volume, '--quiet')

  def path(self, *names):
    return os.path.join(self.folder, *names)

  def partition(self, parent, *more):
    """A dataset of one name, in a folder of its own."""
    os.makedirs(self.path(parent), exist_ok=True)
    isoscope('partition', self.volume, '--output', self.path(parent, 'd'), *CUT, *more)
    return self.path(parent, 'd')

  def picture(self, dataset, *more):
    isoscope('render', dataset, *VIEW, *more, '--output', self.path('p.png'))
    with open(self.path('p.png'), 'rb') as file:
      return file.read()

  def test_added_levels_are_those_of_partitioning_and_dropped_ones_leave_nothing(self):
    expected = self.partition('expected', '--levels', '2')
    added = self.partition('added')
    before = files_below(added)
    said = isoscope('partition', '--add-levels', added, '--levels', '2').stdout
    self.assertIn('has levels 1 to 2', said)
    self.assertIn('agents that serve it show them after a restart', said)
    self.assertEqual(files_below(added), files_below(expected))
    self.assertEqual(self.picture(added), self.picture(expected))
    said = isoscope('partition', '--drop-levels', added).stdout
    self.assertIn('has no levels; agents that serve it show those that it had until a restart', said)
    self.assertEqual(files_below(added), before)

  def test_any_memory_limit_and_threads_give_the_same(self):
    expected = files_below(self.partition('one', '--levels', '2'))
    self.assertEqual(files_below(self.partition('two', '--levels', '2', '--memory-limit', '64MiB')), expected)
    again = self.partition('three')
    isoscope('partition', '--add-levels', again, '--levels', '2', '--memory-limit', '64MiB')
    self.assertEqual(files_below(again), expected)

  def test_info_lists_levels_and_verify_reads_them(self):
    dataset = self.partition('one', '--levels', '2')
    levels = levels_of(dataset)
    self.assertEqual([level['sample_dims'] for level in levels], [[20, 19, 16], [10, 9, 8]])
    self.assertEqual([level['sample_type'] for level in levels], ['uint16', 'uint16'])
    self.assertIn('level 2       10 x 9 x 8 samples of uint16', isoscope('info', dataset).stdout)
    isoscope('verify', dataset)
    blocks = os.path.join(dataset, 'shard-00001-of-00002', 'level_2', 'blocks.bin')
    with open(blocks, 'r+b') as file:
      file.write(b'damaged')
    done = isoscope('verify', dataset, check=False)
    self.assertNotEqual(done.returncode, 0)
    self.assertIn('level_2', done.stdout + done.stderr)
    shutil.rmtree(os.path.dirname(blocks))
    self.assertEqual([level['missing_shards'] for level in levels_of(dataset)], [[], [1]])
    # What is left is drawn, and the level is made again.
    self.picture(dataset)
    isoscope('partition', '--add-levels', dataset, '--levels', '2')
    isoscope('verify', dataset)

  def test_a_small_volume_gets_none_unless_they_are_asked_for(self):
    self.assertEqual(levels_of(self.partition('auto')), [])
    self.assertEqual(levels_of(self.partition('none', '--levels', 'none')), [])
    self.assertEqual(len(levels_of(self.partition('three', '--levels', '1'))), 1)
    done = isoscope('partition', self.volume, '--output', self.path('many'), *CUT, '--levels', '7', check=False)
    self.assertNotEqual(done.returncode, 0)
    self.assertIn('are possible', done.stderr)

  def test_a_level_is_drawn_alike_from_any_cut_and_as_the_spacing_chooses_it(self):
    dataset = self.partition('two', '--levels', '2')
    whole = self.picture(dataset)
    pictures = [self.picture(dataset, '--level', str(level)) for level in range(3)]
    self.assertEqual(pictures[0], whole)
    self.assertEqual(len(set(pictures)), 3)
    self.assertEqual(self.picture(dataset, '--max-spacing', '0.001'), whole)
    self.assertEqual(self.picture(dataset, '--max-spacing', '1000'), pictures[2])
    isoscope('partition', self.volume, '--output', self.path('one'), '--block-cells', '8', '--levels', '2', '--quiet')
    self.assertEqual([self.picture(self.path('one'), '--level', str(level)) for level in range(3)], pictures)

  def test_a_level_that_is_missing_is_refused_and_a_choice_without_it_is_drawn(self):
    dataset = self.partition('two', '--levels', '2')
    first = self.picture(dataset, '--level', '1')
    shutil.rmtree(os.path.join(dataset, 'shard-00001-of-00002', 'level_2'))
    done = isoscope('render', dataset, *VIEW, '--level', '2', '--output', self.path('no.png'), check=False)
    self.assertNotEqual(done.returncode, 0)
    self.assertIn('level is 2', done.stderr)
    self.assertFalse(os.path.exists(self.path('no.png')))
    self.assertEqual(self.picture(dataset, '--max-spacing', '1000'), first)

  def test_statistics_tell_what_a_level_hides_unless_measures_are_not_wanted(self):
    dataset = self.partition('two', '--levels', '2')
    for more in [], ['--no-measures']:
      isoscope('render', dataset, *VIEW, '--level', '2', '--stats', self.path('s.json'), *more, '--output',
               self.path('p.png'))
      with open(self.path('s.json'), encoding='utf-8') as file:
        self.assertEqual('unresolved_block_count' in json.load(file)['frames'][0], not more)

  def test_info_tells_what_a_frame_of_each_level_costs(self):
    def surfaces(dataset, *more):
      return json.loads(isoscope('info', dataset, '--isovalue', '128', '--json', *more).stdout)['measures']['surfaces']

    self.assertNotIn('levels', surfaces(self.partition('none'))[0])
    dataset = self.partition('two', '--levels', '2')
    levels = surfaces(dataset, '--isovalue', '100')[0]['levels']
    self.assertEqual([level['level'] for level in levels], [0, 1, 2])
    for finer, coarser in zip(levels, levels[1:]):
      self.assertGreater(finer['triangle_count'], coarser['triangle_count'])
      self.assertGreater(finer['active_block_count'], coarser['active_block_count'])
      self.assertGreater(coarser['triangle_count'], 0)
    self.assertIn('by level (render --level N)', isoscope('info', dataset, '--isovalue', '128').stdout)
    labels = self.partition('labels', '--levels', '1', '--label-levels')
    self.assertNotIn('levels', surfaces(labels)[0])

  def test_labels_get_their_most_frequent_values(self):
    dataset = self.partition('labels', '--levels', '1', '--label-levels')
    self.assertEqual([(level['filter'], level['sample_type']) for level in levels_of(dataset)], [('majority', 'uint8')])

  def test_cropped_and_strided_sources_have_the_levels_of_what_is_left(self):
    dims = (30, 28, 26)
    samples = bytes((x * x + 7 * y + 3 * z * y) % 251
                    for z in range(dims[2]) for y in range(dims[1]) for x in range(dims[0]))
    cut = bytes(samples[(z * dims[1] + y) * dims[0] + x]
                for z in range(2, 26, 2) for y in range(3, 27, 2) for x in range(4, 30, 2))
    for name, content in (('whole.raw', samples), ('cut.raw', cut)):
      with open(self.path(name), 'wb') as file:
        file.write(content)
    isoscope('partition', self.path('whole.raw'), '--dims', '30,28,26', '--type', 'uint8', '--crop',
             '4:30,3:27,2:26', '--stride', '2', '--output', self.path('a'), *CUT, '--levels', '1')
    isoscope('partition', self.path('cut.raw'), '--dims', '13,12,12', '--type', 'uint8', '--output', self.path('b'),
             *CUT, '--levels', '1')
    for shard in ('shard-00000-of-00002', 'shard-00001-of-00002'):
      for name in ('blocks.bin', 'ranges.bin', 'interval_tree.bin', 'block_index.bin'):
        with open(self.path('a', shard, 'level_1', name), 'rb') as a, \
             open(self.path('b', shard, 'level_1', name), 'rb') as b:
          self.assertEqual(a.read(), b.read(), f'{shard} {name}')

  def test_a_run_that_is_killed_anywhere_leaves_a_dataset_that_draws_and_is_mended(self):
    expected = files_below(self.partition('expected', '--levels', '1'))
    plain = self.partition('plain')
    before = files_below(plain)
    drawn = self.picture(plain)
    for action, source, done in (('--add-levels', plain, expected),
                                 ('--drop-levels', self.path('expected', 'd'), before)):
      killed = 0
      for step in range(1, 200):
        dataset = self.path('broken', 'd')
        shutil.rmtree(dataset, ignore_errors=True)
        shutil.copytree(source, dataset)
        levels = ['--levels', '1'] if action == '--add-levels' else []
        run = isoscope('partition', action, dataset, *levels, '--quiet', check=False, kill_at=step)
        if run.returncode == 0:
          break
        self.assertEqual(run.returncode, -signal.SIGKILL, run.stderr)
        killed += 1
        self.assertEqual(self.picture(dataset), drawn, f'{action} {step}')
        isoscope('partition', action, dataset, *levels, '--quiet')
        self.assertEqual(files_below(dataset), done, f'{action} {step}')
      self.assertGreater(killed, 4)
      self.assertLess(killed, 199)
      self.assertEqual(files_below(dataset), done)

  def test_a_series_gets_levels_and_appended_steps_have_them(self):
    for step in (0, 1):
      isoscope('generate', 'gyroid', '--dims', '24,22,20', '--type', 'uint8', '--periods', str(step + 2), '--output',
               self.path(f's{step}.nrrd'), '--quiet')
    os.makedirs(self.path('one'))
    series = self.path('one', 'd')
    isoscope('partition', self.path('s0.nrrd'), '--field', 'v', '--time', '0', '--output', series, *CUT)
    said = isoscope('partition', '--add-levels', series, '--levels', '1').stdout
    self.assertIn('agents that serve it find them by themselves', said)
    isoscope('partition', self.path('s1.nrrd'), '--field', 'v', '--time', '1', '--append', series, '--quiet')
    self.assertEqual([level['volume_count'] for level in levels_of(series)], [2])
    isoscope('verify', series)
    for step in (0, 1):
      alone = self.path(f'alone{step}')
      isoscope('partition', self.path(f's{step}.nrrd'), '--output', alone, *CUT, '--levels', '1')
      self.assertEqual(self.picture(series, '--step', str(step), '--level', '1'), self.picture(alone, '--level', '1'))
    self.assertEqual(sum(path.endswith('level_1/manifest.json') for path in files_below(series)), 4)
    isoscope('partition', '--drop-levels', series)
    self.assertEqual(levels_of(series), [])
    isoscope('verify', series)


if __name__ == '__main__':
  unittest.main()
