#!/usr/bin/env python3
"""Reads from a web server with passwords and from a server of S3, both behind a proxy that does wrong at random.

Each round runs one command of isoscope on an address: copy, info or partition. It must end, with the bytes that the
files have, or with an error; what it prints and writes is searched for every secret, and so is what a stranger was
told to whom the proxy redirects. Ends with 1 at a wrong byte, a command that hangs or crashes, or a secret.

    scripts/remote_soak.py build/release/bin --faults 2000 --seed 1

Servers: nginx (Debian: nginx-light), and s3rver of npm, installed into a folder that --s3rver names; without the
latter only nginx is asked, and the last line says so.
"""

import argparse
import base64
import collections
import concurrent.futures
import gzip
import hashlib
import hmac
import http.client
import itertools
import json
import os
import pathlib
import random
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'tests' / 'support'))

import fault_proxy  # noqa: E402
from free_ports import free_port  # noqa: E402
from zarr_random import crc32c  # noqa: E402

PATIENCE_S = 240
USER, PASSWORD = 'reader', 'n0t-To-Be-Seen/+='
S3_KEY, S3_SECRET = 'S3RVER', 'S3RVER'
BUCKET = 'volumes'
NGINX = '''
pid {folder}/nginx.pid; error_log {folder}/error.log; worker_processes 2; daemon off;
events {{ worker_connections 512; }}
http {{
  access_log off; client_body_temp_path {folder}/t1; proxy_temp_path {folder}/t2; fastcgi_temp_path {folder}/t3;
  uwsgi_temp_path {folder}/t4; scgi_temp_path {folder}/t5;
  server {{ listen 127.0.0.1:{port}; root {root}; auth_basic "volumes"; auth_basic_user_file {folder}/users; }}
}}
'''


def wait_for(port, process):
    end = time.monotonic() + 30
    while time.monotonic() < end:
        if process.poll() is not None:
            raise SystemExit(f'{process.args[0]} ended with {process.returncode}')
        with socket.socket() as one:
            if one.connect_ex(('127.0.0.1', port)) == 0:
                return
        time.sleep(0.05)
    raise SystemExit(f'{process.args[0]} does not listen')


def digest_of(folder):
    """The bytes below a folder, but the manifests, which have its name, and their checksums."""
    total = hashlib.sha256()
    for path in sorted(pathlib.Path(folder).rglob('*')):
        if path.is_file() and path.name not in ('manifest.json', 'shard.json'):
            total.update(str(path.relative_to(folder)).encode() + b'\0' + path.read_bytes())
    return total.hexdigest()


