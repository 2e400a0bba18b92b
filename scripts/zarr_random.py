#!/usr/bin/env python3
"""Compares random Zarr arrays, which are encoded here by the specification alone, with the same samples as `.npy`.

What zarr_matrix.py has of no writer: shards in shards in shards, with indexes at either end, in either byte order, with
transposes and without checksums, their chunks in any order and with unused bytes between them; several transposes;
chains of codecs; frames of zstd without a size, several of them, or of nothing; blosc with each compressor and blocks
of any size; NaN, infinities and bits as fill values; chunks larger than the array, with other samples behind its edge;
missing chunks. A quarter is partitioned with --index-only. samples_digest of both must be equal.

    scripts/zarr_random.py build/release/bin/isoscope FOLDER --seed 1 --count 3000

Prints each array that differs or is refused, keeps it in FOLDER, and ends with 1. An array's number and the seed make
it again. Needs numpy and numcodecs of Python, and libzstd.
"""

import argparse
import bz2
import collections
import ctypes
import gzip
import itertools
import json
import lzma
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import zlib

TYPES = {'bool': 'b1', 'uint8': 'u1', 'int8': 'i1', 'uint16': 'u2', 'int16': 'i2', 'uint32': 'u4', 'int32': 'i4',
         'uint64': 'u8', 'int64': 'i8', 'float16': 'f2', 'float32': 'f4', 'float64': 'f8'}
MAX_EXACT = 2**53  # of integers that become float64
ARRAYS_OF_A_STORE = 24  # one command for so many
PATIENCE_S = 300
MISSING = 2**64 - 1  # offset and size of a chunk that a shard does not have


def crc32c_table():
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ 0x82f63b78 if value & 1 else value >> 1
        table.append(value)
    return table


CRC32C = crc32c_table()


def crc32c(data):
    value = 0xffffffff
    for byte in data:
        value = CRC32C[(value ^ byte) & 255] ^ (value >> 8)
    return struct.pack('<I', value ^ 0xffffffff)


def zstd_frame(data, level, has_checksum, has_size):
    """numcodecs writes sizes always, and never a checksum."""
    library = ctypes.CDLL('libzstd.so.1')
    library.ZSTD_createCCtx.restype = ctypes.c_void_p
    for name in ('ZSTD_compress2', 'ZSTD_compressBound'):
        getattr(library, name).restype = ctypes.c_size_t
    context = ctypes.c_void_p(library.ZSTD_createCCtx())
    for parameter, value in ((100, level), (200, has_size), (201, has_checksum)):
        library.ZSTD_CCtx_setParameter(context, parameter, int(value))
    bound = library.ZSTD_compressBound(ctypes.c_size_t(len(data)))
    out = ctypes.create_string_buffer(bound)
    size = library.ZSTD_compress2(context, out, ctypes.c_size_t(bound), data, ctypes.c_size_t(len(data)))
    library.ZSTD_freeCCtx(context)
    if size > bound:
        raise RuntimeError('zstd fails')
    return out.raw[:size]


