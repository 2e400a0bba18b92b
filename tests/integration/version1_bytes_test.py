#!/usr/bin/env python3
"""Datasets of one field and step have the bytes that older programs wrote.

    version1_bytes_test.py BIN_FOLDER [unittest arguments]
    version1_bytes_test.py BIN_FOLDER --print

The digests below are those of programs of 2026-11-22 and 24 (f38338b, 71c2f95), which wrote the same; --print gives
those of any program. Bytes that libzstd makes depend on its version: blocks are compared unpacked, and checksums and
sizes of packed bytes are left out.
"""

import ctypes
import ctypes.util
import hashlib
import os
import re
import struct
import subprocess
import sys
import tempfile
import unittest

BIN = os.path.abspath(sys.argv.pop(1) if len(sys.argv) > 1 else '.')
DIMS = (21, 17, 13)
VTI_HEAD = f'''<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt32">
  <ImageData WholeExtent="0 {DIMS[0] - 1} 0 {DIMS[1] - 1} 0 {DIMS[2] - 1}" Origin="-1 2 0.25" Spacing="0.5 1 2">
    <Piece Extent="0 {DIMS[0] - 1} 0 {DIMS[1] - 1} 0 {DIMS[2] - 1}">
      <PointData Scalars="density">
        <DataArray type="Float32" Name="density" format="appended" offset="0"/>
      </PointData>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">_'''

