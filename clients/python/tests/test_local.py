"""`isoscope.serve`: starts, serves, cleans up, and says what is wrong."""

import asyncio
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import isoscope
from isoscope.errors import InvalidArgumentError, ProgramError


def children_of(pid):
    done = subprocess.run(["ps", "-A", "-o", "pid=,ppid=,args="], capture_output=True, text=True, check=True)
    rows = [line.split(None, 2) for line in done.stdout.splitlines()]
    return [(int(row[0]), row[2]) for row in rows if int(row[1]) == pid and len(row) == 3]


def is_alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_until(condition, seconds=20):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


def test_a_volume_file_is_served_and_everything_is_gone_afterwards(volume):
    before = set(children_of(os.getpid()))
    client = isoscope.serve(volume)
    (keeper,) = [pid for pid, args in set(children_of(os.getpid())) - before if "isoscope-serve" in args]
    servers = [pid for pid, args in children_of(keeper) if "isoscope serve" in args and "sh -c" not in args]
    scratch = pathlib.Path(client.token_file).parent
    assert client.dataset().source == "shells.nrrd" and servers and scratch.is_dir()
    client.close()
    assert wait_until(lambda: not any(map(is_alive, servers)))
    assert not scratch.exists()


def test_a_client_is_a_mapping_of_names_for_python_and_for_the_tab_key(folder):
    with isoscope.serve({"p": np.zeros((3, 3, 3)) + np.arange(3)}, name="one") as client:
        assert len(client) == 1 and list(client) == client.keys() == client._ipython_key_completions_() == ["one"]
        assert "one" in client and client["one"] == client.dataset() and list(dict(client)) == ["one"]
        assert client
    # A client without a server is true, too, and the Tab key waits for nothing.
    assert client and client._ipython_key_completions_() == []


def test_a_volume_is_partitioned_once_for_python_and_the_command_line(run, programs, cache, tmp_path):
    volume = tmp_path / "once.nrrd"
    run("generate", "shells", "--dims", "20,20,20", "--type", "uint8", "--output", volume)

    def entries():
        return {path.name: (path / "manifest.json").stat().st_ino for path in cache.glob("once-*")}

    with isoscope.serve(volume) as client:
        made = entries()
        assert list(client) == ["once"] and len(made) == 1
        # None that is in use is removed.
        done = subprocess.run([programs / "isoscope", "cache", "clear", volume], capture_output=True, text=True)
        assert "in use" in done.stderr and entries() == made
    run("render", volume, "--isovalue", "100", "--output", tmp_path / "once.png")
    with isoscope.serve(volume) as client:
        assert client.dataset().render(100, size=16).width == 16
    assert entries() == made
    with isoscope.serve(volume, name="own") as client:
        assert list(client) == ["own"] and entries() == made
    with isoscope.serve(volume, shards=2) as client:
        assert client.dataset().shard_count == 2 and len(entries()) == 2


def test_nobody_without_the_token_gets_in(client, folder):
    with pytest.raises(isoscope.UnauthenticatedError, match="asks who calls"):
        isoscope.connect(client.address)
    with pytest.raises(isoscope.UnauthenticatedError, match="not known"):
        isoscope.connect(client.address, token="a guess")

    async def by_aio(**token):
        async with isoscope.aio.connect(client.address, **token) as through:
            return [dataset.name for dataset in await through.datasets()], through.token_file

    with pytest.raises(isoscope.UnauthenticatedError):
        asyncio.run(by_aio())
    # Who has the token gets in, and each server has one of its own.
    assert asyncio.run(by_aio(token_file=client.token_file)) == (["shells"], client.token_file)
    with isoscope.connect(client.address, token_file=client.token_file) as through:
        assert list(through) == ["shells"] and through.token_file == client.token_file
    with isoscope.serve(folder) as other:
        with pytest.raises(isoscope.UnauthenticatedError):
            isoscope.connect(other.address, token_file=client.token_file)


def test_the_token_is_in_no_command_line_and_in_files_of_this_user_alone(folder):
    with isoscope.serve(folder) as client:
        private = pathlib.Path(client.token_file).parent
        token = pathlib.Path(client.token_file).read_text()
        assert len(token) >= 32 and private.stat().st_mode & 0o777 == 0o700
        for path in private.iterdir():
            assert path.stat().st_mode & 0o777 == 0o600 and path.stat().st_uid == os.getuid(), path
        assert [path for path in private.iterdir() if token in path.read_text()] == [pathlib.Path(client.token_file)]
        for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
            with contextlib.suppress(OSError):  # it ended meanwhile
                assert token.encode() not in path.read_bytes(), path
        assert token not in repr(client) and token not in repr(client._target)
    assert not private.exists()


