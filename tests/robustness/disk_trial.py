"""One command of isoscope that writes onto a disk without room: it must fail and say so, and leave nothing.

    disk_trial.py BINARIES FOLDER SEED tmpfs|limit

tmpfs: a file system of a few KiB, mounted here; needs a mount name space of its own. limit: a limit on the size of
files (EFBIG). With room it must do the same as ever: the dataset's bytes are compared with those in FOLDER/right.
Prints JSON: {"note": ..., "problems": [...]}. Exit code 77: nothing can be mounted.
"""

import hashlib
import json
import pathlib
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile


def digest(folder):
    """One digest of all files of a folder, names included."""
    sha = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            sha.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return sha.hexdigest()


def main():
    binaries, folder, seed, how = sys.argv[1:]
    folder, chance = pathlib.Path(folder), random.Random(int(seed))
    right = folder / "right" / "flow"
    room = 4096 * chance.randrange(1, 60)
    with tempfile.TemporaryDirectory() as disk:
        disk = pathlib.Path(disk)
        if how == "tmpfs":
            mounted = subprocess.run(
                ["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", disk], capture_output=True, text=True
            )
            if mounted.returncode != 0:
                print(mounted.stderr, file=sys.stderr)
                return 77
        try:
            result = trial(binaries, folder, right, disk, room, how, chance)
        finally:
            if how == "tmpfs":
                subprocess.run(["umount", disk], check=True)
    print(json.dumps(result))
    return 0


def trial(binaries, folder, right, disk, room, how, chance):
    shards = len(list(right.glob("shard-*")))
    command, output = chance.choice((
        (["partition", folder / "volume.nrrd", "--shards", shards], disk / "flow"),
        (["render", right, "--isovalue", 120, "--renderer", "cpu", "--width", 400], disk / "picture.png"),
        (["export", right, "--isovalue", 120], disk / "mesh.ply"),
    ))  # fmt: skip
    words = [str(word) for word in (f"{binaries}/isoscope", *command, "--output", output)]

    def run(is_limited):
        def limit():
            # Without the signal, a write beyond the limit fails as on a full disk.
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

        return subprocess.run(words, capture_output=True, text=True, timeout=60,
                              preexec_fn=limit if is_limited else None)  # fmt: skip

    problems = []
    done = run(how == "limit")
    left = sorted(str(path.relative_to(disk)) for path in disk.rglob("*"))
    note = f"{command[0]}, {room >> 10} KiB ({how}): exit code {done.returncode}"
    if done.returncode == 0:
        note += ", had room"
    elif done.returncode != 1 or len(done.stderr.strip()) < 20:
        problems.append(f"{note}, {done.stderr!r}")
    elif left:
        problems.append(f"{note}, and left {left}: {done.stderr.strip()}")
    if done.returncode == 0 and not output.exists():
        problems.append(f"{note}, but there is no {output.name}")
    if output.is_dir():
        shutil.rmtree(output)
    else:
        output.unlink(missing_ok=True)
    if how == "tmpfs":
        subprocess.run(["mount", "-o", "remount,size=64m", disk], check=True)
    again = run(False)
    if again.returncode != 0:
        problems.append(f"{note}; with room again it fails: {again.stderr}")
    elif command[0] == "partition" and digest(output) != digest(right):
        problems.append(f"{note}; with room again it writes another dataset")
    return {"note": note, "problems": problems}


if __name__ == "__main__":
    sys.exit(main())
