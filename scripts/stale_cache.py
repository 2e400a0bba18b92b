#!/usr/bin/env python3
"""Looks for stale results: a cached or resumed command must give what a fresh one gives, byte for byte.

Each trial draws a source of a random kind and random flags for it, and runs a command. Then it changes one flag or one
file, keeping the file's size and time, and runs the command again:

    cache     `isoscope render` with the cache that the first run has filled; now and then that run is killed
    resume    `isoscope partition --resume` after a first run that was killed at a random moment
    append    `isoscope partition --append --resume`, likewise

The second run is compared with one in an empty folder. A trial is

    equal     both give the same bytes, or both refuse
    stale     the second run gives other bytes than a fresh one, or succeeds where a fresh one refuses
    broken    the second run fails where a fresh one succeeds

Prints each stale or broken trial with its commands, and the numbers. Fails if there is one.

    scripts/stale_cache.py --bin build/release/bin/isoscope --trials 200
"""

import argparse
import collections
import ctypes
import ctypes.util
import hashlib
import os
import pathlib
import random
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
PATIENCE_S = 600
SMALL = ["--renderer", "cpu", "--threads", "1", "--width", "48", "--height", "48"]
DIMS = (24, 20, 18)


def samples(seed, dims=DIMS, kind="f"):
    """A field that depends on the seed everywhere, with a surface at 0 for floats, at 100 for bytes."""
    nx, ny, nz = dims
    out = bytearray()
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                value = (x - nx / 2) ** 2 + (y - ny / 2) ** 2 + (z - nz / 2) ** 2 - 30 - seed % 17
                value += ((x * 7 + y * 13 + z * 29 + seed * 31) % 11) / 11
                out += struct.pack("<f", value) if kind == "f" else bytes([max(0, min(255, int(value) + 100))])
    return bytes(out)


class Hdf5:
    """As much of the library as files with links need; None where it is not installed."""

    def __init__(self):
        name = ctypes.util.find_library("hdf5_serial") or "libhdf5_serial.so.103"
        self.lib = ctypes.CDLL(name)
        self.lib.H5open()
        for function in ("H5Fcreate", "H5Dcreate2", "H5Screate_simple", "H5Gcreate2"):
            getattr(self.lib, function).restype = ctypes.c_int64
        self.float_type = ctypes.c_int64.in_dll(self.lib, "H5T_IEEE_F32LE_g")

    def write(self, path, dataset, data, dims):
        lib = self.lib
        file = ctypes.c_int64(lib.H5Fcreate(str(path).encode(), 2, ctypes.c_int64(0), ctypes.c_int64(0)))
        sizes = (ctypes.c_uint64 * 3)(*reversed(dims))
        space = ctypes.c_int64(lib.H5Screate_simple(3, sizes, None))
        zero = ctypes.c_int64(0)
        made = ctypes.c_int64(lib.H5Dcreate2(file, dataset.encode(), self.float_type, space, zero, zero, zero))
        lib.H5Dwrite(made, self.float_type, zero, zero, zero, data)
        lib.H5Dclose(made)
        lib.H5Sclose(space)
        lib.H5Fclose(file)

    def link(self, path, name, to, dataset):
        zero = ctypes.c_int64(0)
        file = ctypes.c_int64(self.lib.H5Fcreate(str(path).encode(), 2, zero, zero))
        self.lib.H5Lcreate_external(to.encode(), dataset.encode(), file, name.encode(), zero, zero)
        self.lib.H5Fclose(file)


try:
    HDF5 = Hdf5()
except (OSError, AttributeError, ValueError):
    HDF5 = None


# ---- Sources: each writes files into a folder, and returns the argument of a command and the files that decide it. ----

def write_raw(folder, seed):
    (folder / "v.raw").write_bytes(samples(seed))
    return "v.raw", ["v.raw"]


def nifti_header(dims, steps, is_pair):
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 4 if steps > 1 else 3, *dims, steps, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 16, 32)
    struct.pack_into("<8f", header, 76, 1, 1, 1, 2, 0.5, 1, 1, 1)
    struct.pack_into("<f", header, 108, 0 if is_pair else 352)
    struct.pack_into("<h", header, 254, 1)
    struct.pack_into("<12f", header, 280, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2, 0)
    header[344:348] = b"ni1\0" if is_pair else b"n+1\0"
    return bytes(header)