def test_a_token_file_is_read_as_the_programs_read_it(client, tmp_path):
    token = pathlib.Path(client.token_file).read_text()
    (tmp_path / "token").write_text(f"\n {token}\n")
    isoscope.connect(client.address, token_file=tmp_path / "token").close()
    with pytest.raises(InvalidArgumentError, match="exclude each other"):
        isoscope.connect(client.address, token=token, token_file=tmp_path / "token")
    for text in ("", "\n", "two words", "tok\x01en", "t\u00f6ken"):
        (tmp_path / "token").write_text(text, encoding="utf-8")
        with pytest.raises(InvalidArgumentError, match="holds no token"):
            isoscope.connect(client.address, token_file=tmp_path / "token")
    with pytest.raises(InvalidArgumentError, match="can't read"):
        isoscope.connect(client.address, token_file=tmp_path / "nothing")


def test_an_array_is_served_in_its_order(programs):
    array = np.zeros((4, 5, 6), np.int16)
    array[:, :, 3:] = 100
    with isoscope.serve(array[:, :, ::1], spacing=(2, 1, 1), origin=(10, 0, 0)) as client:
        dataset = client.dataset("array")
        assert dataset.dims == (6, 5, 4) and dataset.dtype == np.int16 and dataset.range == (0, 100)
        assert np.allclose(dataset.mesh(50).points[:, 0], 10 + 2 * 2.5)
    view = np.asfortranarray(array).astype(">i2")
    with isoscope.serve(view) as client:
        assert np.allclose(client.dataset().mesh(50).points[:, 0], 2.5)
    with isoscope.serve(array > 0, name="mask") as client:
        assert client["mask"].range == (0, 1)


