#!/usr/bin/env python3
"""The image of the Dockerfile's target cli-cpu, without a container engine: its steps run in a bare Debian that is
thrown away. Its size, and that `isoscope view` in it prints an address that works from outside.

    image_test.py PROGRAMS [TARGET]

PROGRAMS is the folder of the programs, which the stage `build` would make. Another TARGET is made and measured, too.
Exits with 77 where that can't be done: needs root, mmdebstrap and a mirror of Debian.
"""

import atexit
import gzip
import json
import os
import pathlib
import re
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))
import skips  # noqa: E402

PROGRAMS = pathlib.Path(sys.argv[1]).resolve()
TARGET = sys.argv[2] if len(sys.argv) > 2 else "cli-cpu"
MAX_BYTES = 250_000_000
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
# Files that debian:bookworm-slim omits, now and when packages are installed.
SLIM = ["path-exclude=/usr/share/doc/*", "path-include=/usr/share/doc/*/copyright", "path-exclude=/usr/share/man/*",
        "path-exclude=/usr/share/info/*", "path-exclude=/usr/share/locale/*", "path-exclude=/usr/share/lintian/*"]
# Outside of the image: uses another address of the machine than the loopback one. Prints the response.
VISIT = """
import json, sys, urllib.request
address = sys.argv[1]
token, dataset = (address.split(f"{name}=")[1].split("&")[0] for name in ("token", "dataset"))
page = urllib.request.urlopen("http://127.0.0.2:8080/").status
url = f"http://127.0.0.2:8080/v1/datasets/{dataset}/render?isovalue=20&width=64&height=64&token={token}"
picture = urllib.request.urlopen(url).read()
print(json.dumps({"page": page, "picture": picture[:4].hex()}))
"""


def must(*command, **options):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=600, **options)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def size(*folders):
    """Returns the size of files, as engines count it, and not that of their disk blocks."""
    return sum(int(line.split()[0]) for line in must("du", "--bytes", "-sx", *folders).splitlines())


def instructions(stage):
    """(NAME, REST) of the stage and of those that it is made from, base first."""
    text = re.sub(r"^#.*\n", "", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE).replace("\\\n", "")
    stages, current = {}, []
    for line in filter(None, map(str.strip, text.splitlines())):
        name, rest = line.split(None, 1)
        if name == "FROM":
            base, _, own = rest.split()
            current = stages[own] = [("FROM", base)]
        else:
            current.append((name, rest))
    steps = stages[stage]
    while steps[0][1] in stages:
        steps = stages[steps[0][1]] + steps[1:]
    return steps[1:]


class Image:
    """A root, and what a container gets besides."""

    def __init__(self, root):
        self.root = root
        self.environment = {"PATH": PATH}
        self.user, self.folder, self.entrypoint, self.ports = "0", "/", [], []

    def command(self, *words):
        """A command line that runs in it, as its user."""
        return ["chroot", f"--userspec={self.user}", str(self.root), "env", "-i", f"--chdir={self.folder}",
                *(f"{k}={v}" for k, v in self.environment.items()), *words]  # fmt: skip

    def step(self, name, rest):
        if name == "RUN":
            mounts = f"mount -t proc proc {self.root}/proc && mount --rbind /dev {self.root}/dev && "
            must("unshare", "--mount", "sh", "-c", mounts + shlex.join(self.command("/bin/sh", "-c", rest)))
        elif name == "COPY":
            *sources, target = (word for word in rest.split() if not word.startswith("--"))
            folder = self.root / target.lstrip("/")
            folder.mkdir(parents=True, exist_ok=True)
            for source in map(pathlib.Path, sources):
                if "--from=build" in rest:
                    built = PROGRAMS.parent / source.relative_to("/src/build/release")
                    for file in built.iterdir() if built.is_dir() else [built]:
                        must("strip", "-o", folder / file.name, file)
                else:
                    shutil.copy(ROOT / source, folder)
        elif name == "ENV":
            self.environment.update(word.split("=", 1) for word in shlex.split(rest))
        elif name == "USER":
            entry = must("chroot", self.root, "getent", "passwd", rest).split(":")
            self.user, self.environment["HOME"] = f"{entry[2]}:{entry[3]}", entry[5]
        elif name == "WORKDIR":
            self.folder = rest
            (self.root / rest.lstrip("/")).mkdir(exist_ok=True)
        elif name == "ENTRYPOINT":
            self.entrypoint = json.loads(rest)
        elif name == "EXPOSE":
            self.ports.append(int(rest))
        else:
            assert name in ("ARG", "LABEL", "HEALTHCHECK", "CMD"), name


