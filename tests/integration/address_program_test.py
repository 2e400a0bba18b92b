#!/usr/bin/env python3
"""Volumes and copies at an address, by the real program: a server that faults, one without ranges, one that wants
signatures, nginx. What comes is what the disk has, and no output holds a secret.

    address_program_test.py BIN_FOLDER STUCK_DISK [unittest arguments]

STUCK_DISK is the library of tests/support/stuck_disk.cc.
"""

import base64
import hashlib
import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
import skips  # noqa: E402
from fault_proxy import FaultProxy, StrangerServer  # noqa: E402
from free_ports import free_port  # noqa: E402
from object_server import ObjectServer  # noqa: E402

BIN = sys.argv.pop(1) if len(sys.argv) > 1 else '.'
STUCK_DISK = sys.argv.pop(1) if len(sys.argv) > 1 else ''
PATIENCE_S = 240  # far above what is needed
DIMS = (48, 40, 36)
CUT = ['--block-cells', '8', '--quiet']
SECRETS = ['S3cr3tAccessKeyValue', 'S3ss10nT0kenValue', 'B3ar3rT0kenValue', 'N3trcPassw0rd', 'S1gnatur3Value']


def files_below(directory):
  """The digest of each file, by path."""
  digests = {}
  for folder, _, names in os.walk(directory):
    for name in names:
      path = os.path.join(folder, name)
      with open(path, 'rb') as file:
        digests[os.path.relpath(path, directory)] = hashlib.sha256(file.read()).hexdigest()
  return digests


def lines_of(path):
  with open(path, encoding='utf-8') as file:
    return file.readlines()


def bytes_of(path):
  with open(path, 'rb') as file:
    return file.read()


def write_zarr(path, samples):
  """A store of Zarr 2: chunks of 16 x 16 x 16 without a codec, some of them missing."""
  nx, ny, nz = DIMS
  os.makedirs(path)
  with open(os.path.join(path, '.zgroup'), 'w') as file:
    file.write('{"zarr_format": 2}')
  os.makedirs(os.path.join(path, 'a'))
  with open(os.path.join(path, 'a', '.zarray'), 'w') as file:
    json.dump({'zarr_format': 2, 'shape': [nz, ny, nx], 'chunks': [16, 16, 16], 'dtype': '|u1', 'order': 'C',
               'compressor': None, 'filters': None, 'fill_value': 7}, file)
  for z in range(0, nz, 16):
    for y in range(0, ny, 16):
      for x in range(0, nx, 16):
        if (x, y, z) == (16, 16, 16):
          continue
        chunk = bytearray(16 ** 3)
        for dz in range(min(16, nz - z)):
          for dy in range(min(16, ny - y)):
            begin = ((z + dz) * ny + y + dy) * nx + x
            row = samples[begin:begin + min(16, nx - x)]
            chunk[(dz * 16 + dy) * 16:(dz * 16 + dy) * 16 + len(row)] = row
        with open(os.path.join(path, 'a', f'{z // 16}.{y // 16}.{x // 16}'), 'wb') as file:
          file.write(chunk)


def write_hdf5(folder, samples):
  """v.h5, a dataset in chunks and one without, and n.nc, as netCDF-4 writes it: packed. Returns false without h5py."""
  try:
    import h5py
    import numpy
  except ImportError:
    return False
  values = numpy.frombuffer(samples, 'u1').reshape(DIMS[::-1])
  with h5py.File(os.path.join(folder, 'v.h5'), 'w') as file:
    file.create_dataset('d', data=values, chunks=(9, 16, 7), compression=4)
    file.create_dataset('whole', data=values)
  with h5py.File(os.path.join(folder, 'n.nc'), 'w') as file:
    file.attrs['_NCProperties'] = numpy.string_('version=2,netcdf=4.9.0,hdf5=1.10.8')
    file.create_dataset('u', data=values.astype('i2'), chunks=(8, 40, 24), compression=4)
    for axis, name in enumerate('zyx'):
      file[name] = numpy.arange(values.shape[axis]) * 0.5
      file[name].make_scale(name)
      file[name].attrs['units'] = 'm'
      file[name].attrs['axis'] = name.upper()
      file['u'].dims[axis].attach_scale(file[name])
    file['u'].attrs['scale_factor'] = 0.5
    file['u'].attrs['add_offset'] = -3.0
    file['u'].attrs['_FillValue'] = numpy.int16(17)
  return True


