#!/usr/bin/env python3
"""Compares the Zarr arrays below a folder, of one and two axes, too, with what other readers make of them.

Test data of other projects mostly have one or two axes, and are no volumes. So each array is lifted: a copy of it gets
axes of 2 in front, with chunks of 1, and each of its chunks stands there under each new key. Their bytes stay as they
are. Each copy is partitioned, and so is a `.npy` of what another reader makes of the same copy: samples_digest of the
two must be equal. An array counts as

    equal     to all the readers that took it
    opened    by isoscope alone
    differs   from one of them
    refused   with a sentence, and the readers that took it
    crashed   ended by a signal, or with another exit code than 1
    hung      not done after a minute

    scripts/zarr_fixtures.py build/release/bin/isoscope TREE FOLDER
    scripts/zarr_fixtures.py build/release/bin/isoscope TREE FOLDER --zarrita NODE_FOLDER

Prints a table by the folders of TREE, and each array that is not equal. Fails if one differs, crashed or hung. The
readers are those of scripts/zarr_matrix.py (of Zarr 2 zarr-python and GDAL, of Zarr 3 zarrita), and NumPy with
numcodecs for Zarr 3. Of arrays of more than 64 MiB `isoscope info` looks at the metadata alone.
"""

import argparse
import collections
import itertools
import json
import multiprocessing
import os
import pathlib
import shutil
import subprocess
import sys

import survey_readers

PATIENCE_S = 60
MAX_BYTES = 64 << 20
AXES = {3: 'ZYX', 4: 'TZYX', 5: 'TCZYX'}

ZARRITA = '''
import * as zarr from "zarrita";
import { FileSystemStore } from "@zarrita/storage";
import { readFileSync, writeFileSync } from "node:fs";
for (const path of JSON.parse(readFileSync(process.argv[2], "utf8"))) {
  try {
    const array = await zarr.open.v3(zarr.root(new FileSystemStore(path)), { kind: "array" });
    const { data, shape, stride } = await zarr.get(array, null);
    writeFileSync(path + ".raw", new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    writeFileSync(path + ".raw.json", JSON.stringify({ dtype: array.dtype, shape, stride }));
  } catch (e) { writeFileSync(path + ".raw.json", JSON.stringify({ error: String(e) })); }
}
'''


def metadata_of(folder):
    """(version, metadata) of an array, or None."""
    for version, name in ((3, 'zarr.json'), (2, '.zarray')):
        path = folder / name
        if path.is_file():
            try:
                metadata = json.loads(path.read_text())
            except ValueError:
                continue
            if version == 2 or (isinstance(metadata, dict) and metadata.get('node_type') == 'array'):
                return version, metadata
    return None


def lifted_codecs(codecs, more):
    """Codecs of Zarr 3 for `more` axes in front."""
    codecs = json.loads(json.dumps(codecs))
    for codec in codecs:
        configuration = codec.get('configuration', {}) if isinstance(codec, dict) else {}
        if isinstance(configuration.get('order'), list):
            configuration['order'] = list(range(more)) + [axis + more for axis in configuration['order']]
        if 'chunk_shape' in configuration:
            configuration['chunk_shape'] = [1] * more + configuration['chunk_shape']
            for name in ('codecs', 'index_codecs'):
                # An index has one axis more than its array.
                configuration[name] = lifted_codecs(configuration.get(name, []), more)
    return codecs


