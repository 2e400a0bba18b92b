#!/usr/bin/env python3
"""Tells what isoscope makes of every file below a folder: runs `info`, and draws what opens once.

For each file, for each series of a folder of DICOM files, and for each Zarr store and each array of it, it runs `isoscope info FILE --json`, then
the command that info suggests, at 128 x 128 pixels. A file counts as

    opened    info and the picture succeed
    refused   exit 1 with a sentence, by info or by the picture
    not read  refused, and named as something that is no volume, or of a format that is not read
    crashed   ended by a signal, or with another exit code
    hung      not done after --timeout
    no file of volumes
              refused as of an unknown kind, and its ending is not that of a volume

Prints a table by ending and each refusal; --json writes all. Fails if something crashed or hung, or with --compare
differs.

--compare reads what opened with another program's reader, too (scripts/survey_readers.py): the size, the world
positions of the first and the last sample where that reader tells them, and the least and the greatest of 2 x 2 x 2
samples at five places.

    scripts/survey.py /usr/share --bin build/release/bin/isoscope
    scripts/survey.py COLLECTION --compare --json survey.json --memory-limit 128MiB
"""

import argparse
import collections
import contextlib
import json
import os
import pathlib
import resource
import shlex
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
UNKNOWN_KIND = "unknown kind of file"
NOT_READ = ("which is not read:", "not the file itself", "an empty file:")
MAX_MESSAGE = 300


def run(command, folder, timeout):
    """Runs a command with a cache of its own. Returns (exit code or None, output, errors, seconds, peak MiB)."""
    environment = dict(os.environ, XDG_CACHE_HOME=folder, TMPDIR=folder)
    out_path, err_path = pathlib.Path(folder, "out"), pathlib.Path(folder, "err")
    start = time.monotonic()
    peak = 0
    with open(out_path, "wb") as out, open(err_path, "wb") as err:
        process = subprocess.Popen(command, stdout=out, stderr=err, stdin=subprocess.DEVNULL, env=environment,
                                   start_new_session=True)
        is_late = False
        while True:
            # Not of rusage, which counts what this process had when it forked.
            peak = max(peak, peak_kib(process.pid))
            pid, status = os.waitpid(process.pid, os.WNOHANG)
            if pid:
                break
            if time.monotonic() - start > timeout and not is_late:
                is_late = True
                os.killpg(process.pid, signal.SIGKILL)
            time.sleep(0.005)
    process.returncode = os.waitstatus_to_exitcode(status)
    code = None if is_late else process.returncode
    text = [path.read_text(errors="replace") for path in (out_path, err_path)]
    return code, text[0], text[1].strip(), time.monotonic() - start, peak / 1024


def peak_kib(pid):
    """The most memory that a process has had; 0 once it has ended."""
    try:
        for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1])
    except OSError:
        pass
    return 0


def ending_of(path):
    """".nii.gz" of "a.nii.gz"; "" without one."""
    suffixes = path.suffixes
    if len(suffixes) > 1 and suffixes[-1].lower() in (".gz", ".bz2"):
        return "".join(suffixes[-2:]).lower()
    return path.suffix.lower()


def is_dicom(path):
    with open(path, "rb") as file:
        return file.read(132)[128:] == b"DICM"


ZARR_ARRAYS = (".zarray", "zarr.json")


def is_zarr(folder):
    return any((folder / name).is_file() for name in (".zgroup", ".zmetadata", *ZARR_ARRAYS))


def arrays_of(store):
    """Yields the folders of the arrays of a Zarr store, other than itself."""
    for folder, folders, names in os.walk(store):
        folders.sort()
        path = pathlib.Path(folder)
        is_array = ".zarray" in names
        if "zarr.json" in names:
            with contextlib.suppress(ValueError, OSError, AttributeError):
                is_array = json.loads((path / "zarr.json").read_text()).get("node_type") == "array"
        if is_array:
            folders.clear()
            if path != store:
                yield path


def sources_below(tree):
    """Yields (path, ending): files; in place of DICOM files their folders, of those of a Zarr store the store and its
    arrays."""
    for folder, folders, names in os.walk(tree):
        folders.sort()
        if is_zarr(pathlib.Path(folder)):
            folders.clear()
            yield pathlib.Path(folder), "Zarr"
            for array in arrays_of(pathlib.Path(folder)):
                yield array, "Zarr array"
            continue
        has_dicom = False
        for name in sorted(names):
            path = pathlib.Path(folder, name)
            try:
                if path.is_symlink() or not path.is_file() or path.stat().st_size == 0:
                    continue
                if not is_dicom(path):
                    yield path, ending_of(path)
                elif not has_dicom:
                    has_dicom = True
                    yield pathlib.Path(folder), "DICOM"
            except OSError as error:
                print(f"{path}: {error}", file=sys.stderr)