@pytest.mark.parametrize(
    "how, words",
    [
        ({"spacing": 2.0}, "spacing 2.0: must be three finite numbers above 0"), ({"spacing": (1, -1, 1)}, "above 0"),
        ({"spacing": (1, 0, 1)}, "above 0"), ({"spacing": "1,2,3"}, "spacing '1,2,3'"), ({"spacing": (1, None, 1)}, "None"),
        ({"origin": (0, 0)}, "origin .*three finite numbers"), ({"origin": (0, 0, float("nan"))}, "origin .*finite"),
        ({"direction": [[0, 1, 0], [1, 0, 0]]}, "direction .*3 x 3"), ({"direction": [[1], [0, 1]]}, "direction .*3 x 3"),
        ({"axes": ["Z", "Y", "X"]}, "axes .*must be text"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("source", [np.zeros((3, 3, 3)), {"p": np.zeros((3, 3, 3))}, "head.nrrd"])
def test_numbers_that_place_no_grid_are_refused_with_what_is_expected(programs, source, how, words):
    """A dict of arrays took a negative spacing, and an array the sentence of a flag."""
    with pytest.raises(InvalidArgumentError, match=words):
        isoscope.serve(source, **how)


def test_a_files_positions_can_be_given(run, tmp_path):
    volume = tmp_path / "shells.nrrd"
    run("generate", "shells", "--dims", "12,12,12", "--type", "uint8", "--output", volume)
    turned = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    with isoscope.serve(volume, spacing=(1, 2, 4), origin=(5, 6, 7), direction=turned) as client:
        dataset = client.dataset()
        assert dataset.spacing == (1, 2, 4) and dataset.origin == (5, 6, 7)
        points = dataset.mesh(100).points
        assert points[:, 0].max() <= 5 and points[:, 1].min() >= 6  # index y runs along -x, index x along y
    with isoscope.serve(volume, folder=tmp_path / "kept", spacing=(1, 1, 3)) as client:
        assert client["kept"].spacing == (1, 1, 3)
    with pytest.raises(InvalidArgumentError, match="a dataset folder has its own"):
        isoscope.serve(tmp_path / "kept", spacing=(1, 1, 1))


def test_a_raw_file_is_served_with_its_dims(programs, tmp_path):
    samples = np.linspace(0, 1, 4 * 5 * 6, dtype="<f4")
    samples.tofile(tmp_path / "field.raw")
    with isoscope.serve(tmp_path / "field.raw", dims=(6, 5, 4), dtype="float32", folder=tmp_path / "kept") as client:
        assert client["kept"].range == (0, 1)
    assert (tmp_path / "kept" / "manifest.json").is_file()
    with isoscope.serve(tmp_path / "kept") as client:
        assert client["kept"].dims == (6, 5, 4)


@pytest.mark.parametrize(
    "array, words",
    [
        (np.zeros((3, 3)), "shape"), (np.zeros((3, 3, 1)), "at least 2"),
        (np.zeros((3, 3, 3), complex), "complex128"), (np.zeros((3, 3, 3), object), "object"),
    ],
)  # fmt: skip
def test_arrays_that_are_no_volumes_are_refused(programs, array, words):
    with pytest.raises(InvalidArgumentError, match=words):
        isoscope.serve(array)


def test_a_missing_program_is_said_with_what_to_do(monkeypatch, tmp_path, volume):
    monkeypatch.delenv("ISOSCOPE_BIN")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ProgramError, match="not installed here.*ISOSCOPE_BIN.*isoscope.connect"):
        isoscope.serve(volume)
    monkeypatch.setenv("ISOSCOPE_BIN", str(tmp_path / "nothing"))
    with pytest.raises(ProgramError, match="ISOSCOPE_BIN is"):
        isoscope.serve(volume)


def test_the_programs_own_sentence_is_the_error(programs, tmp_path, folder):
    with pytest.raises(ProgramError, match="isoscope serve failed.*nothing.nrrd"):
        isoscope.serve(tmp_path / "nothing.nrrd")
    with pytest.raises(ProgramError, match="isoscope serve failed.*odd"):
        isoscope.serve(folder, renderer="odd")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "manifest.json").write_text("{}")
    with pytest.raises(ProgramError, match="isoscope serve failed.*manifest"):
        isoscope.serve(tmp_path / "broken")


@pytest.mark.parametrize("how", ["returns", "is killed"])
def test_the_server_ends_with_the_process_that_started_it(programs, folder, how):
    code = (
        "import isoscope, sys, time\n"
        f"client = isoscope.serve({str(folder)!r})\n"
        "print(client.address, flush=True)\n" + ("" if how == "returns" else "time.sleep(60)\n")
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    address = process.stdout.readline().strip()
    if how == "is killed":
        process.send_signal(signal.SIGKILL)
    process.wait(60)
    process.stdout.close()

    def is_gone():
        try:
            isoscope.connect(address, connect_timeout=2).close()
        except isoscope.UnauthenticatedError:
            return False  # it asks for its token: it is there
        except isoscope.IsoscopeError:
            return True
        return False

    assert wait_until(is_gone)


@pytest.mark.parametrize("when", ["writing", "served"])
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_no_temporary_files_outlive_a_process_that_is_killed(programs, tmp_path, when, how):
    """A kernel is killed so. The samples stayed: 27 GB of an array of dask."""
    code = (
        "import isoscope, numpy, time\n"
        "def note(done, total):\n"
        + ("    print('writing', flush=True)\n    time.sleep(60)\n" if when == "writing" else "    pass\n")
        + "client = isoscope.serve(numpy.zeros((4, 4, 4)), progress=note)\n"
        "print('served', flush=True)\n"
        "time.sleep(60)\n"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment)
    assert process.stdout.readline().strip() == when and list(tmp_path.glob("isoscope-*"))
    process.send_signal(how)
    process.wait(60)
    process.stdout.close()
    assert wait_until(lambda: not list(tmp_path.glob("isoscope-*")))


def test_an_interrupt_of_the_notebook_leaves_the_server_alone(programs, folder):
    code = (
        "import isoscope, os, signal, time\n"
        f"client = isoscope.serve({str(folder)!r})\n"
        "try:\n"
        "    os.killpg(0, signal.SIGINT)\n"
        "    time.sleep(10)\n"
        "except KeyboardInterrupt:\n"
        "    pass\n"
        "time.sleep(0.3)\n"
        "print(client['shells'].render(127.5, size=16).width)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, start_new_session=True)
    assert done.stdout.strip() == "16", done.stderr


def test_a_forked_childs_end_leaves_the_server_alone(folder):
    with isoscope.serve(folder) as client:
        pid = os.fork()
        if pid == 0:
            client.close()
            os._exit(0)
        os.waitpid(pid, 0)
        assert client["shells"].dims == (48, 40, 32)
