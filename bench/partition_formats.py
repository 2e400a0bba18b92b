#!/usr/bin/env python3
"""Partitions one volume of uint16 from a file of each format: time and peak memory.

    python3 bench/partition_formats.py --bin build/release/bin
    python3 bench/partition_formats.py --bin OLD/bin --bin build/release/bin --runs 15 --dims 512,512,234

The volume is smooth with noise, so that compressed files are a half of it. Each run calls `isoscope partition FILE
--memory-limit 128MiB` for each format and each folder of programs in turn. Time is the wall clock of the whole
program. Memory is the peak of the program (VmHWM, read until it ends) plus that of its child process, where a library
reads the file; pages that both share count twice. Two --bin folders compare two versions: the first is the base, and
the table has medians of the ratios of pairs, base over the other.

Needs python3-numpy, python3-h5py, python3-netcdf4, python3-pydicom, python3-pil and python3-openvdb.
"""
import argparse
import json
import os
import pathlib
import select
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import numpy

from volume_writers import FORMATS

LIMIT = '128MiB'


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bin', action='append', required=True, help='folder of the programs; the first is the base')
    parser.add_argument('--dims', default='512,512,320', help='samples on x, y and z')
    parser.add_argument('--formats', help='some of them, by names of the table, separated by commas')
    parser.add_argument('--runs', type=int, default=3)
    parser.add_argument('--folder', help='for the files (default: a temporary one)')
    parser.add_argument('--json', help='where all measurements go')
    return parser.parse_args()


def make_volume(dims):
    nx, ny, nz = dims
    z, y, x = numpy.ogrid[0:nz, 0:ny, 0:nx]
    smooth = 8000 * (numpy.sin(x / 37) + numpy.sin(y / 29) + numpy.sin(z / 23)) + 30000
    return (smooth + numpy.random.default_rng(1).integers(0, 256, (nz, ny, nx))).astype('<u2')


def peak_kib(pid):
    """The largest resident memory of a process so far; 0 if it is gone."""
    try:
        for line in pathlib.Path(f'/proc/{pid}/status').read_text().splitlines():
            if line.startswith('VmHWM:'):
                return int(line.split()[1])
    except OSError:
        pass
    return 0


def children_of(pid):
    try:
        return [int(child) for child in pathlib.Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]
    except OSError:
        return []


def partition(program, path, flags, output):
    """Seconds, MiB of the program and of its children; None in place of all if it refused the file."""
    shutil.rmtree(output, ignore_errors=True)
    start = time.perf_counter()
    process = subprocess.Popen([program, 'partition', path, *flags, '--output', output, '--memory-limit', LIMIT],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    own, of_children = 0, {}
    end = os.pidfd_open(process.pid)
    while not select.select([end], [], [], 0.02)[0]:
        own = max(own, peak_kib(process.pid))
        for child in children_of(process.pid):
            of_children[child] = max(of_children.get(child, 0), peak_kib(child))
    seconds = time.perf_counter() - start
    os.close(end)
    if process.wait() != 0:
        print(process.stderr.read().strip()[:300], file=sys.stderr)
        return None
    return seconds, own / 1024, max(of_children.values(), default=0) / 1024


def main():
    arguments = parse_arguments()
    names = arguments.formats.split(',') if arguments.formats else list(FORMATS)
    samples = make_volume([int(n) for n in arguments.dims.split(',')])
    measured = {}
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        folder = pathlib.Path(folder)
        print('| format | seconds | program, MiB | child, MiB |' + (' ratio |' if len(arguments.bin) > 1 else ''))
        print('|---|---|---|---|' + ('---|' if len(arguments.bin) > 1 else ''), flush=True)
        for name in names:
            files = folder / 'files'
            files.mkdir()
            path, flags = FORMATS[name](files, samples)
            runs = []
            for run in range(arguments.runs):
                order = arguments.bin if run % 2 == 0 else arguments.bin[::-1]
                pair = {bin_: partition(pathlib.Path(bin_) / 'isoscope', path, flags, folder / 'out') for bin_ in order}
                runs.append(pair)
            shutil.rmtree(files)
            measured[name] = runs
            rows = [[run[bin_] for run in runs] for bin_ in arguments.bin]
            if None in rows[-1]:
                print(f'| {name} | refused | | |', flush=True)
                continue
            seconds = statistics.median(row[0] for row in rows[-1])
            line = f'| {name} | {seconds:.2f} | {max(r[1] for r in rows[-1]):.0f} | {max(r[2] for r in rows[-1]):.0f} |'
            if len(arguments.bin) > 1:
                known = None not in rows[0]
                line += f' {statistics.median(a[0] / b[0] for a, b in zip(*rows)):.3f} |' if known else ' new |'
            print(line, flush=True)
    if arguments.json:
        pathlib.Path(arguments.json).write_text(json.dumps({'dims': arguments.dims, 'runs': measured}, indent=1))


if __name__ == '__main__':
    main()