def chunks_of(shape, chunk):
    return itertools.product(*(range(-(-size // step)) for size, step in zip(shape, chunk)))


class Writer:
    """Makes arrays of one seed."""

    def __init__(self, seed, np, numcodecs):
        self.np, self.numcodecs = np, numcodecs
        self.random = random.Random(seed)
        self.numbers = np.random.default_rng(seed)

    def chance(self, part):
        return self.random.random() < part

    # ---- Samples and fill values. ----

    def samples(self, dtype, shape):
        np, count = self.np, int(self.np.prod(shape))
        kind = self.random.choice(['few', 'all', 'one'])
        if dtype.kind == 'b':
            values = self.numbers.integers(0, 2, count)
        elif dtype.kind in 'iu':
            info = np.iinfo(dtype)
            ends = (0, 100) if kind == 'few' else (max(info.min, -MAX_EXACT), min(info.max, MAX_EXACT))
            values = self.numbers.integers(*ends, count, endpoint=True, dtype=np.int64)
        else:
            values = self.numbers.normal(size=count) * 1000
            for odd in (np.nan, np.inf, -np.inf, -0.0) if kind == 'all' else ():
                values[self.numbers.random(count) < 0.05] = odd
        return (np.repeat(values[:1], count) if kind == 'one' else values).astype(dtype).reshape(shape)

    def fill(self, dtype, version):
        """(as JSON, as a number)"""
        np = self.np
        if dtype.kind == 'b':
            value = self.chance(0.5)
            return value, dtype.type(value)
        if dtype.kind in 'iu':
            info = np.iinfo(dtype)
            value = self.random.choice([0, 7, max(info.min, -MAX_EXACT), min(info.max, MAX_EXACT)])
            return value, dtype.type(value)
        bits = np.dtype(f'u{dtype.itemsize}')
        number = dtype.type(self.random.uniform(-9, 9))
        kinds = ['number', 'integer', '-0', 'NaN', 'Infinity', '-Infinity'] + (['0x', '0x NaN'] if version == 3 else [])
        kind = self.random.choice(kinds)
        if kind.startswith('0x'):
            if kind == '0x NaN':
                number = (np.array(np.nan, dtype).view(bits) | bits.type(self.random.randrange(100))).view(dtype)[()]
            digits = f'{int(np.array(number).view(bits)):0{2 * dtype.itemsize}x}'
            return f'0x{digits.upper() if self.chance(0.3) else digits}', number
        values = {'number': float(number), 'integer': 3, '-0': -0.0}
        return values.get(kind, kind), dtype.type(values.get(kind, kind.lower().replace('infinity', 'inf')))

    # ---- Codecs of bytes: (metadata, encode). ----

    def named(self, name, version, is_core=False, **configuration):
        if version == 2:
            return {'id': name, **configuration}
        return {'name': name if is_core or self.chance(0.3) else f'numcodecs.{name}', 'configuration': configuration}

    def byte_codecs(self, dtype, version, is_exact):
        """A chain; `is_exact`: what it encodes are whole numbers."""
        chain = []
        for _ in range(self.random.choice([0, 1, 1, 1, 2, 2, 3])):
            name = self.random.choice(['gzip', 'zlib', 'zstd', 'zstd', 'blosc', 'blosc', 'blosc', 'lz4', 'lzma', 'bz2',
                                       'shuffle', 'crc32c', 'crc32', 'adler32'])
            if name != 'shuffle' or (is_exact and not chain):
                chain.append(getattr(self, f'make_{name}')(dtype, version))
        return chain

    def make_gzip(self, _, version):
        level, is_cut = self.random.randrange(10), self.chance(0.2)

        def encode(data):
            cut = len(data) // 2 if is_cut else 0
            return (gzip.compress(data[:cut], level) if cut else b'') + gzip.compress(data[cut:], level)
        return self.named('gzip', version, True, level=level), encode

    def make_zlib(self, _, version):
        return self.named('zlib', version, level=3), lambda data: zlib.compress(data, 3)

    def make_zstd(self, _, version):
        level, has_checksum, has_size = self.random.choice([-5, 1, 3, 19]), self.chance(0.5), self.chance(0.5)
        front = b'\x50\x2a\x4d\x18\x05\0\0\0skip!' if self.chance(0.1) else b''
        is_cut = self.chance(0.2)

        def encode(data):
            cut = len(data) // 3 if is_cut else 0
            first = zstd_frame(data[:cut], level, has_checksum, not has_size) if is_cut else b''
            return front + first + zstd_frame(data[cut:], level, has_checksum, has_size)
        more = {'checksum': has_checksum} if version == 3 else {}
        return self.named('zstd', version, True, level=level, **more), encode

    def make_blosc(self, dtype, version):
        blosc = self.numcodecs.blosc
        name = self.random.choice(list(blosc.list_compressors()))
        shuffle, level = self.random.randrange(3), self.random.choice([0, 1, 5, 9])
        block = self.random.choice([0, 0, 16, 64, 256])
        is_typed = self.chance(0.8)

        def encode(data):
            is_whole = is_typed and len(data) % dtype.itemsize == 0
            numbers = self.np.frombuffer(data, f'V{dtype.itemsize}' if is_whole else 'u1')
            return bytes(blosc.compress(numbers, name.encode(), level, shuffle, block))
        if version == 3 and self.chance(0.6):
            return {'name': 'blosc', 'configuration': {
                'cname': name, 'clevel': level, 'shuffle': ('noshuffle', 'shuffle', 'bitshuffle')[shuffle],
                'typesize': dtype.itemsize, 'blocksize': block}}, encode
        return self.named('blosc', version, cname=name, clevel=level, shuffle=shuffle, blocksize=block), encode

    def make_lz4(self, _, version):
        return self.named('lz4', version, acceleration=1), lambda data: bytes(self.numcodecs.LZ4().encode(data))

    def make_lzma(self, _, version):
        kind = self.random.choice([lzma.FORMAT_XZ, lzma.FORMAT_ALONE])
        return self.named('lzma', version, format=kind), lambda data: lzma.compress(data, kind)

    def make_bz2(self, _, version):
        return self.named('bz2', version, level=1), lambda data: bz2.compress(data, 1)

    def make_shuffle(self, dtype, version):
        size = dtype.itemsize
        return (self.named('shuffle', version, elementsize=size),
                lambda data: self.np.frombuffer(data, 'u1').reshape(-1, size).T.tobytes())

    def make_crc32c(self, _, version):
        is_short = version == 3 and self.chance(0.5)
        return {'name': 'crc32c'} if is_short else self.named('crc32c', version, True), lambda data: data + crc32c(data)

    def make_checksum(self, name, sum_of, version):
        location = self.random.choice([None, 'start', 'end'])

        def encode(data):
            checksum = struct.pack('<I', sum_of(data))
            return data + checksum if location == 'end' else checksum + data
        return self.named(name, version, **({'location': location} if location else {})), encode

    def make_crc32(self, _, version):
        return self.make_checksum('crc32', zlib.crc32, version)

    def make_adler32(self, _, version):
        return self.make_checksum('adler32', zlib.adler32, version)

    # ---- Chains of Zarr 3: (metadata, encode of a chunk and the fill value). ----

    def order_of(self, rank):
        order = list(range(rank))
        self.random.shuffle(order)
        return order

    def chain(self, dtype, shape, depth):
        """`depth`: shards in each other, at most."""
        orders, codecs = [], []
        for _ in range(self.random.choice([0, 0, 0, 1, 1, 2])):
            orders.append(self.order_of(len(shape)))
            codecs.append({'name': 'transpose', 'configuration': {'order': orders[-1]}})
            shape = [shape[axis] for axis in orders[-1]]
        is_shard = depth > 0 and self.chance(0.75)
        codec, encode = (self.shard if is_shard else self.plain)(dtype, shape, depth)
        tail = self.byte_codecs(dtype, 3, not is_shard) if not is_shard or self.chance(0.08) else []

        def encode_all(numbers, fill):
            for order in orders:
                numbers = numbers.transpose(order)
            data = encode(numbers, fill)
            for _, encode_bytes in tail:
                data = encode_bytes(data)
            return data
        return codecs + [codec] + [metadata for metadata, _ in tail], encode_all

    def plain(self, dtype, _shape, _depth):
        is_big = self.chance(0.4)
        stored = dtype.newbyteorder('>' if is_big else '<')
        codec = {'name': 'bytes', 'configuration': {'endian': 'big' if is_big else 'little'}}
        if dtype.itemsize == 1 and self.chance(0.7):
            del codec['configuration']
        return codec, lambda numbers, fill: numbers.astype(stored).tobytes()

    def shard(self, dtype, shape, depth):
        np = self.np
        inner = [self.random.choice([size for size in range(1, whole + 1) if whole % size == 0]) for whole in shape]
        codecs, encode_chunk = self.chain(dtype, inner, depth - 1)
        is_big, has_checksum = self.chance(0.3), self.chance(0.6)
        location = self.random.choice(['start', 'end', None])
        index_order = self.order_of(len(shape) + 1) if self.chance(0.15) else list(range(len(shape) + 1))
        index_codecs = [{'name': 'transpose', 'configuration': {'order': index_order}},
                        {'name': 'bytes', 'configuration': {'endian': 'big' if is_big else 'little'}}]
        index_codecs += [{'name': 'crc32c'}] if has_checksum else []
        configuration = {'chunk_shape': inner, 'codecs': codecs, 'index_codecs': index_codecs}
        if location:
            configuration['index_location'] = location

        def encode(numbers, fill):
            index = np.full([whole // size for whole, size in zip(shape, inner)] + [2], MISSING, 'u8')
            front = index.nbytes + 4 * has_checksum if location == 'start' else 0
            data = b'unused' if self.chance(0.2) else b''
            places = list(chunks_of(shape, inner))
            self.random.shuffle(places)
            for place in places:
                part = tuple(slice(i * size, (i + 1) * size) for i, size in zip(place, inner))
                chunk = np.ascontiguousarray(numbers[part])
                if chunk.tobytes() == np.full(inner, fill, dtype).tobytes() and self.chance(0.8):
                    continue
                encoded = encode_chunk(chunk, fill)
                index[place] = front + len(data), len(encoded)
                data += encoded + (b'gap' if self.chance(0.05) else b'')
            stored = index.transpose(index_order).astype('>u8' if is_big else '<u8').tobytes()
            stored += crc32c(stored) if has_checksum else b''
            return stored + data if location == 'start' else data + stored
        return {'name': 'sharding_indexed', 'configuration': configuration}, encode

    # ---- Arrays. ----

    def write(self, path, shape, version):
        """Writes an array. Returns (what it has, its metadata)."""
        np = self.np
        name = self.random.choice(list(TYPES))
        dtype = np.dtype(TYPES[name])
        chunk = [self.random.choice([1, 2, 3, 4, 6, 8, size, size + 3]) for size in shape]
        fill_text, fill = self.fill(dtype, version)
        path.mkdir(parents=True)
        if version == 3:
            codecs, encode = self.chain(dtype, chunk, self.random.randrange(4))
            keys, prefix, separator = self.random.choice([
                ({'name': 'default'}, 'c/', '/'), ('default', 'c/', '/'), ({'name': 'v2'}, '', '.'),
                ({'name': 'default', 'configuration': {'separator': '.'}}, 'c.', '.'),
                ({'name': 'v2', 'configuration': {'separator': '/'}}, '', '/')])
            metadata = {'zarr_format': 3, 'node_type': 'array', 'shape': shape,
                        'data_type': name if self.chance(0.8) else {'name': name},
                        'chunk_grid': {'name': 'regular', 'configuration': {'chunk_shape': chunk}},
                        'chunk_key_encoding': keys, 'fill_value': fill_text, 'codecs': codecs}
            if self.chance(0.1):
                metadata['an_extension'] = {'name': 'odd', 'must_understand': False}
            (path / 'zarr.json').write_text(json.dumps(metadata))
        else:
            metadata, encode = self.zarr_2(dtype, shape, chunk, fill_text)
            prefix, separator = '', metadata.get('dimension_separator', '.')
            (path / '.zarray').write_text(json.dumps(metadata))
        expected = self.samples(dtype, shape)
        missing = self.random.choice([0, 0, 0.2, 0.6, 1])
        for place in chunks_of(shape, chunk):
            part = tuple(slice(i * step, min((i + 1) * step, size)) for i, step, size in zip(place, chunk, shape))
            if self.chance(missing):
                expected[part] = fill
                continue
            if self.chance(0.3):  # so that chunks of shards are missing
                expected[part][:(part[0].stop - part[0].start + 1) // 2] = fill
            whole = self.samples(dtype, chunk) if self.chance(0.5) else np.full(chunk, fill, dtype)
            whole[tuple(slice(0, of.stop - of.start) for of in part)] = expected[part]
            file = path / (prefix + separator.join(map(str, place)))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(encode(whole, fill))
        return expected, metadata

    def zarr_2(self, dtype, shape, chunk, fill_text):
        order = self.random.choice('CF')
        stored = dtype.newbyteorder(self.random.choice('<>'))
        chain = []
        if dtype.kind in 'iu' and self.chance(0.3):
            delta = self.numcodecs.Delta(stored.str)
            chain.append((delta.get_config(), lambda data: bytes(delta.encode(self.np.frombuffer(data, stored)))))
        chain += self.byte_codecs(dtype, 2, True)
        codecs = [metadata for metadata, _ in chain]
        compressor = codecs.pop() if codecs and self.chance(0.8) else None
        metadata = {'zarr_format': 2, 'shape': shape, 'chunks': chunk, 'dtype': stored.str, 'order': order,
                    'fill_value': fill_text, 'filters': codecs or None, 'compressor': compressor}
        if self.chance(0.6):
            metadata['dimension_separator'] = self.random.choice('./')

        def encode(numbers, _):
            data = numbers.astype(stored).tobytes(order=order)
            for _, encode_bytes in chain:
                data = encode_bytes(data)
            return data
        return metadata, encode


class Comparison:
    def __init__(self, program, folder):
        self.program, self.folder = program, folder
        self.counts = collections.Counter()

    def digests(self, path, *flags):
        """(digest of each field, or None; what was said)"""
        out = self.folder / 'dataset'
        shutil.rmtree(out, ignore_errors=True)
        run = subprocess.run([self.program, 'partition', str(path), '--output', str(out), '--quiet', *flags],
                             capture_output=True, text=True, errors='replace', check=False, timeout=PATIENCE_S)
        if run.returncode:
            return None, f'exit code {run.returncode}: {run.stderr.strip()}'
        manifests = {file: json.loads(file.read_text()) for file in sorted(out.rglob('manifest.json'))}
        return [manifest['samples_digest'] for manifest in manifests.values() if 'samples_digest' in manifest], ''

    def compare(self, name, path, npy, metadata, *flags):
        found, said = self.digests(path, *flags)
        wanted, why = self.digests(npy, *[flag for flag in flags if flag != '--index-only'])
        if wanted is None:
            raise RuntimeError(f'{npy}: {why}')
        is_equal = bool(found) and found == wanted
        self.counts['equal' if is_equal else 'refused' if found is None else 'differs'] += 1
        if not is_equal:
            kept = self.folder / f'wrong-{name}'
            shutil.copytree(path, kept)
            shutil.copy(npy, kept.with_suffix('.npy'))
            print(f'array {name}: {said or "other samples"}: {json.dumps(metadata)}', flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program', help='isoscope')
    parser.add_argument('folder', type=pathlib.Path, help='for the arrays; is made, and must not exist')
    parser.add_argument('--seed', type=int, default=1, help='default: 1')
    parser.add_argument('--count', type=int, default=500, help='how many arrays, at least (default: 500)')
    args = parser.parse_args()
    import numcodecs
    import numpy as np
    args.folder.mkdir(parents=True)
    comparison = Comparison(args.program, args.folder)
    number = 0
    while number < args.count:
        writer = Writer(args.seed * 1000003 + number, np, numcodecs)
        version = 3 if writer.chance(0.75) else 2
        how = ['--index-only'] if writer.chance(0.25) else []
        store = args.folder / 'store.zarr'
        shutil.rmtree(store, ignore_errors=True)
        shape = [writer.random.randrange(2, 11) for _ in range(3)]
        if writer.chance(0.1):
            array, metadata = writer.write(store, [writer.random.randrange(2, 4)] + shape, version)
            np.save(args.folder / 'array.npy', array)
            axes = writer.random.choice(['TZYX', 'CZYX'])
            comparison.compare(number, store, args.folder / 'array.npy', metadata, '--axes', axes, *how)
            number += 1
            continue
        names = [f'f{i:02}' for i in range(ARRAYS_OF_A_STORE)]
        written = {name: writer.write(store / name, shape, version) for name in names}
        group = {'zarr_format': version} | ({'node_type': 'group'} if version == 3 else {})
        (store / ('zarr.json' if version == 3 else '.zgroup')).write_text(json.dumps(group))
        np.savez(args.folder / 'arrays.npz', **{name: array for name, (array, _) in written.items()})
        found, _ = comparison.digests(store, *how)
        wanted, why = comparison.digests(args.folder / 'arrays.npz')
        if wanted is None or len(wanted) != len(names):
            raise RuntimeError(f'arrays.npz: {why or wanted}')
        if found == wanted:
            comparison.counts['equal'] += len(names)
        else:  # one by one
            for i, name in enumerate(names):
                np.save(args.folder / 'array.npy', written[name][0])
                comparison.compare(number + i, store / name, args.folder / 'array.npy', written[name][1], *how)
        number += len(names)
    print(f'zarr_random.py: seed {args.seed}: {number} arrays; {dict(sorted(comparison.counts.items()))}')
    return 0 if set(comparison.counts) == {'equal'} else 1


if __name__ == '__main__':
    sys.exit(main())