EXPECTED = {
    'count.raw':
        '4eaab4964a7d461cf2b3a242e0d4139e79131b1b47da948d97376367830e7987',
    'density.vti':
        'ae05b4a2fecae63e98a2d550c42c68f018fcf2227e8fb44aecdb2976e1b58bd0',
    'random/manifest.json':
        '3c54f58235837834c62d6f267a4cbc7ef96c9967187dde63e20223fcd244994c',
    'random/ranges.bin':
        'c5ef50380f5385dcd4d2b550dd8ca956906111b57be3004fc9f8855519309349',
    'random/shard-00000-of-00003/block_index.bin':
        '050e6368515a9458c312086bb4158648f95f549cb5f630c9117309c23b8809f2',
    'random/shard-00000-of-00003/blocks.bin':
        '676daf4cd93692fbdb8a87b08185ff5c71057ba52b6ad902c46a7f9eaa277952',
    'random/shard-00000-of-00003/histogram.bin':
        '946df51683018e1b05fa4ff19193a59548c511b9e3ab88a595329e526c8f94e3',
    'random/shard-00000-of-00003/interval_tree.bin':
        '300ea53e43b05789e23b52fc9a88be2f3208745cacc8bc4e9a38880e08f4c536',
    'random/shard-00000-of-00003/manifest.json':
        '3c54f58235837834c62d6f267a4cbc7ef96c9967187dde63e20223fcd244994c',
    'random/shard-00000-of-00003/ranges.bin':
        'c5ef50380f5385dcd4d2b550dd8ca956906111b57be3004fc9f8855519309349',
    'random/shard-00000-of-00003/shard.json':
        '4c71a2e150d422028de8e5ba43ed6d8c09dd4e6e34f1b610b74c8143342b2dc5',
    'random/shard-00001-of-00003/block_index.bin':
        'b42abb49ddf802cf6935259a9081fa6c427bc6bc8d179ab418cfa7edf8a982f0',
    'random/shard-00001-of-00003/blocks.bin':
        'af51be6b7b1cba2e9dca893a8b19ff5ce14163377cb7e17f611978505fad639b',
    'random/shard-00001-of-00003/histogram.bin':
        '2c289fa5dda8c3e2bdc7bf1bfe30c2c30823f85b0898e1df7fb7bc077615fb4f',
    'random/shard-00001-of-00003/interval_tree.bin':
        '51d232c7a451a57fd95e7639507fa9bb399f239c7f933ada77a16d0b38318c9a',
    'random/shard-00001-of-00003/manifest.json':
        '3c54f58235837834c62d6f267a4cbc7ef96c9967187dde63e20223fcd244994c',
    'random/shard-00001-of-00003/ranges.bin':
        'c5ef50380f5385dcd4d2b550dd8ca956906111b57be3004fc9f8855519309349',
    'random/shard-00001-of-00003/shard.json':
        'f7e4858f68185d1560664b49ccb8ef9c6515c3a7ce25d0b1380615797e0dcaa9',
    'random/shard-00002-of-00003/block_index.bin':
        'b949e93e04797276582d7c3a9f9f53f2158f19a6d340b3a4555bdafbae6ed978',
    'random/shard-00002-of-00003/blocks.bin':
        'e2d91a48a8775e851fe494ac6f58231563c3a2e446593b8fb6913d415b29090c',
    'random/shard-00002-of-00003/histogram.bin':
        '3932d9ab8a4a97819f1b4cdc66efb13317a6978e74f43316a9073f934b25ad17',
    'random/shard-00002-of-00003/interval_tree.bin':
        'b8228fe435426c7daa9ca23b608ad19516a1130b56b2fdd33f52438248a05cf1',
    'random/shard-00002-of-00003/manifest.json':
        '3c54f58235837834c62d6f267a4cbc7ef96c9967187dde63e20223fcd244994c',
    'random/shard-00002-of-00003/ranges.bin':
        'c5ef50380f5385dcd4d2b550dd8ca956906111b57be3004fc9f8855519309349',
    'random/shard-00002-of-00003/shard.json':
        '7421bf10e060656409ab8c75591ab8e9b8f8e881f1698d679bf864a46af91222',
    'greedy/manifest.json':
        'd76abc1400633c5e4d0ccb6e2385c9d0753727fbb2e594f2353abe987b20bcc7',
    'greedy/ranges.bin':
        'dfeba020c8d80f2d5399f663eb088609a464ff644b6ab9eab4bb81d525f0e35a',
    'greedy/shard-00000-of-00002/block_index.bin':
        'c9c68d69b7e4af063781d877ea3770072cd1c857bba7b47efff20e368d1c8a9e',
    'greedy/shard-00000-of-00002/blocks.bin':
        'a5ab0ef9e5e39a792862e84546eb155d5828d66b27f9f312f8d079c93b16bc88',
    'greedy/shard-00000-of-00002/histogram.bin':
        'c509611c45aa8cd72cc939164d3f78a4788648423e97e46458b95c5fbb8b533d',
    'greedy/shard-00000-of-00002/interval_tree.bin':
        '3b42393c71a68d8dfa58c61d80e532ffc9b1dc9678c6de7f52a26a730cd9a268',
    'greedy/shard-00000-of-00002/manifest.json':
        'd76abc1400633c5e4d0ccb6e2385c9d0753727fbb2e594f2353abe987b20bcc7',
    'greedy/shard-00000-of-00002/ranges.bin':
        'dfeba020c8d80f2d5399f663eb088609a464ff644b6ab9eab4bb81d525f0e35a',
    'greedy/shard-00000-of-00002/shard.json':
        '0ba2c4a56819b14c09eeb36a615cac9ac1461b4ba1be3cce5aae6db964296cdd',
    'greedy/shard-00001-of-00002/block_index.bin':
        '881270a36a7979def82db33bc24215f3f37e7a630ce3f7265651f0d488497b53',
    'greedy/shard-00001-of-00002/blocks.bin':
        '3e422055c2c7d75bcfe220dcd20da78f434f8cb1df978fb38985c2eeb0c9a7a2',
    'greedy/shard-00001-of-00002/histogram.bin':
        'e1c2e9fb06edf8ccc44490517ffe927a089831fcbbf971822322ad09b9b1b653',
    'greedy/shard-00001-of-00002/interval_tree.bin':
        'f73e2cd091e72929fe8bfd5e3a7496bc8ee96b56a613e7c4b7fe59a5ccc9f5b9',
    'greedy/shard-00001-of-00002/manifest.json':
        'd76abc1400633c5e4d0ccb6e2385c9d0753727fbb2e594f2353abe987b20bcc7',
    'greedy/shard-00001-of-00002/ranges.bin':
        'dfeba020c8d80f2d5399f663eb088609a464ff644b6ab9eab4bb81d525f0e35a',
    'greedy/shard-00001-of-00002/shard.json':
        'a8764632866980470c0687087da4fb64bd1633d1597a8633d333f42c3177e1e7',
}

ENTRY = struct.Struct('<IIqIIII')  # of block_index.bin (docs/format/shard.md)


def samples(function):
  """A list by x, then y, then z."""
  return [function(x, y, z) for z in range(DIMS[2]) for y in range(DIMS[1]) for x in range(DIMS[0])]


def write_raw(path):
  values = samples(lambda x, y, z: (7 * x * x + 13 * y * y + 29 * z * z + x * y * z) % 1000)
  with open(path, 'wb') as file:
    file.write(struct.pack(f'<{len(values)}H', *values))


