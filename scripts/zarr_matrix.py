#!/usr/bin/env python3
"""Compares Zarr arrays of other writers, of every codec, order, type and key encoding, with the same samples as `.npy`.

Each array is partitioned, and so is its `.npy`: samples_digest of the two manifests must be equal, which is that of all
samples and of the grid. Prints a table by writer and codec; ends with 1 if an array differs or is refused.

    scripts/zarr_matrix.py build/release/bin/isoscope FOLDER
    scripts/zarr_matrix.py build/release/bin/isoscope FOLDER --zarrita NODE_FOLDER

Writers: zarr-python and GDAL of Debian (python3-zarr, python3-numcodecs, python3-gdal; one that is missing is left out),
and with --zarrita the package of npm in NODE_FOLDER/node_modules, which needs node.
"""

import argparse
import collections
import json
import pathlib
import random
import shutil
import subprocess
import sys

SHAPE, CHUNKS = (5, 7, 9), (2, 3, 4)
NUMBERS = ('u2', 'i2', 'u4', 'i4', 'u8', 'i8', 'f2', 'f4', 'f8')

ZARRITA = '''
import * as zarr from "zarrita";
import { FileSystemStore } from "@zarrita/storage";
const names = [];
const types = { int8: Int8Array, uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, int32: Int32Array,
  uint32: Uint32Array, float32: Float32Array, float64: Float64Array, int64: BigInt64Array, uint64: BigUint64Array };
const keys = { "default/": ["default", "/"], "default.": ["default", "."], "v2/": ["v2", "/"], "v2.": ["v2", "."] };
for (const [type, Numbers] of Object.entries(types)) {
  const root = zarr.root(new FileSystemStore(`${process.argv[2]}/${type}`));
  await zarr.create(root, { attributes: {} });
  const isBig = Numbers === BigInt64Array || Numbers === BigUint64Array;
  const size = Numbers.BYTES_PER_ELEMENT;
  const le = { name: "bytes", configuration: { endian: "little" } };
  const be = { name: "bytes", configuration: { endian: "big" } };
  const codec = (name, configuration) => [le, { name, configuration }];
  const chains = {
    "bytes little": [le], "bytes big": [be], gzip: codec("gzip", { level: 5 }), zlib: codec("zlib", { level: 5 }),
    zstd: codec("zstd", { level: 3, checksum: false }), lz4: codec("lz4", { acceleration: 1 }),
    blosc: codec("blosc", { cname: "lz4", clevel: 5, shuffle: "shuffle", typesize: size, blocksize: 0 }),
    "blosc zstd": codec("blosc", { cname: "zstd", clevel: 5, shuffle: "bitshuffle", typesize: size, blocksize: 0 }),
    crc32c: codec("crc32c", {}),
    "transpose F": [{ name: "transpose", configuration: { order: "F" } }, le],
    "transpose 2 0 1, gzip": [{ name: "transpose", configuration: { order: [2, 0, 1] } }, be,
      { name: "gzip", configuration: { level: 1 } }],
  };
  for (const [chain, codecs] of Object.entries(chains)) for (const [key, [name, separator]] of Object.entries(keys)) {
    const array = names.length.toString();
    try {
      const made = await zarr.create(root.resolve(array), { shape: [5, 7, 9], chunk_shape: [2, 3, 4],
        chunkShape: [2, 3, 4], data_type: type, dtype: type, fill_value: 0, fillValue: 0, codecs,
        chunk_key_encoding: { name, configuration: { separator } },
        chunkKeyEncoding: { name, configuration: { separator } } });
      const data = new Numbers(315);
      for (let i = 0; i < 315; i++) data[i] = isBig ? BigInt((i * 37) % 120) : (i * 37) % 120;
      await zarr.set(made, null, { data, shape: [5, 7, 9], stride: [63, 9, 1] });
      names.push([`${type}/${array}`, chain, type, key, ""]);
    } catch (e) { names.push([array, chain, type, key, String(e)]); }
  }
}
console.log(JSON.stringify(names));
'''