class AddressTest(unittest.TestCase):

  def setUp(self):
    self.folder = tempfile.mkdtemp()
    self.addCleanup(shutil.rmtree, self.folder)
    self.outputs = []
    self.served = self.path('served')
    os.makedirs(os.path.join(self.served, 'bucket', 'runs'))
    self.environment = {
        name: value for name, value in os.environ.items()
        if not name.upper().startswith(('AWS_', 'ISOSCOPE_BEARER', 'ISOSCOPE_S3')) and not name.lower().endswith('_proxy')
    }
    self.environment.update(HOME=self.path('home'), XDG_CACHE_HOME=self.path('cache'))
    os.makedirs(self.path('home'))
    self.isoscope('generate', 'gyroid', '--dims', ','.join(map(str, DIMS)), '--type', 'uint8', '--output',
                  self.path('served/v.nrrd'), '--quiet')
    with open(self.path('served/v.nrrd'), 'rb') as file:
      self.samples = file.read().split(b'\n\n', 1)[1]
    with open(self.path('served/v.raw'), 'wb') as file:
      file.write(self.samples)
    write_zarr(self.path('served/run.zarr'), self.samples)
    shutil.copytree(self.path('served/run.zarr'), self.path('served/bucket/runs/run.zarr'))
    shutil.copy(self.path('served/v.nrrd'), self.path('served/bucket/v 1=+.nrrd'))

  def tearDown(self):
    # Nothing that the program wrote, on the terminal or on the disk, has a secret.
    for text in self.outputs:
      for secret in SECRETS:
        self.assertNotIn(secret, text)
    for folder, _, names in os.walk(self.folder):
      for name in names:
        if name in ('netrc', 'token', 'passwords'):
          continue
        with open(os.path.join(folder, name), 'rb') as file:
          text = file.read()
        for secret in SECRETS:
          self.assertNotIn(secret.encode(), text, os.path.join(folder, name))

  def path(self, *parts):
    return os.path.join(self.folder, *parts)

  def isoscope(self, *arguments, check=True, **environment):
    done = subprocess.run([os.path.join(BIN, 'isoscope'), *arguments], capture_output=True, text=True,
                          env={**self.environment, **environment}, timeout=PATIENCE_S)
    self.outputs += [done.stdout, done.stderr]
    if check and done.returncode != 0:
      raise AssertionError(f'isoscope {" ".join(arguments)}: exit code {done.returncode}\n{done.stderr}')
    return done

  def partition(self, name, source, *flags, **environment):
    os.makedirs(self.path(name))
    self.isoscope('partition', source, '-o', self.path(name, 'd'), *CUT, *flags, **environment)
    return files_below(self.path(name))

  def aws(self, origin):
    return {
        'AWS_ACCESS_KEY_ID': 'AKIDEXAMPLE', 'AWS_SECRET_ACCESS_KEY': SECRETS[0], 'AWS_SESSION_TOKEN': SECRETS[1],
        'AWS_REGION': 'eu-test-1', 'AWS_ENDPOINT_URL': origin
    }

  def test_a_faulty_server_gives_the_bytes_of_the_disk(self):
    raw = ['--dims', ','.join(map(str, DIMS)), '--type', 'uint8']
    sources = [('v.nrrd', []), ('v.raw', raw), ('run.zarr:a', []), ('run.zarr/a', [])]
    faults = 0
    for number, (source, flags) in enumerate(sources):
      local = self.partition(f'local{number}', self.path('served', source), *flags)
      for seed in range(2):
        with ObjectServer(self.served, faults=0.5, seed=2 * number + seed) as server:
          remote = self.partition(f'remote{number}.{seed}', f'{server.origin}/{source}', *flags)
          faults += server.fault_count
        self.assertEqual(local, remote, source)
    self.assertGreater(faults, 10)

  def test_hdf5_and_netcdf_are_read_by_ranges(self):
    if not write_hdf5(self.served, self.samples):
      skips.skip('h5py', 'python3-h5py is not installed')
    faults = 0
    for source in ('v.h5:/d', 'v.h5:/whole', 'n.nc', 'n.nc:u'):
      name = source.replace('/', '_')
      local = self.partition('local' + name, self.path('served', source))
      for seed in (1, 2):
        with ObjectServer(self.served, faults=0.4, seed=seed) as server:
          remote = self.partition(f'remote{name}{seed}', f'{server.origin}/{source}')
          faults += server.fault_count
        self.assertEqual(local, remote, source)
      shutil.copy(self.path('served', source.split(':')[0]), self.path('served/bucket'))
      with ObjectServer(self.served, is_s3=True) as server:
        self.assertEqual(local, self.partition('s3' + name, 's3://bucket/' + source, **self.aws(server.origin)), source)
      with ObjectServer(self.served, has_ranges=False) as server:
        refused = self.isoscope('info', f'{server.origin}/{source}', check=False)
        self.assertNotEqual(refused.returncode, 0)
        self.assertIn('ranges', refused.stderr)
    self.assertGreater(faults, 5)

  def test_hdf5_from_a_server_that_does_wrong_is_an_error_or_right(self):
    if not write_hdf5(self.served, self.samples):
      skips.skip('h5py', 'python3-h5py is not installed')
    local = {source: self.partition('local' + source[0], self.path('served', source)) for source in ('v.h5:/d', 'n.nc')}
    stranger = StrangerServer()
    self.addCleanup(stranger.close)
    errors = faults = 0
    with ObjectServer(self.served) as server:
      for seed in range(6):
        proxy = FaultProxy(('127.0.0.1', int(server.origin.rsplit(':', 1)[1])), 0.5, seed, stranger)
        self.addCleanup(proxy.close)
        source = ('v.h5:/d', 'n.nc')[seed % 2]
        out = self.path(f'remote{seed}')
        os.makedirs(out)
        done = self.isoscope('partition', f'http://127.0.0.1:{proxy.port}/{source}', '-o', os.path.join(out, 'd'), *CUT,
                             check=False)
        faults += sum(proxy.counts.values())
        if done.returncode == 0:
          self.assertEqual(files_below(out), local[source], seed)
        else:
          errors += 1
          self.assertIn(source.split(':')[0], done.stderr)
          self.assertNotIn('damaged', done.stderr)
    self.assertGreater(faults, 10)
    self.assertGreater(errors, 0)

  def test_hdf5_that_comes_slowly_can_be_interrupted(self):
    if not write_hdf5(self.served, self.samples):
      skips.skip('h5py', 'python3-h5py is not installed')
    with ObjectServer(self.served, bytes_per_second=2000) as server:
      slow = subprocess.Popen([os.path.join(BIN, 'isoscope'), 'partition', server.origin + '/v.h5:/whole', '-o',
                               self.path('slow'), *CUT], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                              env=self.environment)
      end = time.monotonic() + PATIENCE_S
      while len(server.requests) < 3 and time.monotonic() < end:
        time.sleep(0.05)
      self.assertIsNone(slow.poll())
      slow.send_signal(signal.SIGINT)
      errors = slow.communicate(timeout=PATIENCE_S)[1]
    self.assertNotEqual(slow.returncode, 0)
    self.assertNotIn('damaged', errors)
    self.assertFalse(os.path.exists(self.path('slow')))

  # What a stranger's server sends names no file of this machine, nor another address.
  def test_hdf5_that_leads_to_other_files_is_refused(self):
    if not write_hdf5(self.served, self.samples):
      skips.skip('h5py', 'python3-h5py is not installed')
    import h5py
    raw = self.path('served/v.raw')
    with h5py.File(self.path('served/other.h5'), 'w') as file:
      file['link'] = h5py.ExternalLink('v.h5', '/d')
      layout = h5py.VirtualLayout(shape=DIMS[::-1], dtype='u1')
      layout[:] = h5py.VirtualSource('v.h5', '/d', shape=DIMS[::-1])
      file.create_virtual_dataset('virtual', layout)
      file.create_dataset('raw', shape=DIMS[::-1], dtype='u1', external=[(raw, 0, len(self.samples))])
    with h5py.File(self.path('served/other.nc'), 'w') as file:
      file.attrs['_NCProperties'] = 'version=2'
      file.create_dataset('raw', shape=DIMS[::-1], dtype='u1', external=[(raw, 0, len(self.samples))])
    with ObjectServer(self.served) as server:
      for source in ('other.h5:/link', 'other.h5:/virtual', 'other.h5:/raw', 'other.nc', 'other.nc:raw'):
        refused = self.isoscope('info', f'{server.origin}/{source}', check=False)
        self.assertNotEqual(refused.returncode, 0, source)
        self.assertIn('v.h5' if 'link' in source else 'in other files', refused.stderr, source)

  def test_pictures_are_cached_only_where_a_version_tells_all(self):
    with ObjectServer(self.served) as server:
      for source, is_cached in (('v.nrrd', True), ('run.zarr:a', False)):
        for picture in ('a.png', 'b.png'):
          self.isoscope('render', f'{server.origin}/{source}', '--isovalue', '128', '--renderer', 'cpu', '--width', '64',
                        '--height', '64', '-o', self.path(picture), '--no-metadata', '--quiet')
        entries = [name for name in os.listdir(self.path('cache/isoscope')) if name.startswith(source[0])]
        self.assertEqual(len(entries), 1 if is_cached else 2, entries)
        self.assertEqual(bytes_of(self.path('a.png')), bytes_of(self.path('b.png')))
      # Another object at the address is another picture.
      with open(self.path('served/v.nrrd'), 'rb') as file:
        head = file.read().split(b'\n\n', 1)[0]
      with open(self.path('served/v.nrrd'), 'wb') as file:
        file.write(head + b'\n\n' + bytes(255 - sample for sample in self.samples))
      self.isoscope('render', server.origin + '/v.nrrd', '--isovalue', '100', '--renderer', 'cpu', '--width', '64',
                    '--height', '64', '-o', self.path('c.png'), '--no-metadata', '--quiet')
      self.isoscope('render', self.path('served/v.nrrd'), '--isovalue', '100', '--renderer', 'cpu', '--width', '64',
                    '--height', '64', '-o', self.path('d.png'), '--no-metadata', '--quiet')
      self.assertEqual(bytes_of(self.path('c.png')), bytes_of(self.path('d.png')))

  def test_a_server_without_ranges_is_refused_and_copied_whole(self):
    with ObjectServer(self.served, has_ranges=False, has_index=True, faults=0.3, seed=5) as server:
      refused = self.isoscope('info', server.origin + '/v.nrrd', check=False)
      self.assertNotEqual(refused.returncode, 0)
      self.assertIn('ranges', refused.stderr)
      self.assertIn('isoscope copy', refused.stderr)
      self.isoscope('copy', server.origin + '/v.nrrd', self.path('copies'), '--quiet')
      self.isoscope('copy', server.origin + '/run.zarr/', self.path('copies'), '--quiet')
    self.assertEqual(files_below(self.path('copies', 'run.zarr')), files_below(self.path('served', 'run.zarr')))
    self.assertEqual(bytes_of(self.path('copies/v.nrrd')), bytes_of(self.path('served/v.nrrd')))

  def test_s3_is_read_and_copied_with_signatures(self):
    with ObjectServer(self.served, is_s3=True, faults=0.2, page=5) as server:
      aws = self.aws(server.origin)
      remote = self.partition('remote', 's3://bucket/v 1=+.nrrd', **aws)
      self.assertEqual(remote, self.partition('local', self.path('served/bucket/v 1=+.nrrd')))
      remote = self.partition('remote_zarr', 's3://bucket/runs/run.zarr:a', **aws)
      self.assertEqual(remote, self.partition('local_zarr', self.path('served/run.zarr:a')))
      self.isoscope('copy', 's3://bucket/runs/', self.path('copies'), '--quiet', **aws)
      self.assertEqual(files_below(self.path('copies/runs')), files_below(self.path('served/bucket/runs')))
      for name, _ in server.requests:
        self.assertNotIn(SECRETS[0], name)
      refused = self.isoscope('info', 's3://bucket/v 1=+.nrrd', check=False, AWS_ENDPOINT_URL=server.origin,
                              AWS_REGION='eu-test-1')
      self.assertIn('PERMISSION_DENIED', refused.stderr)

  def test_tokens_and_signed_addresses_stay_secret(self):
    with ObjectServer(self.served, token=SECRETS[2]) as server:
      bearer = {'ISOSCOPE_BEARER_TOKEN': SECRETS[2], 'ISOSCOPE_BEARER_TOKEN_ORIGIN': server.origin}
      signed = f'{server.origin}/v.nrrd?X-Amz-Signature={SECRETS[4]}'
      for command in (['info', signed], ['info', signed, '--json'], ['partition', signed, '-o', self.path('p'), *CUT],
                      ['info', f'{server.origin}/none.nrrd?sig={SECRETS[4]}'], ['render', signed, '--isovalue', '128',
                       '--renderer', 'cpu', '-o', self.path('a.png')], ['copy', signed, self.path('copies')],
                      ['info', f'https://ada:{SECRETS[3]}@127.0.0.1/v.nrrd'], ['info', signed + '#x']):
        self.isoscope(*command, check=False, **bearer)
      self.assertTrue(os.path.exists(self.path('a.png')))
      self.assertTrue(os.path.exists(self.path('copies/v.nrrd')))
      refused = self.isoscope('info', server.origin + '/v.nrrd', check=False)
      self.assertIn('UNAUTHENTICATED', refused.stderr)

  def core_of_abort(self, command, is_ready, **environment):
    """The core file of a process that is aborted once it is ready; None: it has none."""
    def allow_cores():
      resource.setrlimit(resource.RLIMIT_CORE, (resource.getrlimit(resource.RLIMIT_CORE)[1],) * 2)

    with tempfile.TemporaryDirectory() as folder:
      process = subprocess.Popen(command, cwd=folder, env={**self.environment, **environment}, preexec_fn=allow_cores,
                                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
      end = time.monotonic() + PATIENCE_S
      while not is_ready() and time.monotonic() < end:
        self.assertIsNone(process.poll(), command)
        time.sleep(0.01)
      process.send_signal(signal.SIGABRT)
      self.assertEqual(process.wait(PATIENCE_S), -signal.SIGABRT)
      cores = [name for name in os.listdir(folder) if name.startswith('core')]
      return bytes_of(os.path.join(folder, cores[0])) if cores else None

  def test_core_files_have_no_credentials(self):
    """Breaks if the system writes cores once a credential was read: ForbidCores.

    A core without memory has vector registers, and there the password that a thread copied last."""
    pattern = bytes_of('/proc/sys/kernel/core_pattern') if os.path.exists('/proc/sys/kernel/core_pattern') else b'|'
    is_plain = not pattern.startswith(b'|') and b'/' not in pattern and os.path.exists('/proc/self/coredump_filter')
    if not is_plain or self.core_of_abort(['sleep', '60'], lambda: True) is None:
      skips.skip('cores', 'this system writes no core files into the folder of the process')
    with open(self.path('netrc'), 'w') as file:
      file.write(f'machine 127.0.0.1 login ada password {SECRETS[3]}\n')
    with open(self.path('token'), 'w') as file:
      file.write(SECRETS[2])
    with ObjectServer(self.served, is_s3=True, bytes_per_second=100) as s3, \
         ObjectServer(self.served, bytes_per_second=100) as server:
      bearer = {'ISOSCOPE_BEARER_TOKEN_ORIGIN': server.origin}
      token = {'ISOSCOPE_BEARER_TOKEN': SECRETS[2], **bearer}
      password = base64.b64encode(f'ada:{SECRETS[3]}'.encode()).decode()  # as it is sent
      cases = [('s3://bucket/v 1=+.nrrd', SECRETS[:2], self.aws(s3.origin)),
               (server.origin + '/v.nrrd', [SECRETS[2]], token),
               (server.origin + '/v.nrrd', [SECRETS[2]], {'ISOSCOPE_BEARER_TOKEN_FILE': self.path('token'), **bearer}),
               (server.origin + '/v.nrrd', [password], {'NETRC': self.path('netrc')})]
      for source, secrets, environment in cases:
        for is_full in (False, True):
          with self.subTest(source=source, environment=sorted(environment), is_full=is_full):
            requests = s3.requests if source.startswith('s3:') else server.requests
            requests.clear()

            def is_reading():
              return any('Authorization' in headers for _, headers in requests)

            command = [os.path.abspath(os.path.join(BIN, 'isoscope')), 'info', '--values', source]
            core = self.core_of_abort(command, is_reading, **environment,
                                      **({'ISOSCOPE_FULL_CORES': '1'} if is_full else {}))
            self.assertEqual(core is not None, is_full)
            for secret in secrets if is_full else []:
              self.assertIn(secret.encode(), core)

  # Symptom: nothing said that the copy can be resumed, if the signal came while the disk was slow.
  def test_a_copy_whose_disk_does_not_answer_says_that_it_goes_on(self):
    with ObjectServer(self.served, has_index=True) as server:
      for address, begun in (('/v.nrrd', 'v.nrrd.part'), ('/run.zarr/', 'run.zarr.part')):
        copy = subprocess.Popen([os.path.join(BIN, 'isoscope'), 'copy', server.origin + address, self.path('copies')],
                                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                                env={**self.environment, 'LD_PRELOAD': STUCK_DISK})
        end = time.monotonic() + PATIENCE_S
        while not os.path.exists(self.path('copies', begun)) and copy.poll() is None and time.monotonic() < end:
          time.sleep(0.05)
        copy.send_signal(signal.SIGINT)
        errors = copy.communicate(timeout=PATIENCE_S)[1]
        self.assertEqual(copy.returncode, 128 + signal.SIGINT, errors)
        self.assertIn('; the same command goes on where it ended', errors)
        self.isoscope('copy', server.origin + address, self.path('copies'), '--quiet')
    self.assertEqual(bytes_of(self.path('copies/v.nrrd')), bytes_of(self.path('served/v.nrrd')))
    self.assertEqual(files_below(self.path('copies', 'run.zarr')), files_below(self.path('served', 'run.zarr')))

  def test_a_copy_that_is_killed_goes_on(self):
    large = self.path('served/large')
    os.makedirs(large)
    for number in range(60):
      with open(os.path.join(large, f'{number}.bin'), 'wb') as file:
        file.write(os.urandom(200_000))
    with ObjectServer(self.served, has_index=True, bytes_per_second=100_000) as server:
      copy = subprocess.Popen([os.path.join(BIN, 'isoscope'), 'copy', server.origin + '/large/', self.path('copies')],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=self.environment)
      record = self.path('copies/large.part.record')
      end = time.monotonic() + PATIENCE_S
      while copy.poll() is None and time.monotonic() < end:
        if os.path.exists(record) and len(lines_of(record)) > 10:
          copy.send_signal(signal.SIGKILL)
          break
        time.sleep(0.01)
      copy.wait(PATIENCE_S)
      server.bytes_per_second = None
      self.assertFalse(os.path.exists(self.path('copies/large')))
      done = self.isoscope('copy', server.origin + '/large/', self.path('copies'))
      self.assertIn('goes on after', done.stderr)
    self.assertEqual(files_below(self.path('copies/large')), files_below(large))
    self.assertEqual(os.listdir(self.path('copies')), ['large'])

  @skips.skip_unless(shutil.which('nginx'), 'nginx', 'nginx is missing; Debian has it in nginx-light')
  def test_nginx_with_a_password(self):
    port = free_port()
    with open(self.path('passwords'), 'w') as file:
      file.write(f'ada:{{PLAIN}}{SECRETS[3]}\n')
    with open(self.path('netrc'), 'w') as file:
      file.write(f'machine 127.0.0.1 login ada password {SECRETS[3]}\n')
    os.chmod(self.path('netrc'), 0o600)
    with open(self.path('nginx.conf'), 'w') as file:
      file.write(f'''daemon off; pid {self.path('nginx.pid')}; error_log {self.path('nginx.log')};
        events {{}}
        http {{ access_log off; client_body_temp_path {self.path('t1')}; proxy_temp_path {self.path('t2')};
          fastcgi_temp_path {self.path('t3')}; uwsgi_temp_path {self.path('t4')}; scgi_temp_path {self.path('t5')};
          server {{ listen 127.0.0.1:{port}; root {self.served}; autoindex on;
            auth_basic volumes; auth_basic_user_file {self.path('passwords')}; }} }}''')
    # The processes of nginx may be of another user.
    for folder, _, names in os.walk(self.folder):
      os.chmod(folder, 0o755)
    nginx = subprocess.Popen(['nginx', '-e', self.path('nginx.log'), '-c', self.path('nginx.conf')],
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
      end = time.monotonic() + 60
      while time.monotonic() < end:
        try:
          socket.create_connection(('127.0.0.1', port), 1).close()
          break
        except OSError:
          time.sleep(0.05)
      origin = f'http://127.0.0.1:{port}'
      remote = self.partition('remote', origin + '/v.nrrd', NETRC=self.path('netrc'))
      self.assertEqual(remote, self.partition('local', self.path('served/v.nrrd')))
      remote = self.partition('remote_zarr', origin + '/run.zarr:a', NETRC=self.path('netrc'))
      self.assertEqual(remote, self.partition('local_zarr', self.path('served/run.zarr:a')))
      self.isoscope('copy', origin + '/bucket', self.path('copies'), '--quiet', NETRC=self.path('netrc'))
      self.assertEqual(files_below(self.path('copies/bucket')), files_below(self.path('served/bucket')))
      refused = self.isoscope('info', origin + '/v.nrrd', check=False)
      self.assertIn('UNAUTHENTICATED', refused.stderr)
    finally:
      nginx.send_signal(signal.SIGQUIT)
      nginx.wait(PATIENCE_S)


if __name__ == '__main__':
  unittest.main()
