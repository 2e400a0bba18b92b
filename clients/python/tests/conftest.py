"""Shared fixtures of the tests: the programs of the build, a generated volume, its server, its client."""

import os
import pathlib
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = HERE.parent
ROOT = PACKAGE.parents[1]
# Before isoscope itself is imported anywhere; also for the processes that tests start.
sys.path.insert(0, str(PACKAGE / "src"))
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(PACKAGE / "src"), *filter(None, [os.environ.get("PYTHONPATH")])]
)

sys.path.insert(1, str(ROOT / "tests" / "support"))

import isoscope  # noqa: E402
import skips  # noqa: E402


def _programs():
    """Folder of the programs: $ISOSCOPE_BIN, else the release build of the checkout."""
    named = os.environ.get("ISOSCOPE_BIN")
    return pathlib.Path(named) if named else ROOT / "build" / "release" / "bin"


@pytest.fixture(scope="session")
def programs():
    folder = _programs()
    if not (folder / "isoscope").is_file():
        skips.skip("programs", f"no program {folder / 'isoscope'}: build it, or set ISOSCOPE_BIN")
    os.environ["ISOSCOPE_BIN"] = str(folder)
    return folder


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory):
    """The programs' cache of partitioned volumes: the tests' own, also for the processes that they start."""
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))
    return pathlib.Path(os.environ["XDG_CACHE_HOME"]) / "isoscope"


@pytest.fixture(scope="session")
def run(programs):
    """Runs `isoscope ARGUMENTS...` and returns its standard output."""

    def run(*arguments):
        command = [str(programs / "isoscope"), *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    return run


@pytest.fixture(scope="session")
def volume(run, tmp_path_factory):
    """A small volume of nested shells, with a spacing and an origin of its own."""
    path = tmp_path_factory.mktemp("volume") / "shells.nrrd"
    run(
        "generate", "shells", "--dims", "48,40,32", "--type", "uint8", "--spacing", "1,1.5,0.75",
        "--origin", "-3,7,0.1", "--output", path,
    )  # fmt: skip
    return path


@pytest.fixture(scope="session")
def folder(run, volume, tmp_path_factory):
    path = tmp_path_factory.mktemp("datasets") / "shells"
    run("partition", volume, "--output", path, "--shards", "3")
    return path


@pytest.fixture(scope="session")
def client(folder):
    with isoscope.serve(folder, renderer="cpu", threads=2) as client:
        yield client


@pytest.fixture(scope="session")
def dataset(client):
    return client["shells"]