def write_vti(path):
  values = samples(lambda x, y, z: ((31 * x + 17 * y + 7 * z + x * y) % 97) / 4 - 5)
  data = struct.pack(f'<{len(values)}f', *values)
  with open(path, 'wb') as file:
    file.write(VTI_HEAD.encode() + struct.pack('<I', len(data)) + data + b'\n  </AppendedData>\n</VTKFile>\n')


def partition(folder, *arguments):
  subprocess.run([os.path.join(BIN, 'isoscope'), 'partition', *arguments, '--quiet'], cwd=folder, check=True,
                 timeout=240)


def read(path):
  with open(path, 'rb') as file:
    return file.read()


def digest(data):
  return hashlib.sha256(data).hexdigest()


def unpack(data, size):
  """The bytes of a Zstandard frame."""
  library = ctypes.CDLL(ctypes.util.find_library('zstd') or 'libzstd.so.1')
  library.ZSTD_decompress.restype = ctypes.c_size_t
  library.ZSTD_decompress.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t]
  out = ctypes.create_string_buffer(size)
  if library.ZSTD_decompress(out, size, data, len(data)) != size:
    raise AssertionError(f'no frame of {size} bytes')
  return out.raw


def blocks_of(folder, sample_bytes):
  """Ids, encodings and raw sizes of the blocks of a shard, and their raw samples."""
  index = read(os.path.join(folder, 'block_index.bin'))
  packed = read(os.path.join(folder, 'blocks.bin'))
  head, blocks = [], b''
  for block_id, encoding, offset, stored, raw, _, _ in ENTRY.iter_unpack(index[64:]):
    head.append((block_id, encoding, raw))
    data = packed[offset:offset + stored]
    if encoding == 2:
      data = unpack(data, raw)
      count = raw // sample_bytes
      data = bytes(data[byte * count + i] for i in range(count) for byte in range(sample_bytes))
    blocks += data
  return repr(head).encode(), blocks


def without_packed(json_text):
  """The text of a sealed JSON file without what follows from packed bytes."""
  names = b'crc32c|dataset_id|manifest_crc32c|block_index_crc32c|blocks_bytes|block_bytes'
  return re.sub(rb'"(' + names + rb')": *("[0-9a-f]*"|[0-9]+)', rb'"\1": _', json_text)


def digests_of(directory, is_packed, sample_bytes=4):
  digests = {}
  for folder, _, names in sorted(os.walk(directory)):
    for name in sorted(names):
      path = os.path.join(folder, name)
      key = os.path.relpath(path, os.path.dirname(directory))
      data = read(path)
      if is_packed and name.endswith('.json'):
        data = without_packed(data)
      elif is_packed and name == 'blocks.bin':
        data = blocks_of(folder, sample_bytes)[1]
      elif is_packed and name == 'block_index.bin':
        data = blocks_of(folder, sample_bytes)[0]
      digests[key] = digest(data)
  return digests


def make_and_digest(folder):
  write_raw(os.path.join(folder, 'count.raw'))
  write_vti(os.path.join(folder, 'density.vti'))
  digests = {name: digest(read(os.path.join(folder, name))) for name in ('count.raw', 'density.vti')}
  partition(folder, 'count.raw', '--dims', ','.join(map(str, DIMS)), '--type', 'uint16', '--spacing', '0.5,1,2',
            '--origin', '3,-2,1', '--block-cells', '4', '--shards', '3', '--seed', '7', '--output', 'random')
  partition(folder, 'density.vti', '--block-cells', '5x4x3', '--shards', '2', '--distribution', 'greedy',
            '--compression', 'zstd', '--output', 'greedy')
  digests.update(digests_of(os.path.join(folder, 'random'), is_packed=False))
  digests.update(digests_of(os.path.join(folder, 'greedy'), is_packed=True))
  return digests


class Version1BytesTest(unittest.TestCase):
  maxDiff = None

  def test_bytes_are_those_of_older_programs(self):
    with tempfile.TemporaryDirectory(prefix='isoscope-bytes-') as folder:
      self.assertEqual(make_and_digest(folder), EXPECTED)

  def test_blocks_were_packed(self):
    with tempfile.TemporaryDirectory(prefix='isoscope-bytes-') as folder:
      make_and_digest(folder)
      index = read(os.path.join(folder, 'greedy/shard-00000-of-00002/block_index.bin'))
      self.assertIn(2, {entry[1] for entry in ENTRY.iter_unpack(index[64:])})


if __name__ == '__main__':
  if sys.argv[1:] == ['--print']:
    with tempfile.TemporaryDirectory(prefix='isoscope-bytes-') as own:
      for name, value in make_and_digest(own).items():
        print(f"    '{name}':\n        '{value}',")
  else:
    unittest.main()