def write_nifti(folder, seed):
    (folder / "v.nii").write_bytes(nifti_header(DIMS, 1, False) + samples(seed))
    return "v.nii", ["v.nii"]


def write_nifti_steps(folder, seed):
    (folder / "v.nii").write_bytes(nifti_header(DIMS, 3, False) + b"".join(samples(seed + i) for i in range(3)))
    return "v.nii", ["v.nii"]


def write_nifti_pair(folder, seed):
    (folder / "v.hdr").write_bytes(nifti_header(DIMS, 1, True))
    (folder / "v.img").write_bytes(samples(seed))
    return "v.img", ["v.hdr", "v.img"]


def write_nrrd(folder, seed):
    half = len(samples(seed)) // 2
    for name, part in (("a.bin", samples(seed)[:half]), ("b.bin", samples(seed)[half:])):
        (folder / name).write_bytes(part)
    (folder / "v.nhdr").write_text(
        "NRRD0004\ntype: float\ndimension: 3\nsizes: %d %d %d\nendian: little\nencoding: raw\n"
        "spacings: 1 1 2\ndata file: LIST\na.bin\nb.bin\n" % DIMS)
    return "v.nhdr", ["v.nhdr", "a.bin", "b.bin"]


def write_meta(folder, seed):
    (folder / "v.bin").write_bytes(samples(seed))
    (folder / "v.mhd").write_text(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = %d %d %d\nElementSpacing = 1 1 2\n"
        "ElementType = MET_FLOAT\nElementDataFile = v.bin\n" % DIMS)
    return "v.mhd", ["v.mhd", "v.bin"]


def vti(arrays):
    nx, ny, nz = (size - 1 for size in DIMS)
    tags, data = "", b""
    for name, values, components in arrays:
        tags += (f'<DataArray type="Float32" Name="{name}" NumberOfComponents="{components}" format="appended" '
                 f'offset="{len(data)}"/>')
        data += struct.pack("<Q", len(values)) + values
    extent = f"0 {nx} 0 {ny} 0 {nz}"
    head = ('<?xml version="1.0"?><VTKFile type="ImageData" byte_order="LittleEndian" header_type="UInt64">'
            f'<ImageData WholeExtent="{extent}" Origin="0 0 0" Spacing="1 1 1"><Piece Extent="{extent}"><PointData>'
            f'{tags}</PointData></Piece></ImageData><AppendedData encoding="raw">_')
    return head.encode() + data + b"</AppendedData></VTKFile>"


def write_vti(folder, seed):
    (folder / "v.vti").write_bytes(vti([("p", samples(seed), 1), ("t:a", samples(seed + 5), 1)]))
    return "v.vti", ["v.vti"]


def write_pvd(folder, seed):
    names = []
    for step in range(4):
        names.append(f"run_{step}.vti")
        (folder / names[-1]).write_bytes(vti([("p", samples(seed + step), 1), ("t:a", samples(seed + 5 + step), 1)]))
    tags = "".join(f'<DataSet timestep="{i}" file="{name}"/>' for i, name in enumerate(names))
    (folder / "run.pvd").write_text(f'<VTKFile type="Collection"><Collection>{tags}</Collection></VTKFile>')
    return "run.pvd", names


def write_hdf5_link(folder, seed):
    HDF5.write(folder / "samples.h5", "/d", samples(seed), DIMS)
    HDF5.link(folder / "middle.h5", "/on", "samples.h5", "/d")
    HDF5.link(folder / "v.h5", "/d", "middle.h5", "/on")
    return "v.h5:/d", ["samples.h5", "middle.h5", "v.h5"]


def write_labels(folder, seed):
    (folder / "v.nii").write_bytes(nifti_header(DIMS, 1, False) + samples(seed))
    return "v.nii", ["v.nii", "names.txt"]


