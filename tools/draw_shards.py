#!/usr/bin/python3
"""Draws what each agent draws: a surface, its blocks coloured by their shard.

    tools/draw_shards.py DATASET --isovalue V --output FILE.png [--size N] [isoscope render's camera flags]

DATASET is a folder of `isoscope partition --shards P`. For each shard an agent and a coordinator are started, which
serve this shard alone; `--allow-partial` gives its picture and depths. Of each pixel the nearest fragment of all shards
is kept, as the coordinator does it, in the colour of its shard. Programs: build/release/bin, or $ISOSCOPE_BIN.
"""
import argparse
import os
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy

COLORS = ['#4c78a8', '#f58518', '#54a24b', '#e45756', '#b279a2', '#eeca3b', '#72b7b2', '#9d755d']
PROGRAMS = pathlib.Path(os.environ.get('ISOSCOPE_BIN') or pathlib.Path(__file__).parent.parent / 'build/release/bin')


def start(*command):
    """Starts a server on a free port, and returns it with its address."""
    process = subprocess.Popen([PROGRAMS / command[0], *command[1:]], stderr=subprocess.PIPE, text=True)
    for line in process.stderr:
        found = re.search(r'_started .*?address=(\S+)', line)
        if found:
            return process, found.group(1)
    sys.exit(f'{command[0]} did not start')


def draw_shard(shard, color, arguments, camera, folder):
    """Returns the colours (rows, columns, 3) and depths (rows, columns) of one shard's picture."""
    agent, address = start('isoscope-agent', shard, '--listen', '127.0.0.1:0', '--renderer', 'cpu')
    coordinator, server = start('isoscope-coordinator', '--agent', address, '--listen', '127.0.0.1:0')
    try:
        png, npy = folder / 'picture.png', folder / 'depth.npy'
        subprocess.run([PROGRAMS / 'isoscope', 'render', '--server', server, '--isovalue', arguments.isovalue, '--color',
                        color, '--width', str(arguments.size), '--height', str(arguments.size), '--allow-partial', '-q',
                        '--output', png, '--depth', npy, *camera], check=True, stderr=subprocess.DEVNULL)
        return read_png(png.read_bytes()), numpy.load(npy)
    finally:
        for process in (coordinator, agent):
            process.kill()
            process.wait()
            process.stderr.close()


def read_png(data):
    """Decodes a PNG of 8 bits without interlacing: RGB."""
    width, height, _, kind = struct.unpack('>IIBB', data[16:26])
    channels, at, packed = {2: 3, 6: 4}[kind], 8, b''
    while at < len(data):
        size, = struct.unpack('>I', data[at:at + 4])
        if data[at + 4:at + 8] == b'IDAT':
            packed += data[at + 8:at + 8 + size]
        at += 12 + size
    rows = numpy.frombuffer(zlib.decompress(packed), numpy.uint8).reshape(height, 1 + width * channels)
    picture = numpy.zeros((height + 1, width + 1, channels), numpy.int32)  # a row above, a column at the left
    for y in range(height):
        method, row = rows[y, 0], rows[y, 1:].reshape(width, channels).astype(numpy.int32)
        above, out = picture[y], picture[y + 1]
        for x in range(width):
            left, up, corner = out[x], above[x + 1], above[x]
            if method == 1:
                predicted = left
            elif method == 2:
                predicted = up
            elif method == 3:
                predicted = (left + up) // 2
            elif method == 4:
                p = left + up - corner
                a, b, c = abs(p - left), abs(p - up), abs(p - corner)
                predicted = numpy.where((a <= b) & (a <= c), left, numpy.where(b <= c, up, corner))
            else:
                predicted = 0
            out[x + 1] = (row[x] + predicted) & 255
    return picture[1:, 1:, :3].astype(numpy.uint8)


def write_png(path, picture):
    height, width, _ = picture.shape
    rows = b''.join(b'\0' + row.tobytes() for row in picture)

    def chunk(kind, data):
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))

    path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 2, 0, 0, 0)) +
                     chunk(b'IDAT', zlib.compress(rows, 9)) + chunk(b'IEND', b''))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('dataset', type=pathlib.Path)
    parser.add_argument('--isovalue', required=True)
    parser.add_argument('--output', type=pathlib.Path, required=True)
    parser.add_argument('--size', type=int, default=800)
    arguments, camera = parser.parse_known_args()
    shards = sorted(arguments.dataset.glob('shard-*-of-*'))
    if not shards:
        sys.exit(f'{arguments.dataset}: no shards; make them with isoscope partition')
    picture = numpy.zeros((arguments.size, arguments.size, 3), numpy.uint8)
    nearest = numpy.full((arguments.size, arguments.size), numpy.inf)
    with tempfile.TemporaryDirectory() as folder:
        for index, shard in enumerate(shards):
            colors, depths = draw_shard(shard, COLORS[index % len(COLORS)], arguments, camera, pathlib.Path(folder))
            wins = depths < nearest
            nearest[wins], picture[wins] = depths[wins], colors[wins]
    write_png(arguments.output, picture)


if __name__ == '__main__':
    main()
