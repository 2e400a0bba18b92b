#!/usr/bin/env python3
"""Datasets that are cut in parts, by the real programs: bytes against those of one process, parts that are killed at
every step, repeated or run at once, parts that do not fit each other, and what `info` says of them.

    parts_test.py BIN_FOLDER KILL_AT_STEP [unittest arguments]

KILL_AT_STEP is the library of tests/support/kill_at_step.cc.
"""

import array
import gzip
import hashlib
import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

BIN = sys.argv.pop(1) if len(sys.argv) > 1 else '.'
KILL_AT_STEP = sys.argv.pop(1) if len(sys.argv) > 1 else ''
PATIENCE_S = 240  # far above what is needed


def environment(kill_at=None, stop_at=None):
  variables = dict(os.environ)
  for name, step in (('KILL', kill_at), ('STOP', stop_at)):
    if step is not None:
      variables.update({'LD_PRELOAD': KILL_AT_STEP, f'ISOSCOPE_TEST_{name}_AT': str(step),
                        'ASAN_OPTIONS': os.environ.get('ASAN_OPTIONS', '') + ':verify_asan_link_order=0'})
  return variables


def isoscope(*arguments, check=True, kill_at=None):
  done = subprocess.run([os.path.join(BIN, 'isoscope'), *arguments], capture_output=True, text=True,
                        env=environment(kill_at), timeout=PATIENCE_S)
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