def outcome_of(code, errors):
    if code is None:
        return "hung"
    if code == 0:
        return "opened"
    # Warnings may come before.
    if code != 1 or not any(line.startswith("isoscope: ") for line in errors.splitlines()):
        return "crashed"
    return "not read" if any(words in errors for words in NOT_READ) else "refused"


def survey(path, ending, arguments, series=""):
    """Returns what info and a picture make of one source; of several series, of each."""
    limits = ["--memory-limit", arguments.memory_limit]
    choice = ["--series", series] if series else []
    with tempfile.TemporaryDirectory(prefix="isoscope-survey-") as folder:
        code, output, errors, seconds, peak = run([arguments.bin, "info", str(path), "--json"] + choice, folder,
                                                  arguments.timeout)
        result = {"path": str(path), "ending": ending, "series": series, "step": "info", "outcome": outcome_of(code, errors),
                  "message": errors[:MAX_MESSAGE], "seconds": seconds, "peak_mib": peak}
        if result["outcome"] != "opened":
            return [result]
        described = json.loads(output)
        if "series" in described:
            # One without a UID can't be chosen.
            return [one for listed in described["series"] if listed["uid"]
                    for one in survey(path, ending, arguments, listed["uid"])]
        if arguments.compare:
            result["compared"] = compare(str(path), choice, described["volume"], folder, arguments)
        if arguments.no_render:
            return [result]
        commands = [shlex.split(command) for command in described["volume"]["commands"]]
        dataset = os.path.join(folder, "dataset")
        for command in commands:
            # info writes DIR and VALUE where it leaves the choice to people.
            words = [dataset if word == "DIR" else word for word in command[1:]]
            if "VALUE" in words:
                words[words.index("VALUE")] = middle_of(words, choice, dataset, folder, arguments)
            words += limits
            if words[0] == "render":
                words += ["--renderer", "cpu", "--width", "128", "--height", "128", "--output",
                          os.path.join(folder, "picture.png")]
            code, _, errors, more, peak = run([arguments.bin] + words, folder, arguments.timeout)
            result["seconds"] += more
            result.update(step=words[0], outcome=outcome_of(code, errors), message=errors[:MAX_MESSAGE],
                          peak_mib=max(result["peak_mib"], peak))
            if result["outcome"] != "opened":
                break
        return [result]