class Soak:
    def __init__(self, bin_folder, folder, s3rver, chance, seed, kinds):
        self.isoscope = os.path.join(os.path.abspath(bin_folder), 'isoscope')
        self.folder = pathlib.Path(folder)
        self.data = self.folder / 'data'
        self.data.mkdir()
        self.random = random.Random(seed)
        self.kinds = kinds
        self.lock = threading.Lock()
        self.outcomes = collections.Counter()
        self.failures = []
        self.rounds = 0
        self.processes = []
        self.stranger = fault_proxy.StrangerServer()
        self.make_files()
        self.proxies = {}
        self.start_nginx(chance, seed)
        if s3rver:
            self.start_s3rver(s3rver, chance, seed + 1)

    def run(self, *arguments, check=True, **more):
        return subprocess.run([self.isoscope, *map(str, arguments)], check=check, capture_output=True, text=True, errors='replace',
                              stdin=subprocess.DEVNULL, **more)

    def make_files(self):
        self.run('generate', 'random', '--dims', '96,80,64', '--output', self.data / 'random.nrrd')
        big = self.data / 'big.bin'
        big.write_bytes(random.Random(7).randbytes(20_000_001))
        odd = self.data / 'a folder' / 'ä=+&%.nrrd'
        odd.parent.mkdir()
        shutil.copy(self.data / 'random.nrrd', odd)
        self.files = {path: hashlib.sha256(path.read_bytes()).hexdigest()
                      for path in (self.data / 'random.nrrd', big, odd)}
        self.datasets = {}
        zarr = make_zarr(self.data)
        for source in [self.data / 'random.nrrd', make_shards(self.data)] + ([zarr] if zarr else []) + make_hdf5(self.data):
            dataset = self.folder / f'of-{source.name}'
            self.run('partition', source, '--output', dataset)
            self.datasets[source] = digest_of(dataset)

    def start(self, port, *command, **more):
        self.processes.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                               **more))
        wait_for(port, self.processes[-1])

    def start_nginx(self, chance, seed):
        folder, port = self.folder / 'nginx', free_port()
        folder.mkdir()
        os.chmod(self.folder, 0o755)
        digest = base64.b64encode(hashlib.sha1(PASSWORD.encode()).digest()).decode()
        (folder / 'users').write_text(f'{USER}:{{SHA}}{digest}\n')
        (folder / 'nginx.conf').write_text(NGINX.format(folder=folder, port=port, root=self.data))
        if os.geteuid() == 0:
            with open(folder / 'nginx.conf', 'a', encoding='utf-8') as conf:
                conf.write('user root;\n')
        self.start(port, shutil.which('nginx') or '/usr/sbin/nginx', '-c', folder / 'nginx.conf', '-p', folder)
        self.proxies['nginx'] = fault_proxy.FaultProxy(('127.0.0.1', port), chance, seed, self.stranger)
        netrc = self.folder / 'netrc'
        netrc.write_text(f'machine 127.0.0.1 login {USER} password {PASSWORD}\n')
        netrc.chmod(0o600)

    def start_s3rver(self, folder, chance, seed):
        port = free_port()
        self.start(port, os.path.join(folder, 'node_modules', '.bin', 's3rver'), '-d', self.folder / 's3', '-a', '127.0.0.1', '-p', str(port),
                   '--configure-bucket', BUCKET)
        for path in sorted(self.data.rglob('*')):
            if path.is_file():
                key = urllib.parse.quote(str(path.relative_to(self.data)))
                put_signed(port, f'/{BUCKET}/{key}', path.read_bytes())
        self.proxies['s3'] = fault_proxy.FaultProxy(('127.0.0.1', port), chance, seed, self.stranger)

    def address(self, server, path):
        key = str(path.relative_to(self.data))
        if server == 's3':
            return f's3://{BUCKET}/{key}'
        return f'http://127.0.0.1:{self.proxies[server].port}/{urllib.parse.quote(key)}'

    def environment(self, server):
        kept = {name: os.environ[name] for name in ('PATH', 'LANG', 'TMPDIR', 'LD_LIBRARY_PATH', 'ASAN_OPTIONS') if name in os.environ}
        own = {'HOME': str(self.folder / 'home')}
        if server == 's3':
            own |= {'AWS_ACCESS_KEY_ID': S3_KEY, 'AWS_SECRET_ACCESS_KEY': S3_SECRET, 'AWS_REGION': 'us-east-1',
                    'AWS_ENDPOINT_URL': f'http://127.0.0.1:{self.proxies[server].port}'}
        else:
            own |= {'NETRC': str(self.folder / 'netrc')}
        return kept | own

    def secrets(self, server):
        if server == 's3':
            return ['Signature=', 'AWS4-HMAC', 'Credential=']
        pair = base64.b64encode(f'{USER}:{PASSWORD}'.encode()).decode()
        return [PASSWORD, pair, pair.rstrip('=')]

    def round(self, number):
        with self.lock:
            server = self.random.choice(sorted(self.proxies))
            kind = self.random.choice(self.kinds)
            path = self.random.choice(sorted(self.files if kind == 'copy' else self.datasets))
            self.rounds += 1
        address = self.address(server, path)
        out = self.folder / f'round-{number}'
        command = {'copy': ['copy', address, out], 'partition': ['partition', address, '--output', out], 'info': ['info', address]}[kind]
        try:
            done = self.run(*command, check=False, env=self.environment(server), timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            return self.fail(f'hangs: {server} {command}')
        printed = done.stdout + done.stderr
        self.search(server, f'{server} {command}', printed)
        for file in out.rglob('*') if out.exists() else []:
            if file.is_file() and file.name not in ('big.bin', 'big.bin.part'):
                self.search(server, str(file), file.read_bytes().decode('latin-1'))
        if done.returncode < 0 or done.returncode > 120 or 'Sanitizer' in printed:
            self.fail(f'crashes: {server} {command}: {done.returncode} {printed[-2000:]}')
        elif done.returncode == 0:
            self.check_bytes(kind, server, path, out, command, printed)
        else:
            self.check_error(kind, server, path, command, done.stderr)
        with self.lock:
            self.outcomes[f'{kind} {"right" if done.returncode == 0 else "error"}'] += 1
        shutil.rmtree(out, ignore_errors=True)
        shutil.rmtree(f'{out}.partial', ignore_errors=True)

    def check_bytes(self, kind, server, path, out, command, printed):
        if kind == 'copy':
            got = hashlib.sha256((out / path.name).read_bytes()).hexdigest()
            if got != self.files[path]:
                self.fail(f'wrong bytes: {server} {command}')
        elif kind == 'partition':
            if digest_of(out) != self.datasets[path]:
                self.fail(f'wrong bytes: {server} {command}')
        elif 'random.nrrd' in path.name and '96' not in printed:
            self.fail(f'wrong words: {server} {command}: {printed}')

    def check_error(self, kind, server, path, command, text):
        names = (path.name, urllib.parse.quote(path.name))
        if not any(name in text for name in names) or len(text) > 8000:
            self.fail(f'an error that names no object: {server} {command}: {text[:2000]}')
        with self.lock:
            self.outcomes['errors'] += 1
            if len(self.examples) < 400:
                self.examples.append(text.strip().splitlines()[-1])

    examples = []

    def search(self, server, where, text):
        for secret in self.secrets(server):
            if secret in text:
                self.fail(f'a secret is in {where}')

    def fail(self, what):
        with self.lock:
            self.failures.append(what)
        print(f'remote_soak.py: {what}', file=sys.stderr, flush=True)

    def fault_count(self):
        return sum(sum(proxy.counts.values()) for proxy in self.proxies.values())

    def close(self):
        for told in self.stranger.told:
            if 'authorization' in told.lower() or PASSWORD in told:
                self.fail('a stranger was told credentials')
        for proxy in self.proxies.values():
            proxy.close()
        self.stranger.close()
        for process in self.processes:
            process.terminate()
            process.wait()


def put_signed(port, path, body):
    """Stores an object with a signature of version 4 that is computed here, by the public description."""
    def mac(key, text):
        return hmac.new(key, text.encode(), hashlib.sha256).digest()
    now = time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())
    digest = hashlib.sha256(body).hexdigest()
    headers = {'host': f'127.0.0.1:{port}', 'x-amz-content-sha256': digest, 'x-amz-date': now}
    names = ';'.join(sorted(headers))
    canonical = '\n'.join(['PUT', path, '', *(f'{name}:{headers[name]}' for name in sorted(headers)), '', names, digest])
    scope = f'{now[:8]}/us-east-1/s3/aws4_request'
    text = '\n'.join(['AWS4-HMAC-SHA256', now, scope, hashlib.sha256(canonical.encode()).hexdigest()])
    key = f'AWS4{S3_SECRET}'.encode()
    for part in (now[:8], 'us-east-1', 's3', 'aws4_request'):
        key = mac(key, part)
    signature = mac(key, text).hex()
    headers['authorization'] = f'AWS4-HMAC-SHA256 Credential={S3_KEY}/{scope}, SignedHeaders={names}, Signature={signature}'
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=60)
    connection.request('PUT', path, body, headers)
    answer = connection.getresponse()
    if answer.status != 200:
        raise SystemExit(f'PUT {path}: {answer.status} {answer.read()[:500]}')
    connection.close()


