#!/usr/bin/env python3
"""Asks a coordinator for the largest requests that its --memory-limit lets through, 32 at a time.

For each kind of request (plain pictures, planes, samples, translucent layers, effects, meshes) starts
fresh processes, finds the largest picture that is not refused, asks for it once and then by all
clients together, and reads the peak of the coordinator's resident memory (VmHWM) from /proc. Fails
if it is above the limit and --base-mib, the memory of the process itself, or if a request fails.

    scripts/memory_peak.py DIR --isovalues 60,128
    scripts/memory_peak.py DIR --isovalues 60,128 --memory-limit 128MiB --kinds planes,layers

Needs a release build and the packages of clients/python (python3-grpcio, python3-numpy).
"""

import argparse
import os
import pathlib
import threading
import time

from memory_soak import ROOT, Cluster, connect, memory_kib

MAX_SIDE_PX = 16384
UNITS = {"KiB": 1 / 1024, "MiB": 1, "GiB": 1024}


def requests_of(low, high):
    """Arguments of Dataset.render by kind; None: a mesh."""
    from isoscope import Surface

    return {
        "plain": {"isovalue": low},
        "raw": {"isovalue": low, "format": "rgba"},
        "planes": {"isovalue": low, "planes": ["depth", "position", "normal", "surface_index"]},
        "samples": {"isovalue": low, "samples": 4},
        "layers": {"surfaces": [Surface(value, opacity=0.3) for value in (low, (low + high) / 2, high)]},
        "effects": {"isovalue": low, "ambient_occlusion": True, "silhouette": True, "lights": [(1, 1, 1)]},
        "mesh": None,
    }


def largest_side(dataset, arguments):
    """Returns the longest side of a square picture that fits, to 64 pixels."""
    import isoscope

    fits, too_large = 64, MAX_SIDE_PX + 64
    while too_large - fits > 64:
        side = (fits + too_large) // 2
        try:
            dataset.render(size=side, **arguments)
            fits = side
        except (isoscope.ResourceExhaustedError, isoscope.InvalidArgumentError):
            too_large = side
    return fits


def measure(options, kind, arguments):
    """Returns side in pixels, peaks in MiB of the first request and of all, and the errors."""
    cluster = Cluster(pathlib.Path(options.programs), options.dataset, options.agent_memory_limit, options.memory_limit)
    errors = []
    try:
        dataset = connect(cluster.address, timeout=options.timeout)
        side = 0 if arguments is None else largest_side(dataset, arguments)

        def ask():
            try:
                dataset.mesh(options.low) if arguments is None else dataset.render(size=side, **arguments)
            except Exception as error:  # whatever it is, it is the result
                errors.append(f"{type(error).__name__}: {error}")

        ask()
        pid = cluster.processes["coordinator"].pid
        alone = memory_kib(pid, "VmHWM") / 1024
        threads = [threading.Thread(target=ask) for _ in range(options.clients)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return side, alone, memory_kib(pid, "VmHWM") / 1024, errors
    finally:
        cluster.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", help="folder of a dataset, as 'isoscope partition' makes it")
    parser.add_argument("--isovalues", default="60,128", metavar="LOW,HIGH", help="default: 60,128")
    parser.add_argument("--memory-limit", default="256MiB", help="of the coordinator (default: 256MiB)")
    parser.add_argument("--agent-memory-limit", default="4GiB", help="of each agent (default: 4GiB)")
    parser.add_argument("--base-mib", type=float, default=48, help="memory of the process itself (default: 48)")
    parser.add_argument("--clients", type=int, default=32, help="that ask at a time (default: 32)")
    parser.add_argument("--kinds", help="some of them, with commas (default: all)")
    parser.add_argument("--timeout", type=float, default=300, help="of a request, seconds (default: 300)")
    parser.add_argument("--programs", default=os.environ.get("ISOSCOPE_BIN", ROOT / "build" / "release" / "bin"))
    options = parser.parse_args()
    options.low, high = map(float, options.isovalues.split(","))
    number, unit = options.memory_limit[:-3], options.memory_limit[-3:]
    if unit not in UNITS or not number.isdigit():
        raise SystemExit(f"memory_peak.py: --memory-limit {options.memory_limit}: must be as 256MiB or 1GiB")
    bound = float(number) * UNITS[unit] + options.base_mib

    kinds = requests_of(options.low, high)
    failed = []
    for kind in options.kinds.split(",") if options.kinds else kinds:
        if kind not in kinds:
            raise SystemExit(f"memory_peak.py: --kinds {kind}: must be of {', '.join(kinds)}")
        start = time.monotonic()
        side, alone, together, errors = measure(options, kind, kinds[kind])
        what = f"{side} x {side}" if side else "all of it"
        print(f"{kind:8} {what:13} peak {alone:6.1f} MiB alone, {together:6.1f} MiB by {options.clients} at a time; "
              f"{len(errors)} errors, {time.monotonic() - start:.0f} s", flush=True)
        for error in errors[:2]:
            print("  error:", error)
        if errors or together > bound:
            failed.append(kind)
    if failed:
        raise SystemExit(f"memory_peak.py: failed: {', '.join(failed)}: above {bound:.0f} MiB, or a request failed")


if __name__ == "__main__":
    main()