def write_linked_folder(folder, seed):
    for name in ("one", "two"):
        (folder / name).mkdir(exist_ok=True)
    (folder / "one" / "v.nii").write_bytes(nifti_header(DIMS, 1, False) + samples(seed))
    (folder / "two" / "v.nii").write_bytes(nifti_header(DIMS, 1, False) + samples(seed + 3))
    for name in ("one", "two"):
        os.utime(folder / name / "v.nii", (1e9, 1e9))
    if not (folder / "run").is_symlink():
        (folder / "run").symlink_to("one")
    return "run/v.nii", ["one/v.nii"]


SINGLE = [write_raw, write_nifti, write_nifti_pair, write_nrrd, write_meta, write_labels, write_linked_folder]
SEVERAL = [write_pvd, write_pvd, write_nifti_steps, write_vti]
if HDF5 is not None:
    SINGLE += [write_hdf5_link]


# ---- Flags of a source: values by flag. ---------------------------------------------------------------------------

def flag_values(kind):
    flags = {
        "--crop": ["0:20,0:20,0:18", "1:21,0:20,0:18", "2:22,0:20,0:18"],
        "--stride": ["1", "2"],
        "--fill": ["0", "-30.5", "7"],
        "--spacing": ["1,1,1", "1,1,2", "2,1,1"],
        "--origin": ["0,0,0", "5,0,0"],
        "--direction": ["1,0,0,0,1,0,0,0,1", "0,-1,0,1,0,0,0,0,1"],
        "--ignore-shear": [None],
        "--resample": [None],
    }
    if kind is write_raw:
        flags["--header-bytes"] = ["0", "4"]
        flags["--endian"] = ["little", "big"]
        flags["--dims"] = ["24,20,17", "20,24,17"]
    if kind is write_labels:
        flags["--label-names"] = ["names.txt", "others.txt"]
    return flags


def fixed_flags(kind):
    return {"--dims": "24,20,17", "--type": "float32"} if kind is write_raw else {}


def render_values(kind):
    """Flags of `render` that choose volumes."""
    if kind in (write_pvd, write_nifti_steps):
        choice = {"--step": ["0", "1", "2", "last", "first"]}
        if kind is write_pvd:
            choice["--time"] = ["0", "1.4", "3"]
    else:
        choice = {}
    if kind in (write_pvd, write_vti):
        choice["--field"] = ["p", "t:a"]
        choice["--color-by"] = ["t:a", "p:viridis", "t:a:turbo:-5,5"]
    return choice


def draw_flags(random_, values, most):
    chosen = {}
    for flag in random_.sample(sorted(values), random_.randint(0, min(most, len(values)))):
        chosen[flag] = random_.choice(values[flag])
    if "--time" in chosen:
        chosen.pop("--step", None)
    return chosen


def change_flag(random_, values, flags):
    """Adds a flag, takes one out, or gives one another value."""
    changed = dict(flags)
    flag = random_.choice(sorted(values))
    others = [value for value in values[flag] if flag not in flags or value != flags[flag]]
    if flag in flags and (not others or random_.random() < 0.3):
        del changed[flag]
    else:
        changed[flag] = random_.choice(others)
    if flag == "--time":
        changed.pop("--step", None)
    elif flag == "--step":
        changed.pop("--time", None)
    return changed


def words(flags):
    out = []
    for flag, value in flags.items():
        out += [flag] if value is None else [flag, value]
    return out


# ---- Trials. ------------------------------------------------------------------------------------------------------

