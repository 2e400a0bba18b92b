#!/usr/bin/env python3
"""Asks real processes for thousands of different frames, and watches their memory.

Starts one isoscope-agent for each shard and a coordinator, asks for frames of random views, sizes,
isovalues, effects and planes, and notes the resident memory of every process each so many frames,
when they have rested for a while: then they have given back what they freed. Fails if a frame fails,
or if a process grows after the warm-up by more than the tolerance in 10 000 frames, by the line
through the looks and two standard errors. A look differs from the next by some percent, so that more
frames and looks make the answer more certain.

    scripts/memory_soak.py DIR --isovalues 20,200
    scripts/memory_soak.py DIR --isovalues 20,200 --frames 40000 --every 1000 --csv soak.csv

Needs a release build and the packages of clients/python (python3-grpcio, python3-numpy).
"""

import argparse
import concurrent.futures
import os
import pathlib
import random
import socket
import statistics
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "clients" / "python" / "src"))


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def memory_kib(pid, name):
    """Returns VmRSS or VmHWM of a process; 0 if it has ended."""
    with open(f"/proc/{pid}/status", encoding="ascii") as status:
        for line in status:
            if line.startswith(f"{name}:"):
                return int(line.split()[1])
    return 0


def connect(address, timeout=120.0):
    """Waits for the coordinator and its dataset, and returns the latter."""
    import isoscope

    deadline = time.monotonic() + 30
    while True:
        try:
            return isoscope.connect(address, connect_timeout=2, timeout=timeout).datasets()[0]
        except (isoscope.IsoscopeError, IndexError):
            if time.monotonic() > deadline:
                raise SystemExit(f"the cluster at {address} does not answer within 30 s") from None
            time.sleep(0.2)