def lift(folder, version, metadata, copy):
    """Writes the array into `copy` with three axes at least, without attributes. Returns its metadata."""
    shape = metadata['shape']
    more = max(0, 3 - len(shape))
    metadata = json.loads(json.dumps(metadata))
    metadata['shape'] = [2] * more + shape
    prefix, separator = '', '.'
    if version == 2:
        chunks = metadata['chunks']
        metadata['chunks'] = [1] * more + chunks
        separator = metadata.get('dimension_separator') or '.'
        (copy / '.zarray').write_text(json.dumps(metadata))
    else:
        chunks = metadata['chunk_grid']['configuration']['chunk_shape']
        metadata['chunk_grid']['configuration']['chunk_shape'] = [1] * more + chunks
        for name in ('attributes', 'dimension_names'):
            metadata.pop(name, None)
        if 'codecs' in metadata:
            metadata['codecs'] = lifted_codecs(metadata['codecs'], more)
        keys = metadata['chunk_key_encoding']
        prefix = 'c' if keys['name'] == 'default' else ''
        separator = keys.get('configuration', {}).get('separator', '/' if prefix else '.')
        (copy / 'zarr.json').write_text(json.dumps(metadata))
    counts = [-(-size // chunk) if chunk else 0 for size, chunk in zip(shape, chunks)]
    for place in itertools.islice(itertools.product(*map(range, counts)), 100_000):
        words = [str(number) for number in place]
        chunk = folder / (separator.join(([prefix] if prefix else []) + words) or '0')
        if not chunk.is_file():
            continue
        for front in itertools.product('01', repeat=more):
            target = copy / separator.join(([prefix] if prefix else []) + [*front, *words])
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(chunk, target)
    return metadata


def read_with_gdal(path):
    from osgeo import gdal
    gdal.UseExceptions()
    group = gdal.OpenEx(str(path), gdal.OF_MULTIDIM_RASTER).GetRootGroup()
    return group.OpenMDArray(group.GetMDArrayNames()[0]).ReadAsArray()


def read_with_zarr_python(path):
    import zarr
    array = zarr.open_array(str(path), mode='r')
    if array.fill_value is None and array.nchunks_initialized < array.nchunks:
        raise ValueError('it leaves missing chunks to chance')
    return array[...]


def read_with_numpy(path):
    return survey_readers.read_zarr3(str(path), json.loads((path / 'zarr.json').read_text()))


def read_with_zarrita(path):
    import numpy as np
    told = json.loads(pathlib.Path(f'{path}.raw.json').read_text())
    values = np.fromfile(f'{path}.raw', np.dtype(told['dtype']))
    return np.lib.stride_tricks.as_strided(values, told['shape'], [step * values.itemsize for step in told['stride']])


def write_npy(read, path, target):
    import numpy as np
    os.close(2)  # what readers say of arrays that they do not take
    array = np.asarray(read(path), order='C')
    if array.dtype.kind not in 'biuf':
        sys.exit(1)
    np.save(target, array)


def npy_of(read, path, target):
    """Reads in a process of its own, since other readers may crash."""
    process = multiprocessing.Process(target=write_npy, args=(read, path, target))
    process.start()
    process.join(PATIENCE_S)
    if process.is_alive():
        process.kill()
        process.join()
    return process.exitcode == 0


def partition(program, source, axes, folder, looks=False):
    """(the samples_digest of each step or None, outcome, what was said). looks: info alone, without samples."""
    shutil.rmtree(folder, ignore_errors=True)
    command = ['info', str(source)] if looks else ['partition', str(source), '--output', str(folder)]
    try:
        run = subprocess.run([program, *command, '--axes', axes], capture_output=True, text=True, errors='replace',
                             check=False, timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        return None, 'hung', ''
    said = run.stderr.strip()
    if run.returncode:
        return None, 'refused' if run.returncode == 1 and 'isoscope: ' in said else 'crashed', said
    if looks:
        return [], 'opened', ''
    manifests = [json.loads(path.read_text()) for path in sorted(folder.rglob('manifest.json'))]
    return [manifest['samples_digest'] for manifest in manifests if 'samples_digest' in manifest], 'opened', ''


def type_of(version, metadata):
    kind = metadata['dtype' if version == 2 else 'data_type']
    return kind if isinstance(kind, str) else json.dumps(kind)


def is_large(metadata):
    samples = 8
    for size in metadata['shape']:
        samples *= size
    return samples > MAX_BYTES


def arrays_below(tree):
    for folder, folders, _ in os.walk(tree, followlinks=True):
        folders.sort()
        path = pathlib.Path(folder)
        found = metadata_of(path)
        if found:
            folders.clear()
            yield path, *found


def compare(args, path, copy, version):
    """(outcome, what was said, readers that took it, readers that differ)"""
    metadata = metadata_of(copy)[1]
    axes = AXES.get(len(metadata['shape']), 'ZYX')
    looks = is_large(metadata)
    digest, outcome, said = partition(args.program, copy, axes, args.folder / 'dataset', looks)
    took, differ = [], []
    if not looks:
        readers = ({'zarr-python': read_with_zarr_python, 'GDAL': read_with_gdal} if version == 2 else
                   {'NumPy': read_with_numpy, 'zarrita': read_with_zarrita})
        for name, read in readers.items():
            npy = args.folder / 'other.npy'
            if npy_of(read, copy, npy):
                other = partition(args.program, npy, axes, args.folder / 'other')[0]
                took.append(name)
                if digest is not None and digest != other:
                    differ.append(name)
    if digest:
        outcome = 'differs' if differ else 'equal' if took else 'opened'
    return outcome, said, took, differ


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program', help='isoscope')
    parser.add_argument('tree', type=pathlib.Path, help='whose arrays are compared')
    parser.add_argument('folder', type=pathlib.Path, help='for the copies; is made, and must not exist')
    parser.add_argument('--zarrita', metavar='NODE_FOLDER', help='a folder with node_modules/zarrita')
    args = parser.parse_args()
    args.folder.mkdir(parents=True)
    lifted, rows = [], collections.defaultdict(collections.Counter)
    told = []
    for path, version, metadata in arrays_below(args.tree):
        repository = path.relative_to(args.tree).parts[0] if path != args.tree else '.'
        copy = args.folder.absolute() / 'arrays' / f'{len(lifted)}.zarr'
        copy.mkdir(parents=True)
        try:
            lift(path, version, metadata, copy)
            lifted.append((repository, path, copy, version))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            shutil.rmtree(copy)
            rows[repository]['no metadata'] += 1
            told.append(f'no metadata: {path}: {type(error).__name__} {error}')
    if args.zarrita:
        small = [str(copy) for _, _, copy, version in lifted
                 if version == 3 and not is_large(metadata_of(copy)[1])]
        (args.folder / 'paths.json').write_text(json.dumps(small))
        script = pathlib.Path(args.zarrita, 'zarr_fixtures.mjs')
        script.write_text(ZARRITA)
        subprocess.run(['node', script.name, str((args.folder / 'paths.json').absolute())], cwd=args.zarrita,
                       check=False, timeout=1200)
        script.unlink()
    for repository, path, copy, version in lifted:
        outcome, said, took, differ = compare(args, path, copy, version)
        rows[repository][outcome] += 1
        for name in took:
            rows[repository][name] += outcome == 'equal'
        if outcome != 'equal':
            last = said.splitlines()[-1] if said else ''
            told.append(f'{outcome}{": " + ", ".join(differ) if differ else ""}: {path}: '
                        f'{type_of(version, metadata_of(copy)[1])}: {last}'
                        + (f' (taken by {", ".join(took)})' if took and outcome == 'refused' else ''))
    columns = ('equal', 'zarr-python', 'GDAL', 'NumPy', 'zarrita', 'opened', 'differs', 'refused', 'no metadata',
               'crashed', 'hung')
    print(f'{"":32}' + ''.join(f'{column:>12}' for column in columns))
    for repository, counts in sorted(rows.items()):
        print(f'{repository:32}' + ''.join(f'{counts[column]:12}' for column in columns))
    for line in sorted(told):
        print(line)
    bad = sum(counts[column] for counts in rows.values() for column in ('differs', 'crashed', 'hung'))
    print(f'{len(lifted)} arrays, {bad} bad')
    return 1 if bad or not lifted else 0


if __name__ == '__main__':
    sys.exit(main())