def samples_of(np, dtype):
    """The same for all writers."""
    values = (np.arange(315) * 37 % 120).reshape(SHAPE)
    return (values > 60 if np.dtype(dtype).kind == 'b' else values).astype(dtype)


def write_with_zarr_python(folder, np):
    """Yields (path, codec, type, order and keys)."""
    import numcodecs
    import zarr
    compressors = {
        'none': None, 'gzip': numcodecs.GZip(3), 'zlib': numcodecs.Zlib(6), 'bz2': numcodecs.BZ2(2),
        'lz4': numcodecs.LZ4(), 'zstd': numcodecs.Zstd(5), 'lzma': numcodecs.LZMA(),
        'blosc lz4': numcodecs.Blosc('lz4', 5, numcodecs.Blosc.SHUFFLE),
        'blosc lz4hc': numcodecs.Blosc('lz4hc', 5, numcodecs.Blosc.NOSHUFFLE),
        'blosc zstd': numcodecs.Blosc('zstd', 5, numcodecs.Blosc.BITSHUFFLE),
        'blosc zlib': numcodecs.Blosc('zlib', 5, numcodecs.Blosc.SHUFFLE),
    }
    for dtype in ['|b1', '|u1', '|i1'] + [order + name for order in '<>' for name in NUMBERS]:
        # A store for each type: with all arrays in one, each command would look at thousands of others.
        store = folder / f'{"big-" if dtype[0] == ">" else ""}{dtype[1:]}'
        root = zarr.open_group(str(store), mode='w')
        data = samples_of(np, dtype)
        chains = {name: (compressor, None) for name, compressor in compressors.items()}
        chains['shuffle, zlib'] = (numcodecs.Zlib(1), [numcodecs.Shuffle(data.dtype.itemsize)])
        if data.dtype.kind != 'b' and data.dtype.itemsize * (data.dtype.kind == 'f') != 2:  # refused by name
            chains['delta, zstd'] = (numcodecs.Zstd(1), [numcodecs.Delta(dtype)])
        for codec, (compressor, filters) in chains.items():
            for order in 'CF':
                for separator in './':
                    name = str(len(root))
                    array = root.create_dataset(name, shape=SHAPE, dtype=dtype, chunks=CHUNKS, order=order,
                                                compressor=compressor, filters=filters,
                                                dimension_separator=separator)
                    array[...] = data
                    yield store / name, codec, dtype, f'{order} {separator}'


def write_with_gdal(folder, np):
    from osgeo import gdal
    gdal.UseExceptions()
    types = {'|u1': gdal.GDT_Byte, '<u2': gdal.GDT_UInt16, '<i2': gdal.GDT_Int16, '<u4': gdal.GDT_UInt32,
             '<i4': gdal.GDT_Int32, '<f4': gdal.GDT_Float32, '<f8': gdal.GDT_Float64, '<u8': gdal.GDT_UInt64,
             '<i8': gdal.GDT_Int64}
    for codec in ('NONE', 'BLOSC', 'GZIP', 'ZLIB', 'LZ4', 'ZSTD', 'LZMA', 'BLOSC FILTER=delta'):
        for order in 'CF':
            for separator in './':
                path = folder / f'{codec}{order}{"dot" if separator == "." else "slash"}.zarr'.replace(' ', '_')
                dataset = gdal.GetDriverByName('Zarr').CreateMultiDimensional(str(path), [], ['FORMAT=ZARR_V2'])
                group = dataset.GetRootGroup()
                dims = [group.CreateDimension(name, None, None, size) for name, size in zip('zyx', SHAPE)]
                for dtype, kind in types.items():
                    options = [f'COMPRESS={codec.split()[0]}', 'BLOCKSIZE=2,3,4', f'CHUNK_MEMORY_LAYOUT={order}',
                               f'DIM_SEPARATOR={separator}'] + codec.split()[1:]
                    array = group.CreateMDArray('a' + dtype[1:], dims, gdal.ExtendedDataType.Create(kind), options)
                    array.Write(samples_of(np, dtype))
                del array, dims, group, dataset
                for dtype in types:
                    yield path / ('a' + dtype[1:]), codec, dtype, f'{order} {separator}'


