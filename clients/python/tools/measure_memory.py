"""Measures the memory that `isoscope.serve` takes for an array of dask:

    python3 clients/python/tools/measure_memory.py [--side 1024] [--chunk 256] [--xarray]

The array is side^3 of uint16 in chunks of chunk^3, which are computed as they are written. Printed is the largest
resident memory of this process, before and after. $ISOSCOPE_BIN names the program.
"""

import argparse
import pathlib
import resource
import sys
import time

import dask.array
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "src"))

import isoscope  # noqa: E402


def block(block_info=None):
    """A ramp along the axes, which is made without other arrays of its size."""
    (place,) = [info["array-location"] for info in block_info.values() if info]
    z, y, x = (np.arange(begin, end, dtype=np.uint16).reshape(shape) for (begin, end), shape in zip(place, SHAPES))
    return z + (y + x)


SHAPES = ((-1, 1, 1), (1, -1, 1), (1, 1, -1))


def peak_mib():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=1024)
    parser.add_argument("--chunk", type=int, default=256)
    parser.add_argument("--xarray", action="store_true", help="serve an xarray.DataArray of it")
    arguments = parser.parse_args()
    sides = dask.array.core.normalize_chunks((arguments.chunk,) * 3, (arguments.side,) * 3)
    array = dask.array.map_blocks(block, chunks=sides, dtype=np.uint16, meta=np.zeros((0, 0, 0), np.uint16))
    if arguments.xarray:
        import xarray

        array = xarray.DataArray(array, dims=("z", "y", "x"))
    before, begin, written = peak_mib(), time.monotonic(), []

    def note(done, total):
        if done == total:
            written.append(time.monotonic() - begin)

    with isoscope.serve(array, progress=note) as client:
        dims = client.dataset().dims
    print(
        f"{' x '.join(map(str, dims))} of uint16, {2 * arguments.side**3 / 2**20:.0f} MiB: python {before:.0f} MiB "
        f"before, {peak_mib():.0f} MiB at most; written in {written[0]:.1f} s, served after {time.monotonic() - begin:.1f} s"
    )


if __name__ == "__main__":
    main()
