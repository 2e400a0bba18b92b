#!/usr/bin/env python3
"""Looks for renders that break their memory limit, or whose refusal names a limit that does not do.

Each trial draws a small volume of a random field, type and size, and flags of `isoscope render`: surfaces, opacities,
cuts, colours, effects, planes, sizes, threads, shards. It renders with a small --memory-limit. Where that is refused,
it renders with the limit that the refusal names, and with a tenth less. A run is

    ok         it drew, or refused, and its process never had more memory than the limit
    above      its process had more
    useless    the limit that the refusal names is refused, too
    crash      it ended otherwise, or was refused without a limit that would do
    unfit      the program takes no such picture, whatever the limit; such a trial counts for nothing

The memory of a process is the most that was resident at a time, with the pages of the program and its libraries
(ru_maxrss). That is stricter than docs/operations.md, where the coordinator has as much as the agents besides. An
overrun of --slack is forgiven. Known: trial 84 of --seed 3, a tall picture of 78 x 6355 with all planes and ambient
occlusion, has some 4 MiB more than the 97 MiB that are named.

Prints each run that is not ok with its command, and the numbers. Fails if there is one.

    scripts/memory_limits.py --bin build/release/bin/isoscope --trials 100
"""

import argparse
import collections
import os
import pathlib
import random
import re
import shlex
import subprocess
import sys
import tempfile
import threading

ROOT = pathlib.Path(__file__).resolve().parent.parent
PATIENCE_S = 600
KIB_PER_MIB = 1024
LEAST_MIB = 96
MOST_MIB = 8192  # a larger limit is not tried
# By type: the level that is 0.5 of its range, and the factor of others.
LEVELS = {"uint8": 255, "uint16": 65535, "float32": 1}
GOOD = ("ok", "unfit")
NAMED = re.compile(r"--memory-limit to (\d+)MiB")


def write_volume(trial):
    """Writes the volume; returns the argument of a command, and the flags that choose its surfaces."""
    random_ = trial.random
    field = random_.choice(["random", "random", "gyroid", "shells", "mixing", "marschner-lobb", "labels", "flow"])
    edges = [random_.randint(48, 128) for _ in range(3)]
    if random_.random() < 0.5:
        edges = [edges[0]] * 3
    dims = ["--dims", ",".join(map(str, edges))]
    if field == "flow":
        trial.prepare("generate", field, *dims, "--steps", "2", "-o", "v.pvd")
        return "v.pvd", random_.choice([
            ["--field", "temperature", "--isovalue", "300"],
            ["--field", "temperature", "--isovalue", "300", "--color-by", "pressure"],
            ["--field", "temperature", "--isovalue", "300", "--color-by", "velocity:magnitude:turbo"]])
    kind = random_.choice(sorted(LEVELS))
    trial.prepare("generate", field, *dims, "--type", kind, "--seed", str(random_.randint(1, 99)), "-o", "v.nrrd")
    if field == "labels":
        return "v.nrrd", random_.choice([["--labels", "all"], ["--label", "1-4", "--label", "5-9:#0000ff:0.5"]])
    shares = sorted(random_.uniform(0.3, 0.7) for _ in range(random_.randint(1, 4)))
    levels = [f"{share * LEVELS[kind]:.6g}" for share in shares]
    if random_.random() < 0.5:
        return "v.nrrd", ["--isovalue", levels[0]]
    opacity = random_.choice([None, 0.3, 0.5, 0.8])
    flags = [word for level in levels for word in
             ("--surface", level if opacity is None else f"{level}:#40a0ff:{opacity}")]
    if opacity is not None and random_.random() < 0.7:
        flags += ["--max-layers", str(random_.choice([1, 2, 4, 8, 16]))]
    return "v.nrrd", flags


def size_flags(random_):
    width, height = random_.choice([
        (random_.randint(32, 256), random_.randint(32, 256)), (1024, 1024), (1920, 1080),
        (random_.randint(512, 3000), random_.randint(512, 3000)),
        (random_.randint(16, 200), random_.randint(2000, 30000)),
        (random_.randint(2000, 30000), random_.randint(16, 200))])
    return ["--width", str(width), "--height", str(height)]


def cut_flags(random_):
    flags = []
    for _ in range(random_.randint(1, 3)):
        normal = [random_.uniform(-1, 1) for _ in range(3)]
        flags += [f"--clip-plane={','.join(f'{part:.3f}' for part in normal)},{random_.uniform(-40, 10):.1f}"]
    if random_.random() < 0.3:
        flags += ["--clip-box", "5,40,3,44,7,60"]
    if random_.random() < 0.7:
        flags += ["--caps"]
        if random_.random() < 0.5:
            flags += ["turbo"]
    return flags