def write_with_zarrita(folder, node_folder):
    script = pathlib.Path(node_folder, 'zarr_matrix.mjs')
    script.write_text(ZARRITA)
    run = subprocess.run(['node', script.name, str(folder)], cwd=node_folder, capture_output=True, text=True,
                         check=False, timeout=600)
    script.unlink()
    if run.returncode:
        raise RuntimeError(run.stderr)
    unwritten = collections.defaultdict(set)
    for name, codec, kind, _, error in json.loads(run.stdout):
        if error:
            unwritten[codec].add(kind)
    for codec, of_types in unwritten.items():
        print(f'zarrita does not write {codec}: {" ".join(sorted(of_types))}')
    for name, codec, kind, keys, error in json.loads(run.stdout):
        if not error:
            dtype = {'f': '<f', 'i': '<i', 'u': '<u'}[kind[0]] + str(int(kind.strip('uintfloat')) // 8)
            yield folder / name, codec, dtype, keys


def digest_of(program, path, folder):
    """(samples_digest or None, what was said)."""
    shutil.rmtree(folder, ignore_errors=True)
    run = subprocess.run([program, 'partition', str(path), '--output', str(folder)], capture_output=True, text=True,
                         check=False, timeout=300)
    if run.returncode:
        return None, run.stderr.strip()
    return json.loads((folder / 'manifest.json').read_text())['samples_digest'], ''


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program', help='isoscope')
    parser.add_argument('folder', type=pathlib.Path, help='for the arrays; is made, and must not exist')
    parser.add_argument('--part', type=float, default=1, help='the part of all arrays that is compared (default: 1)')
    parser.add_argument('--seed', type=int, default=1, help='that chooses the part (default: 1)')
    parser.add_argument('--writer', action='append', help='one of those; may be repeated (default: all)')
    parser.add_argument('--zarrita', metavar='NODE_FOLDER', help='a folder with node_modules/zarrita')
    args = parser.parse_args()
    import numpy as np
    args.folder.mkdir(parents=True)
    writers = {'zarr-python': lambda: write_with_zarr_python(args.folder / 'python.zarr', np),
               'GDAL': lambda: write_with_gdal(args.folder / 'gdal', np)}
    (args.folder / 'gdal').mkdir()
    if args.zarrita:
        writers['zarrita'] = lambda: write_with_zarrita((args.folder / 'zarrita.zarr').absolute(), args.zarrita)
    writers = {name: write for name, write in writers.items() if name in (args.writer or writers)}
    expected = {}
    chance = random.Random(args.seed)
    count, equal, wrong = collections.Counter(), collections.Counter(), []
    kinds = collections.defaultdict(lambda: (set(), set()))
    for writer, write in writers.items():
        try:
            for path, codec, dtype, layout in write():
                if chance.random() >= args.part:
                    continue
                if dtype not in expected:
                    file = args.folder / f'{len(expected)}.npy'
                    np.save(file, samples_of(np, dtype))
                    expected[dtype] = digest_of(args.program, file, args.folder / 'dataset')[0]
                found, said = digest_of(args.program, path, args.folder / 'dataset')
                row = (writer, codec)
                count[row] += 1
                equal[row] += found is not None and found == expected[dtype]
                kinds[row][0].add(dtype)
                kinds[row][1].add(layout)
                if found is None or found != expected[dtype]:
                    wrong.append(f'{writer} {codec} {dtype} {layout}: {said or "other samples"} ({path})')
        except ImportError as error:
            print(f'{writer} is left out: {error}')
    print(f'{"writer":12} {"codec":24} {"types":>5} {"layouts":>7} {"arrays":>6} {"equal":>6}')
    for row, arrays in count.items():
        print(f'{row[0]:12} {row[1]:24} {len(kinds[row][0]):5} {len(kinds[row][1]):7} {arrays:6} {equal[row]:6}')
    print(f'{sum(count.values())} arrays, {sum(equal.values())} equal')
    for line in wrong:
        print(line)
    return 1 if wrong or not count else 0


if __name__ == '__main__':
    sys.exit(main())
