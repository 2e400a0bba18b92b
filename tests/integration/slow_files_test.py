#!/usr/bin/env python3
"""Files that do not answer, that are no files, or that vanish while they are served; and memory limits that refusals name.

    slow_files_test.py BIN_FOLDER [unittest arguments]
"""

import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib

BIN = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 else '.')
PATIENCE = 120


def isoscope(*arguments, check=None):
    done = subprocess.run([f'{BIN}/isoscope', *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                          errors='replace', timeout=PATIENCE)
    if check is not None:
        assert done.returncode == check, (arguments, done.returncode, done.stderr)
    return done


def read(path):
    with open(path, encoding='utf-8', errors='replace') as file:
        return file.read()


def png(path, value):
    def chunk(kind, body):
        return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))
    rows = b''.join(b'\0' + bytes([value] * 8) for _ in range(8))
    with open(path, 'wb') as file:
        file.write(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', 8, 8, 8, 0, 0, 0, 0))
                   + chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b''))


def tiff(path, value):
    tags = [(256, 8), (257, 8), (258, 8), (259, 1), (262, 1), (273, 8), (277, 1), (278, 8), (279, 64)]
    directory = struct.pack('<H', len(tags)) + b''.join(struct.pack('<HHII', tag, 4, 1, x) for tag, x in tags)
    with open(path, 'wb') as file:
        file.write(struct.pack('<2sHI', b'II', 42, 72) + bytes([value] * 64) + directory + bytes(4))