class Trial:
    def __init__(self, program, folder, random_):
        self.program, self.folder, self.random = program, folder, random_
        self.data = folder / "data"
        self.data.mkdir()
        self.log = []

    def run(self, arguments, cache, kill_after=None):
        """The exit code; None if it was killed."""
        environment = dict(os.environ, XDG_CACHE_HOME=str(self.folder / cache))
        environment.pop("ISOSCOPE_CACHE_LIMIT", None)
        self.log.append(shlex.join(["isoscope", *arguments]) + (f"   # killed after {kill_after:.3f} s" if kill_after
                                                                else ""))
        process = subprocess.Popen([self.program, *arguments], cwd=self.data, env=environment,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            _, errors = process.communicate(timeout=kill_after or PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            if kill_after is None:
                raise
            return None
        if process.returncode not in (0, 1, 2):
            raise AssertionError(f"exit code {process.returncode}: {errors}\n" + "\n".join(self.log))
        self.errors = errors
        return process.returncode

    def time_of(self, arguments, cache):
        start = time.monotonic()
        self.run(arguments, cache)
        return time.monotonic() - start

    def write(self, kind, seed):
        path, files = kind(self.data, seed)
        if kind is write_labels:
            for name in ("names.txt", "others.txt"):
                (self.data / name).write_text(f"1,{name[0]}{seed % 7}\n2,two\n")
        return path, files

    def change_file(self, kind, files, seed):
        """Gives one file other bytes of the same size, with its time; or turns a link."""
        if kind is write_linked_folder and self.random.random() < 0.7:
            (self.data / "run").unlink()
            (self.data / "run").symlink_to("two")
            self.log.append("# run -> two")
            return
        name = self.random.choice(files)
        path = self.data / name
        before = {other: (self.data / other).read_bytes() for other in files}
        status = path.stat()
        self.write(kind, seed + 1)
        for other, data in before.items():
            if other != name:
                (self.data / other).write_bytes(data)
        if path.read_bytes() == before[name]:  # a header, which does not depend on the seed
            data = bytearray(before[name])
            at = data.find(b"2")
            if at >= 0 and name.endswith((".nhdr", ".mhd")):
                data[at:at + 1] = b"3" if b"spacing" not in data.lower() else data[at:at + 1]
            path.write_bytes(bytes(data))
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
        self.log.append(f"# {name} has other bytes")


def digest_of(path):
    if path.is_file():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    digests = []
    for folder, _, names in os.walk(path):
        for name in sorted(names):
            file = pathlib.Path(folder, name)
            digests.append((str(file.relative_to(path)), hashlib.sha256(file.read_bytes()).hexdigest()))
    return sorted(digests)


def verdict(code, out, fresh_code, fresh):
    if (code == 0) != (fresh_code == 0):
        return "stale" if code == 0 else "broken"
    return "equal" if code != 0 or digest_of(out) == digest_of(fresh) else "stale"


def two_commands(trial, kind, with_choice):
    """The path, its files, and flags before and after a change; the change of a file is made by the caller."""
    seed = trial.random.randint(0, 10**6)
    path, files = trial.write(kind, seed)
    values = flag_values(kind)
    choice = render_values(kind) if with_choice else {}
    first = {**fixed_flags(kind), **draw_flags(trial.random, values, 2)}
    first_choice = draw_flags(trial.random, choice, 2)
    changes_file = trial.random.random() < 0.35
    second, second_choice = dict(first), dict(first_choice)
    if not changes_file:
        if choice and trial.random.random() < 0.4:
            second_choice = change_flag(trial.random, choice, first_choice)
        else:
            second = change_flag(trial.random, values, first)
    second = {**fixed_flags(kind), **second}
    return path, files, seed, words(first) + words(first_choice), words(second) + words(second_choice), changes_file


def try_cache(trial):
    kind = trial.random.choice(SINGLE + SEVERAL)
    path, files, seed, first, second, changes_file = two_commands(trial, kind, with_choice=True)
    render = ["render", path, *SMALL, "--isovalue", "0"]
    if trial.random.random() < 0.3:
        trial.run([*render, *first, "--output", "../a.png"], "cache", trial.random.uniform(0.02, 0.4))
    else:
        trial.run([*render, *first, "--output", "../a.png"], "cache")
    if changes_file:
        trial.change_file(kind, files, seed)
    code = trial.run([*render, *second, "--output", "../b.png"], "cache")
    fresh_code = trial.run([*render, *second, "--output", "../c.png"], "fresh")
    return verdict(code, trial.folder / "b.png", fresh_code, trial.folder / "c.png")


def kill_after(trial, duration):
    """Most often while volumes are written, which is in the second half."""
    return max(0.01, duration * trial.random.uniform(0.3, 1.0))


def try_resume(trial):
    kind = trial.random.choice([write_pvd, write_pvd, write_nifti_steps])
    path, files, seed, first, second, changes_file = two_commands(trial, kind, with_choice=False)
    partition = ["partition", path, "--block-cells", "4", "--shards", trial.random.choice(["1", "2"]), "--quiet"]
    (trial.folder / "out").mkdir()
    duration = trial.time_of([*partition, *first, "--output", "../out/run"], "cache")
    shutil.rmtree(trial.folder / "out" / "run", ignore_errors=True)
    trial.run([*partition, *first, "--output", "../out/run"], "cache", kill_after(trial, duration))
    shutil.rmtree(trial.folder / "out" / "run", ignore_errors=True)  # it was done
    if changes_file:
        trial.change_file(kind, files, seed)
    (trial.folder / "fresh").mkdir()
    code = trial.run([*partition, *second, "--output", "../out/run", "--resume"], "cache")
    fresh_code = trial.run([*partition, *second, "--output", "../fresh/run"], "cache")
    return verdict(code, trial.folder / "out" / "run", fresh_code, trial.folder / "fresh" / "run")


def try_append(trial):
    kind = write_pvd
    path, files, seed, first, second, changes_file = two_commands(trial, kind, with_choice=False)
    # Grids of all steps must be equal, so only what keeps them is changed.
    keeps = [(flag, value) for flag, value in zip(second, second[1:]) if flag == "--fill"]
    base = ["partition", path, "--block-cells", "4", "--quiet", "--fill", "1e30"]
    (trial.folder / "out").mkdir()
    (trial.folder / "fresh").mkdir()
    for folder in ("out", "fresh"):
        trial.run([*base, "--step", "0", "--output", f"../{folder}/run"], "cache")
    fills = [trial.random.choice(["1e30", "0", "7"]), trial.random.choice(["1e30", "0", "7"])]
    if keeps:
        fills[1] = keeps[0][1]
    append = ["partition", path, "--step", "1:3", "--quiet", "--append"]
    shutil.copytree(trial.folder / "out", trial.folder / "timed")
    duration = trial.time_of([*append, "../timed/run", "--fill", fills[0]], "cache")
    if trial.run([*append, "../out/run", "--fill", fills[0]], "cache", kill_after(trial, duration)) is not None:
        shutil.rmtree(trial.folder / "out" / "run")
        shutil.copytree(trial.folder / "fresh" / "run", trial.folder / "out" / "run")
    # A process that was killed once all was written has appended it: then nothing is to be resumed.
    if not (trial.folder / "out" / "run" / "append.partial").is_dir() or (
            trial.folder / "out" / "run" / "append.partial" / "manifest.json").exists():
        return "equal"
    if changes_file:
        trial.change_file(kind, files[1:], seed)
    code = trial.run([*append, "../out/run", "--fill", fills[1], "--resume"], "cache")
    fresh_code = trial.run([*append, "../fresh/run", "--fill", fills[1]], "cache")
    return verdict(code, trial.folder / "out" / "run", fresh_code, trial.folder / "fresh" / "run")


KINDS = {"cache": try_cache, "resume": try_resume, "append": try_append}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=str(ROOT / "build/release/bin/isoscope"), help="the program isoscope")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="the first trial, to repeat one")
    parser.add_argument("--kind", choices=sorted(KINDS), help="only trials of this kind")
    parser.add_argument("--verbose", action="store_true", help="print the commands of all trials")
    options = parser.parse_args()
    program = str(pathlib.Path(options.bin).resolve())
    counts = collections.Counter()
    for number in range(options.first, options.first + options.trials):
        random_ = random.Random(options.seed * 1_000_003 + number)
        name = options.kind or random_.choice(["cache", "cache", "resume", "append"])
        with tempfile.TemporaryDirectory(prefix="isoscope-stale-") as folder:
            trial = Trial(program, pathlib.Path(folder), random_)
            result = KINDS[name](trial)
        counts[name, result] += 1
        if options.verbose or result != "equal":
            print(f"trial {number}, {name}: {result}", *trial.log, sep="\n    ", flush=True)
    for name in KINDS:
        print(name.ljust(8), *(f"{counts[name, result]} {result}" for result in ("equal", "stale", "broken")), sep="  ")
    bad = sum(count for (_, result), count in counts.items() if result != "equal")
    print(f"{options.trials} trials, seed {options.seed}: {sum(counts[name, 'stale'] for name in KINDS)} stale, "
          f"{sum(counts[name, 'broken'] for name in KINDS)} broken")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