class PartsTest(unittest.TestCase):

  def setUp(self):
    self.folder = tempfile.mkdtemp()
    self.addCleanup(shutil.rmtree, self.folder)

  def path(self, *names):
    return os.path.join(self.folder, *names)

  def volume(self, name='v.nrrd', dims='41,38,43', sample_type='uint8', shape='gyroid'):
    isoscope('generate', shape, '--dims', dims, '--type', sample_type, '--output', self.path(name), '--quiet')
    return self.path(name)

  def floats(self, dims=(23, 21, 37), seed=3):
    """A raw volume with NaN and infinite samples, all NaN in some slabs; and the flags that open it."""
    numbers = random.Random(seed)
    samples = array.array('f')
    for z in range(dims[2]):
      for _ in range(dims[0] * dims[1]):
        samples.append(math.nan if z < 9 or numbers.random() < 0.02 else
                       math.inf if z > 30 and numbers.random() < 0.01 else numbers.gauss(0, 10 ** (z / 9)))
    if sys.byteorder == 'big':
      samples.byteswap()
    with open(self.path('floats.raw'), 'wb') as file:
      samples.tofile(file)
    return self.path('floats.raw'), ['--dims', ','.join(map(str, dims)), '--type', 'float32']

  def packed(self, dims=(33, 30, 35)):
    """A volume that can only be read from its start."""
    samples = bytes((x * y + 5 * z * x + 3 * y) % 241
                    for z in range(dims[2]) for y in range(dims[1]) for x in range(dims[0]))
    with open(self.path('z.nrrd'), 'wb') as file:
      file.write(b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 33 30 35\nencoding: gzip\n\n' + gzip.compress(samples))
    return self.path('z.nrrd')

  def one(self, source, *flags):
    """The dataset that one process makes; all datasets have one name."""
    os.makedirs(self.path('one'), exist_ok=True)
    shutil.rmtree(self.path('one', 'd'), ignore_errors=True)
    isoscope('partition', source, '--output', self.path('one', 'd'), '--quiet', *flags)
    return files_below(self.path('one', 'd'))

  def part(self, source, index, count, *flags, parent='many', **more):
    os.makedirs(self.path(parent), exist_ok=True)
    return isoscope('partition', source, '--part', f'{index}/{count}', '--output', self.path(parent, 'd'), '--quiet',
                    *flags, **more)

  def finish(self, parent='many', *flags, **more):
    return isoscope('partition', '--finish', self.path(parent, 'd'), '--quiet', *flags, **more)

  def joined(self, parent='many'):
    """The joined dataset's files; nothing else is left in the folder."""
    self.assertEqual(os.listdir(self.path(parent)), ['d'])
    return files_below(self.path(parent, 'd'))

  def many(self, source, count, *flags, order=None):
    shutil.rmtree(self.path('many'), ignore_errors=True)
    for index in order or range(count):
      self.part(source, index, count, *flags)
    self.finish()
    return self.joined()

  def assert_alike(self, source, counts, *flags):
    expected = self.one(source, *flags)
    for count in counts:
      with self.subTest(parts=count, flags=flags):
        self.assertEqual(self.many(source, count, *flags), expected)

  # ---- Bytes.

  def test_bytes_are_those_of_one_process_for_any_cut(self):
    volume = self.volume()
    self.assert_alike(volume, (1, 2, 3, 16), '--shards', '3', '--block-cells', '4x5x3')
    self.assert_alike(volume, (2, 4), '--block-cells', '3', '--seed', '7', '--shards', '5', '--levels', '2')
    self.assert_alike(volume, (3,), '--block-cells', '2x9x4', '--shards', '40', '--levels', '1')
    self.assert_alike(volume, (2,), '--block-cells', '5x4x3', '--shards', '2', '--levels', '1', '--label-levels')

  def test_bytes_are_those_of_one_process_for_any_encoding_and_memory(self):
    volume = self.volume(sample_type='uint16')
    for encoding in ('lz4', 'zstd', 'packed'):
      self.assert_alike(volume, (2, 3), '--shards', '2', '--block-cells', '4', '--compression', encoding,
                        '--levels', '1')
    expected = self.one(volume, '--block-cells', '4', '--shards', '2', '--levels', '1')
    shutil.rmtree(self.path('many'))
    for index in range(3):
      self.part(volume, index, 3, '--block-cells', '4', '--shards', '2', '--levels', '1', '--memory-limit', '56MiB')
    self.finish('many', '--memory-limit', '56MiB')
    self.assertEqual(self.joined(), expected)

  def test_bytes_are_those_of_one_process_with_nan_and_infinite_samples(self):
    source, flags = self.floats()
    self.assert_alike(source, (1, 2, 5), *flags, '--shards', '2', '--block-cells', '4x3x2', '--levels', '2')

  def test_bytes_are_those_of_one_process_of_a_cropped_and_strided_source(self):
    dims = (30, 28, 36)
    with open(self.path('v.raw'), 'wb') as file:
      file.write(bytes((x * x + 7 * y + 3 * z * y) % 251
                       for z in range(dims[2]) for y in range(dims[1]) for x in range(dims[0])))
    self.assert_alike(self.path('v.raw'), (2, 3), '--dims', '30,28,36', '--type', 'uint8', '--crop', '3:30,2:27,1:36',
                      '--stride', '2', '--shards', '2', '--block-cells', '3x4x2', '--levels', '1')

  def test_bytes_are_those_of_one_process_of_a_compressed_source(self):
    source = self.packed()
    self.assert_alike(source, (3,), '--shards', '2', '--block-cells', '4', '--levels', '1')

  def test_bytes_are_those_of_one_process_of_series(self):
    volume = self.volume(dims='25,22,30')
    self.assert_alike(volume, (1, 3), '--time', '4.5', '--shards', '2', '--block-cells', '4x5x3', '--levels', '1')

  def test_bytes_are_those_of_one_process_of_fields_components_and_steps(self):
    isoscope('generate', 'flow', '--dims', '20,18,26', '--steps', '2', '--output', self.path('flow.pvd'), '--quiet')
    self.assert_alike(self.path('flow.pvd'), (1, 2), '--shards', '2', '--block-cells', '4x5x3', '--levels', '1')

  def test_labels_of_a_file_reach_the_dataset(self):
    volume = self.volume()
    with open(self.path('names.txt'), 'w', encoding='utf-8') as file:
      file.write('0 0 0 0 0 0 0 "outside"\n1 255 0 0 1 1 1 "one"\n')
    self.assert_alike(volume, (2,), '--label-names', self.path('names.txt'), '--block-cells', '4', '--levels', '1')

  # ---- Repeated, killed, at once.

  def test_parts_may_come_in_any_order_and_be_repeated(self):
    volume = self.volume()
    cut = ['--shards', '2', '--block-cells', '3', '--levels', '1']
    expected = self.one(volume, *cut)
    for index in (3, 0, 3, 2, 0, 1, 1):
      self.part(volume, index, 4, *cut)
    said = isoscope('partition', volume, '--part', '2/4', '--output', self.path('many', 'd'), *cut).stdout
    self.assertIn('part 2 of 4 was finished before', said)
    self.finish()
    self.assertEqual(self.joined(), expected)
    # Again: nothing is left to do.
    self.assertIn('was finished before', isoscope('partition', '--finish', self.path('many', 'd')).stdout)
    done = self.part(volume, 1, 4, *cut, check=False)
    self.assertEqual(done.returncode, 1)
    self.assertIn('ALREADY_EXISTS', done.stderr)

  def test_a_part_that_is_killed_anywhere_is_run_again(self):
    volume = self.volume(dims='21,20,33')
    cut = ['--shards', '2', '--block-cells', '3', '--levels', '1']
    expected = self.one(volume, *cut)
    self.part(volume, 0, 2, *cut)
    shutil.copytree(self.path('many'), self.path('half'))
    killed = 0
    for step in range(1, 400):
      shutil.rmtree(self.path('many'))
      shutil.copytree(self.path('half'), self.path('many'))
      run = self.part(volume, 1, 2, *cut, check=False, kill_at=step)
      if run.returncode == 0:
        break
      self.assertEqual(run.returncode, -signal.SIGKILL, run.stderr)
      killed += 1
      self.part(volume, 1, 2, *cut)
      self.finish()
      self.assertEqual(self.joined(), expected, f'step {step}')
    else:
      self.fail('never ended')
    self.assertGreater(killed, 8)

  def test_joining_that_is_killed_anywhere_is_run_again(self):
    volume = self.volume(dims='21,20,33')
    cut = ['--shards', '2', '--block-cells', '3', '--levels', '1']
    expected = self.one(volume, *cut)
    for index in range(2):
      self.part(volume, index, 2, *cut)
    shutil.copytree(self.path('many'), self.path('parts'))
    killed = 0
    for step in range(1, 400):
      shutil.rmtree(self.path('many'))
      shutil.copytree(self.path('parts'), self.path('many'))
      run = self.finish(check=False, kill_at=step)
      if run.returncode == 0:
        break
      self.assertEqual(run.returncode, -signal.SIGKILL, run.stderr)
      killed += 1
      self.finish()
      self.assertEqual(files_below(self.path('many', 'd')), expected, f'step {step}')
      self.assertFalse(os.path.exists(self.path('many', 'd.partial', 'parts')), f'step {step}')
    else:
      self.fail('never ended')
    self.assertGreater(killed, 20)

  def test_parts_run_at_once_and_the_same_part_twice(self):
    volume = self.volume(dims='64,60,70')
    cut = ['--shards', '3', '--block-cells', '4', '--levels', '1']
    expected = self.one(volume, *cut)
    os.makedirs(self.path('many'))
    for _ in range(3):
      shutil.rmtree(self.path('many'))
      os.makedirs(self.path('many'))
      running = [subprocess.Popen([os.path.join(BIN, 'isoscope'), 'partition', volume, '--part', f'{index}/4',
                                   '--output', self.path('many', 'd'), '--quiet', *cut],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                 for index in (0, 1, 2, 3, 1, 3)]
      for process in running:
        _, said = process.communicate(timeout=PATIENCE_S)
        self.assertEqual(process.returncode, 0, said)
      self.finish()
      self.assertEqual(self.joined(), expected)

  def hung(self, source, index, count, *cut):
    """A run of a part that stops while it writes, as on a node that hangs."""
    process = subprocess.Popen([os.path.join(BIN, 'isoscope'), 'partition', source, '--part', f'{index}/{count}',
                                '--output', self.path('many', 'd'), '--quiet', *cut], env=environment(stop_at='progress.json'),
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    self.addCleanup(process.kill)
    self.assertEqual(os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT).si_code, os.CLD_STOPPED)
    try_of_part = f'part-{index:05}-of-{count:05}.try-'
    self.assertTrue(any(name.startswith(try_of_part) for _, folders, _ in os.walk(self.path('many')) for name in folders))
    return process

  def test_a_part_whose_node_dies_or_hangs_is_run_elsewhere(self):
    volume = self.volume(dims='120,110,130')
    cut = ['--shards', '2', '--block-cells', '4', '--levels', '1']
    expected = self.one(volume, *cut)
    for fate in ('dies', 'wakes before the parts are joined', 'wakes afterwards'):
      with self.subTest(fate=fate):
        shutil.rmtree(self.path('many'), ignore_errors=True)
        self.part(volume, 0, 2, *cut)
        node = self.hung(volume, 1, 2, *cut)
        self.part(volume, 1, 2, *cut)
        if fate == 'dies':
          node.kill()
          node.communicate(timeout=PATIENCE_S)
        elif fate == 'wakes before the parts are joined':
          node.send_signal(signal.SIGCONT)
          _, said = node.communicate(timeout=PATIENCE_S)
          self.assertEqual(node.returncode, 0, said)
        self.finish()
        if fate == 'wakes afterwards':
          node.send_signal(signal.SIGCONT)
          _, said = node.communicate(timeout=PATIENCE_S)
          self.assertEqual(node.returncode, 1, said)
        self.assertEqual(self.joined(), expected)

  def killed(self, moment_s, *arguments):
    """Runs a command and kills it after some time. False if it had ended before."""
    process = subprocess.Popen([os.path.join(BIN, 'isoscope'), 'partition', *arguments, '--quiet'],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
      _, said = process.communicate(timeout=moment_s)
    except subprocess.TimeoutExpired:
      process.kill()
      process.communicate(timeout=PATIENCE_S)
      return True
    self.assertEqual(process.returncode, 0, said)
    return False

  def remove_unlocked(self):
    """Removes what a process leaves that is killed before it has locked its folder: others wait ten minutes."""
    for name in os.listdir(self.path('many')):
      if name.startswith('d.partial-') and set(os.listdir(self.path('many', name))) <= {'lock.new'}:
        shutil.rmtree(self.path('many', name))

  def kill_at_random(self, moments, source, count, cut, kills):
    """Cuts one dataset in parts; `kills` of the processes that do so are killed. Returns how many were."""
    shutil.rmtree(self.path('many'), ignore_errors=True)
    os.makedirs(self.path('many'))
    done = 0
    begin = time.monotonic()
    self.part(source, 0, count, *cut, parent='timed')
    part_s = time.monotonic() - begin
    shutil.rmtree(self.path('timed'))
    # Two thirds of them are parts, the same ones again and again.
    for _ in range(max(kills - kills // 3, 1)):
      index = moments.randrange(count)
      done += self.killed(moments.uniform(0, part_s), source, '--part', f'{index}/{count}', '--output',
                          self.path('many', 'd'), *cut)
    for index in moments.sample(range(count), count):
      self.part(source, index, count, *cut)
    begin = time.monotonic()
    shutil.copytree(self.path('many'), self.path('timed'))
    self.finish('timed')
    finish_s = time.monotonic() - begin
    shutil.rmtree(self.path('timed'))
    for _ in range(kills // 3):
      if not self.killed(moments.uniform(0, finish_s), '--finish', self.path('many', 'd')):
        return done  # it has ended
      done += 1
    self.finish()
    return done

  def test_parts_that_are_killed_at_random_moments_end_in_the_same_bytes(self):
    # scripts/soak.sh --parts sets both.
    wanted = int(os.environ.get('ISOSCOPE_SOAK_KILLS', '6'))
    seed = int(os.environ.get('ISOSCOPE_SOAK_SEED', '46'))
    moments = random.Random(seed)
    volume = self.volume(dims='24,22,202')  # 67 layers of blocks: 17 slabs
    isoscope('generate', 'flow', '--dims', '12,11,70', '--steps', '2', '--output', self.path('flow.pvd'), '--quiet')
    cut = ['--shards', '2', '--block-cells', '3', '--levels', '1']
    for count in (1, 4, 16):
      expected = {source: self.one(source, *cut) for source in (volume, self.path('flow.pvd'))}
      killed = datasets = 0
      while killed < wanted:
        source = self.path('flow.pvd') if datasets % 4 == 3 else volume
        killed += self.kill_at_random(moments, source, count, cut, min(12, wanted))
        datasets += 1
        self.remove_unlocked()
        self.assertEqual(self.joined(), expected[source], f'{count} parts, dataset {datasets}, seed {seed}')
      print(f'{count} parts: {killed} processes killed, {datasets} datasets, 0 differences, seed {seed}')

  def test_an_interrupt_leaves_finished_parts_alone(self):
    volume = self.volume(dims='96,96,96')
    cut = ['--shards', '2', '--block-cells', '3']
    self.part(volume, 0, 2, *cut)
    before = files_below(self.path('many'))
    process = subprocess.Popen([os.path.join(BIN, 'isoscope'), 'partition', volume, '--part', '1/2', '--output',
                                self.path('many', 'd'), '--quiet', *cut],
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    pieces = self.path('many', 'd.partial', 'parts', 'volume')
    while process.poll() is None and not any('.try-' in name for name in os.listdir(pieces)):
      pass
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE_S)
    if process.returncode == 0:
      return  # the part was finished first
    self.assertIn('the same command cuts the rest', said)
    after = files_below(self.path('many'))
    self.assertEqual({name: digest for name, digest in after.items() if 'part-00001-of-00002.json' not in name}, before)

  # ---- What does not fit.

  def refused(self, done, *words):
    self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
    for word in words:
      self.assertIn(word, done.stderr)

  def test_parts_of_other_sources_and_flags_are_refused_by_name(self):
    volume = self.volume()
    cut = ['--shards', '2', '--block-cells', '4']
    self.part(volume, 0, 2, *cut)
    for flags, words in ((['--shards', '3', '--block-cells', '4'], ('--shards is 2 there and 3 here',)),
                         (['--shards', '2', '--block-cells', '5'], ('--block-cells is 4 x 4 x 4 there',)),
                         ([*cut, '--seed', '9'], ('--seed is 1 there and 9 here',)),
                         ([*cut, '--levels', '1'], ('--levels is auto there and 1 here',)),
                         ([*cut, '--compression', 'lz4'], ('--compression is none there and lz4 here',)),
                         ([*cut, '--stride', '2'], ('stride',))):
      self.refused(self.part(volume, 1, 2, *flags, check=False), 'FAILED_PRECONDITION', *words)
    self.refused(self.part(volume, 1, 3, *cut, check=False), 'the number of parts is 2 there and 3 here')
    other = self.volume('other.nrrd', shape='shells')
    self.refused(self.part(other, 1, 2, *cut, check=False), 'the source is v.nrrd there and other.nrrd here')
    os.rename(other, volume)
    self.refused(self.part(volume, 1, 2, *cut, check=False), 'file v.nrrd is', 'last changed')

  def test_a_copy_of_the_source_elsewhere_is_the_same_source(self):
    volume = self.volume()
    cut = ['--shards', '2', '--block-cells', '4']
    expected = self.one(volume, *cut)
    os.makedirs(self.path('elsewhere'))
    copy = shutil.copy2(volume, self.path('elsewhere'))
    self.part(volume, 0, 2, *cut)
    self.part(copy, 1, 2, *cut)
    self.finish()
    self.assertEqual(self.joined(), expected)

  def test_missing_parts_are_named_with_the_command(self):
    volume = self.volume()
    self.refused(self.finish(check=False), 'NOT_FOUND', '--part I/N')
    for index in (1, 3):
      self.part(volume, index, 5, '--block-cells', '2')
    self.refused(self.finish(check=False), 'parts 0, 2 and 4 of 5 are not finished', '--part 0/5')
    for index in (0, 2):
      self.part(volume, index, 5, '--block-cells', '2')
    self.refused(self.finish(check=False), 'part 4 of 5 is not finished', '--part 4/5', 'd.partial')

  def test_damaged_pieces_are_named(self):
    volume = self.volume()
    cut = ['--shards', '2', '--block-cells', '4', '--levels', '1']
    for index in range(2):
      self.part(volume, index, 2, *cut)
    shutil.copytree(self.path('many'), self.path('whole'))
    piece = ('many', 'd.partial', 'parts', 'volume', 'part-00001-of-00002')
    for names in (('shard-00000-of-00002', 'blocks.bin'), ('shard-00001-of-00002', 'block_index.bin'),
                  ('shard-00001-of-00002', 'spans.bin'), ('shard-00000-of-00002', 'histogram.bin'), ('ranges.bin',),
                  ('level_1.bin',), ('piece.json',)):
      path = self.path(*piece, *names)
      with open(path, 'r+b') as file:
        file.seek(os.path.getsize(path) // 2)
        byte = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte[0] ^ 1]))
      self.refused(self.finish(check=False), 'DATA_LOSS', names[-1])
      self.assertEqual(os.listdir(self.path('many')), ['d.partial'])
      shutil.rmtree(self.path('many'))
      shutil.copytree(self.path('whole'), self.path('many'))
    shutil.rmtree(self.path(*piece))
    self.part(volume, 1, 2, *cut)
    self.finish()
    self.assertEqual(self.joined(), self.one(volume, *cut))

  def test_flags_that_do_not_go_with_parts_are_refused(self):
    volume = self.volume()
    output = self.path('d')
    for flags in (['--part', '2/2', '--output', output], ['--part', 'x', '--output', output],
                  ['--part', '0/2'], ['--part', '0/2', '--append', output],
                  ['--part', '0/2', '--output', output, '--resume'],
                  ['--part', '0/2', '--output', output, '--distribution', 'greedy'],
                  ['--finish', output]):
      self.assertEqual(isoscope('partition', volume, *flags, check=False).returncode, 2, flags)
    for flags in (['--shards', '2'], ['--levels', '1'], ['--compression', 'lz4'], ['--part', '0/2'],
                  ['--add-levels', output]):
      self.assertEqual(isoscope('partition', '--finish', output, *flags, check=False).returncode, 2, flags)

  def test_runs_without_parts_and_parts_do_not_share_a_folder(self):
    volume = self.volume(dims='25,22,30')
    self.part(volume, 0, 2, '--time', '1')
    self.refused(isoscope('partition', volume, '--time', '1', '--output', self.path('many', 'd'), check=False),
                 'FAILED_PRECONDITION', '--finish')
    os.makedirs(self.path('other', 'd.partial', 'finished'))
    self.refused(self.part(volume, 0, 2, '--time', '1', parent='other', check=False), 'FAILED_PRECONDITION',
                 'without --part')

  def test_another_dataset_of_the_name_is_not_replaced(self):
    volume = self.volume()
    self.part(volume, 0, 1, '--block-cells', '4')
    os.makedirs(self.path('many', 'd'))
    self.refused(self.finish(check=False), 'ALREADY_EXISTS')
    self.assertTrue(os.path.isdir(self.path('many', 'd.partial', 'parts')))

  # ---- Progress.

  def test_info_tells_how_far_all_parts_are(self):
    volume = self.volume()
    for index in (0, 2):
      self.part(volume, index, 3, '--block-cells', '3')
    partial = self.path('many', 'd.partial')
    for path in (partial, partial + '/', self.path('many', 'd')):
      text = isoscope('info', path).stdout
      self.assertIn('2 of 3 finished', text)
      self.assertIn('not begun', text)
      self.assertIn('--part 1/3', text)
    parts = json.loads(isoscope('info', partial, '--json').stdout)['parts']
    self.assertEqual((parts['part_count'], parts['finished_count'], parts['volume_count']), (3, 2, 1))
    self.assertEqual([part['state'] for part in parts['parts']], ['finished', 'waiting', 'finished'])
    # A process that was killed: its news get old.
    run = self.part(volume, 1, 3, '--block-cells', '3', check=False, kill_at='part-00001-of-00003')
    self.assertEqual(run.returncode, -signal.SIGKILL)
    self.assertEqual(json.loads(isoscope('info', partial, '--json').stdout)['parts']['finished_count'], 2)
    self.part(volume, 1, 3, '--block-cells', '3')
    self.assertIn('--finish', isoscope('info', partial).stdout)
    self.finish()
    self.assertIn('dataset       d', isoscope('info', self.path('many', 'd')).stdout)
    isoscope('verify', self.path('many', 'd'))

  def test_help_has_an_example(self):
    text = isoscope('partition', '--help').stdout
    self.assertIn('--part 3/16', text)
    self.assertIn('isoscope partition --finish big', text)


if __name__ == '__main__':
  unittest.main()