class Cluster:
    """One agent for each shard of `folder`, and a coordinator."""

    def __init__(self, programs, folder, agent_memory_limit, memory_limit):
        self.processes = {}
        shards = sorted(pathlib.Path(folder).glob("shard-*-of-*"))
        if not shards:
            raise SystemExit(f"{folder}: no shards; name a dataset's folder")
        agents = []
        for number, shard in enumerate(shards):
            address = f"127.0.0.1:{free_port()}"
            name = f"agent {number}"
            self._start(name, programs / "isoscope-agent", "--shard", shard, "--listen", address, "--renderer", "cpu",
                        "--memory-limit", agent_memory_limit)
            agents += ["--agent", address]
        self.address = f"127.0.0.1:{free_port()}"
        self._start("coordinator", programs / "isoscope-coordinator", *agents, "--listen", self.address,
                    "--memory-limit", memory_limit)

    def _start(self, name, *command):
        self.processes[name] = subprocess.Popen(
            [*map(str, command), "--log-level", "error"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def memory(self):
        return {name: memory_kib(process.pid, "VmRSS") / 1024 for name, process in self.processes.items()}

    def stop(self):
        for process in self.processes.values():
            process.terminate()
        for process in self.processes.values():
            process.wait(30)


def random_frame(draw, levels, most_px):
    """Arguments of a frame. One in four has something besides a plain picture."""
    side = draw.choice([64, 128, 256, most_px])
    level = draw.randrange(len(levels))
    arguments = {
        "isovalue": levels[level],
        "azimuth": draw.uniform(0, 360),
        "elevation": draw.uniform(-80, 80),
        "zoom": draw.uniform(0.7, 4),
        "size": (side, max(16, int(side * draw.uniform(0.5, 1)))),
    }
    kind = draw.randrange(16)
    if kind == 0:
        arguments["planes"] = ["depth", "normal"]
    elif kind == 1:
        arguments["samples"] = 4
    elif kind == 2:
        arguments["ambient_occlusion"] = True
    elif kind == 3:
        del arguments["isovalue"]
        arguments["surfaces"] = [levels[level], levels[level - len(levels) // 2]]
    return arguments


def ask(dataset, draws, frames, clients):
    """Asks for some frames, a few at a time, and waits for all. Returns the errors."""

    def one(arguments):
        try:
            dataset.render(**arguments)
        except Exception as error:  # whatever it is, it is the result
            return f"{type(error).__name__}: {error}"
        return None

    arguments = [draws() for _ in range(frames)]
    return [error for error in clients.map(one, arguments) if error]


def growth_percent(frames, values):
    """Growth in 10 000 frames by the line through the looks, in percent of their mean, and two standard errors."""
    slope, intercept = statistics.linear_regression(frames, values)
    residuals = sum((v - intercept - slope * f) ** 2 for f, v in zip(frames, values))
    mean = statistics.fmean(frames)
    spread = sum((f - mean) ** 2 for f in frames)
    error = (residuals / max(1, len(frames) - 2) / spread) ** 0.5
    scale = 100 * 10000 / statistics.fmean(values)
    return slope * scale, 2 * error * scale


def verdict(rows, options):
    """Prints a line for each process; returns whether all are flat, for certain."""
    after = [row for row in rows if row[0] > options.warm_up]
    if len(after) < 3:
        raise SystemExit(f"memory_soak.py: {len(after)} looks after the warm-up, at least 3 are needed: more --frames")
    is_flat = True
    for column, name in enumerate(options.names, start=2):
        values = [row[column] for row in after]
        growth, error = growth_percent([row[0] for row in after], values)
        is_flat = is_flat and growth + error <= options.tolerance
        answer = "flat" if growth + error <= options.tolerance else "GROWS" if growth - error > options.tolerance else "UNDECIDED"
        print(f"{name:12} {answer:9} {growth:+.2f} % +- {error:.2f} % in 10 000 frames; mean {statistics.fmean(values):.1f} MiB, "
              f"{min(values):.1f} to {max(values):.1f} in {len(values)} looks")
    return is_flat


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", help="folder of a dataset, as 'isoscope partition' makes it")
    parser.add_argument("--isovalues", default="20,200", metavar="LOW,HIGH", help="range (default: 20,200)")
    parser.add_argument(
        "--levels", type=int, default=200,
        help="isovalues in it (default: 200): caches of what each needs are full after the warm-up",
    )  # fmt: skip
    parser.add_argument("--frames", type=int, default=10000, help="default: 10000")
    parser.add_argument("--warm-up", type=int, default=1000, help="frames before memory must be flat (default: 1000)")
    parser.add_argument("--every", type=int, default=250, help="frames between two looks (default: 250)")
    parser.add_argument("--rest", type=float, default=11, help="seconds without a frame before a look (default: 11)")
    parser.add_argument("--clients", type=int, default=4, help="that ask at a time (default: 4)")
    parser.add_argument("--size", type=int, default=512, help="longest side of a picture (default: 512)")
    parser.add_argument("--memory-limit", default="512MiB", help="of each process (default: 512MiB)")
    parser.add_argument("--tolerance", type=float, default=2, help="percent in 10 000 frames (default: 2)")
    parser.add_argument("--seed", type=int, default=1, help="of the frames (default: 1)")
    parser.add_argument("--csv", help="file for the curve")
    parser.add_argument("--programs", default=os.environ.get("ISOSCOPE_BIN", ROOT / "build" / "release" / "bin"))
    options = parser.parse_args()
    lowest, highest = map(float, options.isovalues.split(","))
    step = (highest - lowest) / max(1, options.levels - 1)
    levels = [lowest + i * step for i in range(options.levels)]

    cluster = Cluster(pathlib.Path(options.programs), options.dataset, options.memory_limit, options.memory_limit)
    options.names = list(cluster.processes)
    rows = []
    errors = []
    draw = random.Random(options.seed)
    start = time.monotonic()
    try:
        dataset = connect(cluster.address)
        with concurrent.futures.ThreadPoolExecutor(options.clients) as clients:
            done = 0
            while done < options.frames and not errors:
                frames = min(options.every, options.frames - done)
                errors = ask(dataset, lambda: random_frame(draw, levels, options.size), frames, clients)
                done += frames
                time.sleep(options.rest)
                rows.append([done, time.monotonic() - start, *cluster.memory().values()])
                if len(rows) % 10 == 1:
                    print(f"{done:7} frames {rows[-1][1]:7.1f} s  "
                          + ", ".join(f"{n} {v:.1f} MiB" for n, v in zip(options.names, rows[-1][2:])), flush=True)
    finally:
        cluster.stop()
    if options.csv:
        with open(options.csv, "w", encoding="utf-8") as file:
            file.write(",".join(["frames", "seconds", *options.names]) + "\n")
            file.writelines(",".join(f"{value:.2f}" for value in row) + "\n" for row in rows)
    print(f"{done} frames in {rows[-1][1]:.0f} s, seed {options.seed}, {len(errors)} errors")
    for error in errors[:3]:
        print("error:", error)
    is_flat = verdict(rows, options)
    if errors or not is_flat:
        raise SystemExit(f"memory_soak.py: failed: a frame failed, or it is not certain that memory grows by less than {options.tolerance} %")


if __name__ == "__main__":
    main()