class TempCase(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.dir = folder.name
        os.environ['XDG_CACHE_HOME'] = self.path('cache')

    def path(self, *names):
        return os.path.join(self.dir, *names)

    def volume(self, name='v.nrrd', side=16, field='gyroid', *more):
        isoscope('generate', field, '--dims', f'{side},{side},{side}', '--type', 'uint8', '-o', self.path(name), *more,
                 check=0)
        return self.path(name)


class SpecialFiles(TempCase):
    """Nothing waits for the writer of a pipe: each role of a file refuses one by its name."""

    def refuses(self, pipe, *arguments):
        done = isoscope(*arguments)
        self.assertEqual(done.returncode, 1, (arguments, done.stderr))
        self.assertIn(os.path.basename(pipe), done.stderr, arguments)
        self.assertIn('is a pipe (FIFO)', done.stderr, arguments)

    def test_volumes_of_every_name(self):
        for name in ('a.nii', 'a.nii.gz', 'a.nrrd', 'a.mha', 'a.h5', 'a.vtkhdf', 'a.ims', 'a.mrc', 'a.mnc', 'a.mgz',
                     'a.vtk', 'a.vtr', 'a.cube', 'a.tif', 'a.lsm', 'a.vdb', 'a.nc',
                     'a.vti', 'a.pvti', 'a.pvd', 'a.dcm', 'a.png', 'a.unknown'):
            with self.subTest(name):
                os.mkfifo(self.path(name))
                self.refuses(name, 'info', self.path(name))
        self.refuses('a.h5', 'info', self.path('a.h5') + ':/d')
        self.refuses('a.h5', 'partition', self.path('a.h5') + ':/d', '-o', self.path('out'))
        self.refuses('a.h5', 'render', self.path('a.h5') + ':/d', '--isovalue', '1', '-o', self.path('o.png'))
        self.refuses('a.unknown', 'info', self.path('a.unknown'), '--dims', '4,4,4', '--type', 'uint8')
        self.refuses('a.unknown', 'info', self.path('a.unknown'), '--format', 'tiff')

    def test_parts_of_volumes(self):
        volume = self.volume('v.nhdr')
        os.rename(self.path('v.raw'), self.path('kept'))
        os.mkfifo(self.path('v.raw'))
        self.refuses('v.raw', 'info', volume)
        for write, ending in ((png, 'png'), (tiff, 'tif')):
            folder = self.path(ending)
            os.mkdir(folder)
            for i in range(4):
                write(os.path.join(folder, f's{i}.{ending}'), 50 * i)
            isoscope('info', folder, check=0)
            os.unlink(os.path.join(folder, f's2.{ending}'))
            os.mkfifo(os.path.join(folder, f's2.{ending}'))
            self.refuses(f's2.{ending}', 'render', folder, '--isovalue', '60', '-o', self.path('o.png'))

    def test_files_beside_volumes(self):
        volume = self.volume()
        os.mkfifo(self.path('pipe'))
        pipe = self.path('pipe')
        self.refuses('pipe', 'info', volume, '--label-names', pipe)
        self.refuses('pipe', 'render', volume, '--isovalue', '128', '--camera', pipe, '-o', self.path('o.png'))
        self.refuses('pipe', 'render', volume, '--like', pipe, '-o', self.path('o.png'))
        self.refuses('pipe', 'info', '--server', 'localhost:1', '--insecure', '--token-file', pipe)
        self.refuses('pipe', 'info', '--server', 'localhost:1', '--tls-ca', pipe)
        audit = subprocess.run([f'{BIN}/isoscope-coordinator', '--agent', 'localhost:1', '--listen', '127.0.0.1:0',
                                '--audit-log', pipe], capture_output=True, text=True, timeout=PATIENCE)
        self.assertEqual(audit.returncode, 1)
        self.assertIn('is a pipe that nobody reads', audit.stderr)


class Interrupts(TempCase):
    def test_a_command_that_waits_for_a_pipe_ends_at_a_signal_and_leaves_nothing(self):
        volume = self.volume()
        os.mkfifo(self.path('out.ply'))
        before = set(os.listdir(self.dir))
        for number in (signal.SIGTERM, signal.SIGINT):
            process = subprocess.Popen([f'{BIN}/isoscope', 'export', volume, '--isovalue', '128', '-o',
                                        self.path('out.ply')], stderr=subprocess.PIPE, text=True)
            time.sleep(2)  # it waits by then, or a signal ends it earlier
            process.send_signal(number)
            _, err = process.communicate(timeout=PATIENCE)
            self.assertEqual(process.returncode, 128 + number, err)
        self.assertEqual({name for name in os.listdir(self.dir) if name != 'cache'}, before - {'cache'})


class Cluster:
    def __init__(self, *agents):
        self.processes, self.logs, addresses = [], [], []
        for folder in agents:
            addresses.append(self.start('isoscope-agent', folder))
        self.address = self.start('isoscope-coordinator', *[x for a in addresses for x in ('--agent', a)],
                                  '--poll-seconds', '0.2')
        end = time.monotonic() + PATIENCE
        while 'dataset_ready' not in self.log(len(agents)):
            assert time.monotonic() < end, self.log(len(agents))
            time.sleep(0.05)

    def start(self, program, *arguments):
        log = tempfile.NamedTemporaryFile('w+', suffix='.log')
        process = subprocess.Popen([f'{BIN}/{program}', *arguments, '--listen', '127.0.0.1:0'], stderr=log)
        self.processes.append(process)
        self.logs.append(log)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            found = re.search(r'_started .*address=(\S+)', read(log.name))
            if found:
                return found.group(1)
            time.sleep(0.05)
        raise AssertionError(read(log.name))

    def log(self, index):
        return read(self.logs[index].name)

    def stop(self):
        for process in self.processes:
            process.kill()
            process.wait()


class Damage(TempCase):
    """A file of a shard vanishes while it is served."""

    def setUp(self):
        super().setUp()
        isoscope('generate', 'flow', '--dims', '12,12,12', '--steps', '3', '-o', self.path('flow.pvd'), check=0)
        isoscope('partition', self.path('flow.pvd'), '-o', self.path('flow'), check=0)
        self.shard = self.path('flow', 'shard-00000-of-00001')

    def render(self, cluster, step):
        return isoscope('render', '--server', cluster.address, '--field', 'temperature', '--step', str(step), '--isovalue',
                        '300', '--width', '64', '--height', '48', '-o', self.path('o.png'))

    def vanish(self, step):
        for name in os.listdir(self.shard):
            if re.search(rf'0*{step}$', name) and os.path.isdir(os.path.join(self.shard, name)):
                os.rename(os.path.join(self.shard, name), self.path('kept-' + name))

    def restore(self):
        for name in os.listdir(self.dir):
            if name.startswith('kept-'):
                os.rename(self.path(name), os.path.join(self.shard, name[5:]))

    def test_a_step_whose_folder_is_gone_is_damage_without_paths_and_over_once_it_is_back(self):
        cluster = Cluster(self.path('flow'))
        self.addCleanup(cluster.stop)
        self.assertEqual(self.render(cluster, 0).returncode, 0)
        self.vanish(2)
        for _ in range(2):
            failed = self.render(cluster, 2)
            self.assertEqual(failed.returncode, 1)
            self.assertIn('DATA_LOSS', failed.stderr)
            self.assertNotIn(self.dir, failed.stderr)
        self.assertEqual(cluster.log(0).count('shard_damaged'), 1, cluster.log(0))
        self.assertIn(self.shard, cluster.log(0))
        end = time.monotonic() + PATIENCE
        while 'damaged' not in isoscope('top', '--server', cluster.address, '--once').stdout:
            self.assertLess(time.monotonic(), end)
        self.restore()
        self.assertEqual(self.render(cluster, 2).returncode, 0)

    def test_a_sound_replica_takes_over(self):
        shutil.copytree(self.path('flow'), self.path('copy', 'flow'))
        cluster = Cluster(self.path('flow'), self.path('copy', 'flow'))
        self.addCleanup(cluster.stop)
        self.vanish(2)
        for _ in range(4):
            done = self.render(cluster, 2)
            self.assertEqual(done.returncode, 0, done.stderr)


class MemoryLimits(TempCase):
    """The limit that a refusal names is enough, and much less is not."""

    def named(self, *arguments):
        """Follows the advice once. Returns the limit in MiB, or None if 96 MiB were enough."""
        first = isoscope('render', *arguments, '--memory-limit', '96MiB', '-o', self.path('o.png'))
        if first.returncode == 0:
            return None
        found = re.search(r'--memory-limit to (\d+)MiB', first.stderr)
        self.assertIsNotNone(found, first.stderr)
        return int(found.group(1))

    def test_the_limit_that_is_named_works(self):
        volume = self.volume('v.nrrd', 96, 'random')
        at_once = ['--culling', 'mask']  # never in bands
        planes = ['--position', self.path('p.npy'), '--normal', self.path('n.npy'), '--depth', self.path('d.npy')]
        named = 0
        for more in ([], ['--width', '2048', '--height', '1536'], ['--samples', '4'], ['--threads', '1'],
                     ['--threads', '8', '--shards', '4'],
                     ['--surface', '100:#ff0000:0.5', '--surface', '150:#00ff00:0.5', '--max-layers', '4'],
                     ['--width', '2048', '--height', '1536', *at_once], ['--samples', '4', *at_once],
                     ['--surface', '100:#ff0000:0.5', '--surface', '150:#00ff00:0.5', '--max-layers', '4', *at_once],
                     ['--width', '1600', '--height', '1200', *planes]):
            level = [] if '--surface' in more else ['--isovalue', '128']
            with self.subTest(more):
                enough = self.named(volume, *level, *more)
                if enough is None:
                    continue
                named += 1
                done = isoscope('render', volume, *level, *more, '--memory-limit', f'{enough}MiB', '-o',
                                self.path('o.png'))
                self.assertEqual(done.returncode, 0, done.stderr)
                less = isoscope('render', volume, *level, *more, '--memory-limit', f'{max(96, int(enough * 0.9))}MiB',
                                '-o', self.path('o.png'))
                self.assertEqual(less.returncode, 1, more)
        self.assertGreaterEqual(named, 4)


if __name__ == '__main__':
    unittest.main()