def effect_flags(random_):
    """Some of what a frame may have besides."""
    parts = {
        "cut": lambda: cut_flags(random_),
        "color": lambda: ["--color-by", random_.choice(["z", "x:turbo", "gradient", "normal"])],
        "occlusion": lambda: ["--ambient-occlusion", random_.choice(["8", "32", "56,0.5"])],
        "samples": lambda: ["--samples", random_.choice(["4", "4", "9", "16"])],
        "planes": lambda: [word for plane in random_.sample(
            ["depth", "surface-index", "position", "normal", "depth-bounds"], random_.randint(1, 5))
                           for word in (f"--{plane}", f"{plane}.npy")],
        "silhouette": lambda: ["--silhouette", random_.choice(["1", "4", "16"])],
        "culling": lambda: ["--culling", random_.choice(["mask", "none"])],
        "threads": lambda: ["--threads", random_.choice(["1", "2", "8"])],
        "shards": lambda: ["--shards", random_.choice(["2", "4"])],
        "side": lambda: ["--view", random_.choice(["left", "top", "back"])],
        "turned": lambda: ["--azimuth", str(random_.randint(1, 359)), f"--elevation={random_.randint(-80, 80)}"],
        "near": lambda: ["--zoom", random_.choice(["2", "6"])],
        "repeat": lambda: ["--repeat", "2", "--orbit", "20"],
        "annotations": lambda: ["--axes", "--scale-bar", "--caption", "a caption"],
        "quality": lambda: ["--quality", "80"],
    }
    chosen = random_.sample(sorted(parts), random_.choice([0, 1, 1, 2, 2, 3, 4]))
    return [word for name in chosen for word in parts[name]()]


class Trial:
    def __init__(self, program, folder, random_):
        self.program, self.folder, self.random = program, folder, random_
        self.environment = dict(os.environ, XDG_CACHE_HOME=str(folder / "cache"))
        self.environment.pop("ISOSCOPE_CACHE_LIMIT", None)

    def prepare(self, *arguments):
        subprocess.run([self.program, *arguments, "--quiet"], cwd=self.folder, env=self.environment, check=True)

    def run(self, arguments):
        """Returns the exit code, below 0 for a signal, the errors, and the most MiB that were resident."""
        process = subprocess.Popen([self.program, *arguments], cwd=self.folder, env=self.environment,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        alarm = threading.Timer(PATIENCE_S, process.kill)
        alarm.start()
        errors = process.stderr.read()
        process.stderr.close()
        _, status, usage = os.wait4(process.pid, 0)
        alarm.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        return process.returncode, errors, usage.ru_maxrss / KIB_PER_MIB


def judge(code, errors, peak, limit, slack):
    if code == 2 or (code == 1 and "INVALID_ARGUMENT" in errors):
        return "unfit"
    if code not in (0, 1) or (code == 1 and "memory" not in errors):
        return "crash"
    return "above" if peak > limit + slack else "ok"


def try_render(trial, slack, report):
    """Renders with a small limit, and with those that follow from a refusal. Returns the name of each run."""
    volume, surfaces = write_volume(trial)
    effects = effect_flags(trial.random)
    size = size_flags(trial.random)
    if "--color-by" in surfaces and "--color-by" in effects:
        at = effects.index("--color-by")
        del effects[at:at + 2]
    output = "o.jpg" if "--quality" in effects else "o.png"
    render = ["render", volume, *surfaces, *size, *effects, "--renderer", "cpu", "--timeout",
              str(PATIENCE_S), "-o", output]
    limit = trial.random.choice([LEAST_MIB, LEAST_MIB, LEAST_MIB, 112, 136, 176])
    results = []

    def run(limit, name):
        arguments = [*render, "--memory-limit", f"{limit}MiB"]
        code, errors, peak = trial.run(arguments)
        result = judge(code, errors, peak, limit, slack)
        if name == "named" and code == 1 and result != "crash":
            result = "useless"
        verb = "drew" if code == 0 else "refused" if code in (1, 2) else f"ended with {code}"
        results.append((name, verb if code >= 0 else "ended", result))
        report(result, f"{name} limit {limit} MiB: {verb}, peak {peak:.1f} MiB: {result}",
               shlex.join(["isoscope", *arguments]), errors.strip()[-600:])
        return code, errors, result

    code, errors, result = run(limit, "first")
    named = NAMED.search(errors)
    if code == 1 and named is not None:
        enough = int(named.group(1))
        if enough > MOST_MIB:
            return results
        run(enough, "named")
        less = max(LEAST_MIB, int(enough * 0.9))
        if less not in (limit, enough):
            run(less, "less")
    elif code == 1 and result == "ok":
        results.append(("first", "refused", "crash"))
        report("crash", "it names no limit")
    return results


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=str(ROOT / "build/release/bin/isoscope"), help="the program isoscope")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="the first trial, to repeat one")
    parser.add_argument("--slack", type=float, default=0, help="MiB that a process may have above its limit")
    parser.add_argument("--verbose", action="store_true", help="print all runs")
    options = parser.parse_args()
    program = str(pathlib.Path(options.bin).resolve())
    counts = collections.Counter()
    for number in range(options.first, options.first + options.trials):
        with tempfile.TemporaryDirectory(prefix="isoscope-memory-") as folder:
            def report(result, *lines):
                if options.verbose or result not in GOOD:
                    print(f"trial {number}, " + "\n    ".join(line for line in lines if line), flush=True)

            trial = Trial(program, pathlib.Path(folder), random.Random(options.seed * 1_000_003 + number))
            for run in try_render(trial, options.slack, report):
                counts[run] += 1
    for (name, verb, result), count in sorted(counts.items()):
        print(f"{name:8}{verb:10}{result:10}{count:5}")
    bad = sum(count for (_, _, result), count in counts.items() if result not in GOOD)
    print(f"{options.trials} trials, seed {options.seed}: {sum(counts.values())} runs, {bad} not ok")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