def places_of(dims):
    """Five boxes of 2 x 2 x 2 samples: the first, the last, the middle, and two of no symmetry."""
    last = [size - 2 for size in dims]
    middle = [size // 2 for size in last]
    return [[0, 0, 0], last, middle, [last[0], 0, middle[2]], [last[0] // 3, middle[1], last[2] * 2 // 3]]


def compare(path, choice, volume, folder, arguments):
    """Returns "equal", "none" (no other reader takes it), or a sentence on the first difference."""
    import survey_readers  # needs numpy
    other = survey_readers.read(path, volume, choice[-1] if choice else None)
    if other is None:
        return "none"
    dims = volume["sample_dims"]
    if list(other.samples.shape[::-1]) != dims:
        return f"size {dims}, expected {list(other.samples.shape[::-1])}"
    for corner in ([0, 0, 0], [size - 1 for size in dims]):
        expected = other.position_of(corner)
        if expected is None:
            break
        found = [volume["origin"][row] + sum(volume["direction"][axis][row] * volume["spacing"][axis] * corner[axis]
                                             for axis in range(3)) for row in range(3)]
        extent = max(abs(number) for number in expected + [sum(volume["spacing"])])
        if any(abs(a - b) > 1e-5 * extent for a, b in zip(found, expected)):
            return f"sample {corner} at {found}, expected {expected}"
    # The ranges of several steps are those of all.
    for x, y, z in places_of(dims) if len(volume["time_steps"]) <= 1 else []:
        crop = f"{x}:{x + 2},{y}:{y + 2},{z}:{z + 2}"
        code, output, errors, _, _ = run([arguments.bin, "info", path, "--json", "--values", "--crop", crop] + choice,
                                         folder, arguments.timeout)
        if code != 0:
            return f"--crop {crop}: {errors[:MAX_MESSAGE]}"
        found = first_range(json.loads(output)["volume"])
        expected = survey_readers.range_of(other.samples[z:z + 2, y:y + 2, x:x + 2])
        if (found is None) != (expected is None) or (found is not None and any(
                abs(a - b) > 1e-6 * max(abs(b), abs(expected[1] - expected[0])) for a, b in zip(found, expected))):
            return f"samples {crop} in {found}, expected {expected}"
    return "equal"


def first_range(volume):
    """The range of the first component of the first field; of several steps only if one was read."""
    if "value_range" in volume:
        return volume["value_range"]
    return volume["fields"][0]["value_ranges"][0]


def middle_of(words, choice, dataset, folder, arguments):
    """Returns the middle of the values that a command draws, as a word; "VALUE" if they are not known."""
    _, output, _, _, _ = run([arguments.bin, "info", words[1], "--json"]
                             + ([] if words[1] == dataset else ["--values"] + choice), folder, arguments.timeout)
    described = json.loads(output or "{}")
    volume = described.get("volume") or described.get("datasets", [{}])[0]
    fields = volume.get("fields", [])
    # Without --field, the first one is drawn.
    field = words[words.index("--field") + 1] if "--field" in words else fields[0]["name"] if fields else None
    for one in fields:
        if one["name"] == field and isinstance(one["components"][-1], dict):
            volume = one["components"][-1]
    low_high = volume.get("value_range")
    return repr(sum(low_high) / 2) if low_high else "VALUE"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tree", help="the folder")
    parser.add_argument("--bin", default=str(ROOT / "build/release/bin/isoscope"), help="the program")
    parser.add_argument("--json", help="writes all results to this file")
    parser.add_argument("--timeout", type=float, default=120, help="seconds a command (default: 120)")
    parser.add_argument("--memory-limit", default="256MiB", help="of partitioning and drawing (default: 256MiB)")
    parser.add_argument("--compare", action="store_true", help="compares with other programs' readers")
    parser.add_argument("--no-render", action="store_true", help="runs info alone")
    arguments = parser.parse_args()
    if not os.path.isdir(arguments.tree):
        parser.error(f"{arguments.tree} is not a folder")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    results = []
    for path, ending in sources_below(arguments.tree):
        before = len(results)
        results += survey(path, ending, arguments)
        if len(results) // 100 > before // 100:
            print(f"{len(results)} files, now {path}", file=sys.stderr)
    known = {r["ending"] for r in results if UNKNOWN_KIND not in r["message"] and r["outcome"] != "not read"}
    for result in results:
        if result["outcome"] == "refused" and result["ending"] not in known and UNKNOWN_KIND in result["message"]:
            result["outcome"] = "no file of volumes"
    by_ending = collections.defaultdict(collections.Counter)
    for result in results:
        if result["outcome"] != "no file of volumes":
            by_ending[result["ending"] or "(none)"][result["outcome"]] += 1
    others = sum(r["outcome"] == "no file of volumes" for r in results)
    columns = ("opened", "refused", "not read", "crashed", "hung") + (
        ("equal", "differ") if arguments.compare else ())
    for result in results:
        compared = result.get("compared", "none")
        if result["outcome"] != "no file of volumes" and compared != "none":
            by_ending[result["ending"] or "(none)"]["equal" if compared == "equal" else "differ"] += 1
    print(f"{'ending':14}" + "".join(f"{column:>9}" for column in columns) + f"{'s':>9}{'MiB':>8}")
    for ending, counts in sorted(by_ending.items()):
        of_ending = [r for r in results if (r["ending"] or "(none)") == ending]
        print(f"{ending:14}" + "".join(f"{counts[column]:9}" for column in columns)
              + f"{max(r['seconds'] for r in of_ending):9.1f}{max(r['peak_mib'] for r in of_ending):8.0f}")
    print(f"{others} other files, of endings that no volume has. Seconds and MiB are the most of a file.")
    for result in results:
        if result["outcome"] in ("refused", "not read", "crashed", "hung"):
            print(f"{result['outcome']} by {result['step']}: {result['path']}: {result['message']}")
        if result.get("compared", "none") not in ("none", "equal"):
            print(f"differs: {result['path']}: {result['compared']}")
    if arguments.json:
        pathlib.Path(arguments.json).write_text(json.dumps(results, indent=1))
    differs = any(r.get("compared", "none") not in ("none", "equal") for r in results)
    return 1 if differs or any(r["outcome"] in ("crashed", "hung") for r in results) else 0


if __name__ == "__main__":
    sys.exit(main())