def ball(side):
    """A NIfTI-1 file of the distance from the middle, uint8."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, side, side, side, 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 2, 8)
    struct.pack_into("<8f", header, 76, 1, 1, 1, 1, 1, 1, 1, 1)
    struct.pack_into("<2f", header, 108, 352, 1)
    header[344:348] = b"n+1\0"
    axis = [(i - side // 2) ** 2 for i in range(side)]
    return bytes(header) + bytes(int((x + y + z) ** 0.5) for z in axis for y in axis for x in axis)


def make():
    if os.geteuid() != 0:
        skips.skip_program("packages", "only root can install packages in another root")
    if subprocess.run(["unshare", "--mount", "--net", "true"], capture_output=True).returncode != 0:
        skips.skip_program("packages", "no namespaces can be made here")
    work = pathlib.Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, work, ignore_errors=True)
    work.chmod(0o755)
    image = Image(work / "root")
    slim = [f"--dpkgopt={option}" for option in SLIM]
    maker = ROOT / "tests" / "deploy" / "empty_root.sh"
    done = subprocess.run([str(maker), str(image.root), *slim], capture_output=True, text=True)
    if done.returncode != 0:
        skips.skip_program("packages", "no root can be made: " + done.stderr.strip().splitlines()[-1])
    must("rm", "-rf", *image.root.glob("var/lib/apt/lists/*"), *image.root.glob("var/cache/apt/*"))
    image.base_bytes = size(image.root)
    for step in instructions(TARGET):
        image.step(*step)
    image.bytes = size(image.root)
    return image


def largest(image, count=15):
    """Installed packages and folders by size."""
    packages = must(*Image.command(image, "dpkg-query", "--show", "--showformat=${Installed-Size} ${Package}\\n"))
    lines = sorted((int(line.split()[0]) * 1024, line.split()[1]) for line in packages.splitlines())
    return [f"{bytes / 1e6:7.1f} MB {name}" for bytes, name in lines[: -count - 1 : -1]]


class ImageTest(unittest.TestCase):
    def test_size(self):
        whole, base = IMAGE.bytes / 1e6, IMAGE.base_bytes / 1e6
        print(f"{TARGET}: {whole:.0f} MB, of which the base {base:.0f} MB; largest packages:")
        print("\n".join(largest(IMAGE)), flush=True)
        if TARGET == "cli-cpu":
            self.assertLess(IMAGE.bytes, MAX_BYTES)
            self.assertEqual(list(IMAGE.root.glob("usr/lib/*/*libLLVM*")), [], "Mesa is in another image")

    def run_in(self, *words):
        return must(*IMAGE.command(*IMAGE.entrypoint, *words))

    def test_volumes_are_read_and_drawn(self):
        data = IMAGE.root / "data"
        data.chmod(0o777)
        self.run_in("generate", "shells", "--dims", "48,48,48", "--type", "uint8", "--output", "shells.nrrd")
        self.assertIn("48", self.run_in("info", "shells.nrrd"))
        volume = ("shells.nrrd", "--isovalue", "127.5", "--output")
        for command, name, *flags in (("render", "p.png", "--caption", "at {isovalue}"), ("render", "p.jpg"),
                                      ("export", "p.glb")):  # fmt: skip
            self.run_in(command, *volume, name, *flags)
            self.assertGreater((data / name).stat().st_size, 1000)

    def test_view_prints_an_address_that_works_from_outside(self):
        (IMAGE.root / "data" / "ball.nii.gz").write_bytes(gzip.compress(ball(48)))
        self.assertEqual(IMAGE.ports, [8080])
        view = shlex.join(IMAGE.command(*IMAGE.entrypoint, "view", "/data/ball.nii.gz"))
        # The engine's own process 1, whose end ends all.
        script = f"""
            ip link set lo up
            {view} >{IMAGE.root}/tmp/address &
            for i in $(seq 300); do grep -q . {IMAGE.root}/tmp/address && break; sleep 0.1; done
            cat {IMAGE.root}/tmp/address
            python3 -c {shlex.quote(VISIT)} "$(cat {IMAGE.root}/tmp/address)"
            kill %1
            wait %1 && echo ended
        """
        lines = must("unshare", "--net", "--pid", "--fork", "--kill-child", "bash", "-c", script).splitlines()
        self.assertRegex(lines[0], r"^http://localhost:8080/\?token=\w{32}&dataset=ball[\w-]*&isovalue=[\d.]+$")
        self.assertEqual(json.loads(lines[1]), {"page": 200, "picture": b"\x89PNG".hex()})
        self.assertEqual(lines[2:], ["ended"])


if __name__ == "__main__":
    IMAGE = make()
    unittest.main(argv=sys.argv[:1], verbosity=2, defaultTest=None if "cli" in TARGET else "ImageTest.test_size")