def make_zarr(folder):
    """A small store of Zarr 2, with compressed chunks; None where python3-zarr is missing."""
    try:
        import numpy
        import zarr
    except ImportError:
        return None
    path = folder / 'random.zarr'
    values = numpy.random.default_rng(3).integers(0, 60000, (40, 48, 56)).astype('<u2')
    one = zarr.open(str(path), mode='w', shape=values.shape, chunks=(16, 16, 16), dtype='<u2')
    one[...] = values
    return path


def make_shards(folder):
    """A store of Zarr 3 of eight shards, of which readers fetch the index, at the end, and ranges."""
    path = folder / 'shards.zarr'
    size, shard, chunk = 48, 24, 8
    values = random.Random(5).randbytes(size**3)
    codecs = [{'name': 'bytes'}, {'name': 'gzip', 'configuration': {'level': 1}}, {'name': 'crc32c'}]
    sharding = {'chunk_shape': [chunk] * 3, 'codecs': codecs,
                'index_codecs': [{'name': 'bytes', 'configuration': {'endian': 'little'}}, {'name': 'crc32c'}]}
    for place in itertools.product(range(size // shard), repeat=3):
        data, index = b'', b''
        for inner in itertools.product(range(shard // chunk), repeat=3):
            z, y, x = (of * shard + i * chunk for of, i in zip(place, inner))
            rows = ((z + i) * size * size + (y + j) * size + x for i in range(chunk) for j in range(chunk))
            encoded = gzip.compress(b''.join(values[row:row + chunk] for row in rows), 1)
            encoded += crc32c(encoded)
            index += struct.pack('<QQ', len(data), len(encoded))
            data += encoded
        file = path.joinpath('c', *map(str, place))
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data + index + crc32c(index))
    (path / 'zarr.json').write_text(json.dumps({
        'zarr_format': 3, 'node_type': 'array', 'shape': [size] * 3, 'data_type': 'uint8', 'fill_value': 0,
        'chunk_grid': {'name': 'regular', 'configuration': {'chunk_shape': [shard] * 3}},
        'chunk_key_encoding': {'name': 'default', 'configuration': {'separator': '/'}},
        'codecs': [{'name': 'sharding_indexed', 'configuration': sharding}]}))
    return path


def make_hdf5(folder):
    """A file of HDF5 with compressed chunks, and one as netCDF-4 writes it; none where python3-h5py is missing."""
    try:
        import h5py
        import numpy
    except ImportError:
        return []
    values = numpy.random.default_rng(4).integers(0, 30000, (60, 72, 80)).astype('<u2')
    paths = [folder / 'random.h5', folder / 'random.nc']
    for path in paths:
        with h5py.File(path, 'w') as file:
            file.create_dataset('u', data=values, chunks=(16, 24, 32), compression=1)
            if path.suffix == '.nc':
                file.attrs['_NCProperties'] = numpy.string_('version=2')
                for axis, name in enumerate('zyx'):
                    file[name] = numpy.arange(values.shape[axis]) * 2.0
                    file[name].make_scale(name)
                    file[name].attrs['units'] = 'm'
                    file[name].attrs['axis'] = name.upper()
                    file['u'].dims[axis].attach_scale(file[name])
    return paths


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('bin_folder', help='folder of the program isoscope')
    parser.add_argument('--faults', type=int, default=200, help='how many faults, at least (default: 200)')
    parser.add_argument('--chance', type=float, default=0.15, help='the part of all answers that is spoilt (default: 0.15)')
    parser.add_argument('--seed', type=int, default=None, help='default: another one each time')
    parser.add_argument('--jobs', type=int, default=2, help='commands at once (default: 2)')
    parser.add_argument('--s3rver', default='', help='folder in which npm installed s3rver')
    parser.add_argument('--kinds', default='copy,copy,partition,info', help='commands to choose from (default: copy,copy,partition,info)')
    parser.add_argument('--sources', default='', help='only datasets of names that contain this, as .h5')
    parser.add_argument('--errors', action='store_true', help='print examples of errors')
    given = parser.parse_args()
    seed = random.SystemRandom().randrange(10**9) if given.seed is None else given.seed
    with tempfile.TemporaryDirectory(prefix='remote-soak-') as folder:
        soak = Soak(given.bin_folder, folder, given.s3rver, given.chance, seed, given.kinds.split(','))
        soak.datasets = {path: digest for path, digest in soak.datasets.items() if given.sources in path.name}
        try:
            with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
                number = 0
                while soak.fault_count() < given.faults and not soak.failures:
                    list(pool.map(soak.round, range(number, number + 4 * given.jobs)))
                    number += 4 * given.jobs
        finally:
            soak.close()
        counts = sum((proxy.counts for proxy in soak.proxies.values()), collections.Counter())
        for name, count in sorted(counts.items()):
            print(f'{count:6d} {name}')
        if given.errors:
            for example in sorted(set(soak.examples)):
                print('  ', example)
        print(f'remote_soak.py: seed {seed}: {soak.rounds} commands on {", ".join(sorted(soak.proxies))}, '
              f'{sum(proxy.requests for proxy in soak.proxies.values())} requests, {sum(counts.values())} faults; '
              f'{dict(sorted(soak.outcomes.items()))}; {len(soak.failures)} failures'
              + ('' if given.s3rver else '; no server of S3 was asked, since --s3rver is not given'))
        sys.exit(1 if soak.failures else 0)


if __name__ == '__main__':
    main()
