"""The pixels of PNGs, with Python's own library alone."""

import struct
import zlib


def read_png(path):
    """Width, and the rows of RGB triples, of an 8-bit PNG without interlacing."""
    with open(path, 'rb') as file:
        data = file.read()
    at, idat = 8, b''
    while at < len(data):
        size, kind = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        if kind == b'IHDR':
            width, height, _, color = struct.unpack('>IIBB', body[:10])
        if kind == b'IDAT':
            idat += body
        at += size + 12
    channels = {2: 3, 6: 4}[color]
    raw = zlib.decompress(idat)
    rows, before, stride = [], bytearray(width * channels), width * channels
    for y in range(height):
        kind = raw[y * (stride + 1)]
        line = bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            left = line[i - channels] if i >= channels else 0
            corner = before[i - channels] if i >= channels else 0
            up = before[i]
            guess = left + up - corner
            paeth = min((left, up, corner), key=lambda c: abs(guess - c))
            line[i] = (line[i] + (0, left, up, (left + up) // 2, paeth)[kind]) & 255
        rows.append([tuple(line[x * channels:x * channels + 3]) for x in range(width)])
        before = line
    return width, rows
