"""Connections: retries, deadlines, tokens, TLS, forks, closing."""

import asyncio
import hashlib
import json
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import threading
import time
import traceback
import typing
import unicodedata

import grpc
import pytest
from google.protobuf import any_pb2, duration_pb2

import isoscope
import skips
from proxy import Proxy, make_certificates

ROOT = pathlib.Path(__file__).resolve().parents[3]
LOST = (grpc.StatusCode.UNAVAILABLE, "agent 127.0.0.1:1 was lost: it served shards 0, 1 of \"shells\"")


def refusal(seconds, code=grpc.StatusCode.RESOURCE_EXHAUSTED):
    """The error of a coordinator whose queue is full: google.rpc.Status with google.rpc.RetryInfo, as bytes."""
    whole = int(seconds)
    delay = duration_pb2.Duration(seconds=whole, nanos=round((seconds - whole) * 1e9)).SerializeToString()
    info = b"\x0a" + bytes([len(delay)]) + delay
    detail = any_pb2.Any(type_url="type.googleapis.com/google.rpc.RetryInfo", value=info).SerializeToString()
    return code, "36 wait", b"\x08\x08\x12\x0736 wait\x1a" + bytes([len(detail)]) + detail


@pytest.fixture
def proxy(client):
    with Proxy(client) as proxy:
        yield proxy


@pytest.fixture
def through(proxy):
    """A client through the proxy, which has seen no call of it yet."""
    with isoscope.connect(proxy.address) as through:
        proxy.seen.clear()
        yield through


def test_unavailable_is_tried_again_until_it_works(proxy, through, dataset):
    expected = dataset.render(127.5, size=32).png
    again = through["shells"]
    proxy.seen.clear()
    proxy.failures = [LOST, LOST]
    assert again.render(127.5, size=32).png == expected
    assert len(proxy.seen) == 3
    proxy.failures = [LOST]
    assert [one.name for one in through.datasets()] == ["shells"]


def test_unavailable_for_good_is_the_servers_sentence_after_four_tries(proxy, through):
    dataset = through["shells"]
    proxy.seen.clear()
    proxy.failures = [LOST] * 9
    with pytest.raises(isoscope.UnavailableError, match="served shards 0, 1") as caught:
        dataset.mesh(127.5)
    assert "no coordinator answers" not in str(caught.value)
    assert len(proxy.seen) == 4


@pytest.mark.parametrize("code", ["RESOURCE_EXHAUSTED", "INTERNAL", "DATA_LOSS", "FAILED_PRECONDITION"])
def test_no_other_error_is_tried_again(proxy, through, code):
    proxy.failures = [(grpc.StatusCode[code], "a sentence")] * 2
    with pytest.raises(isoscope.IsoscopeError, match="a sentence") as caught:
        through.datasets()
    assert caught.value.code == code and len(proxy.seen) == 1


def test_a_refusal_is_tried_again_after_the_time_that_it_tells(proxy, through, dataset):
    again = through["shells"]
    expected = dataset.render(127.5, size=32).png
    proxy.seen.clear()
    proxy.failures = [refusal(0.3), refusal(0.0)]
    start = time.monotonic()
    assert again.render(127.5, size=32).png == expected
    assert len(proxy.seen) == 3 and time.monotonic() - start >= 0.3
    proxy.failures = [refusal(0.01)]
    assert [one.name for one in through.datasets()] == ["shells"]


def test_a_refusal_that_tells_more_time_than_there_is_left_is_final(proxy, through):
    dataset = through["shells"]
    proxy.seen.clear()
    proxy.failures = [refusal(0.01), refusal(60)]
    with pytest.raises(isoscope.ResourceExhaustedError, match="36 wait"):
        dataset.render(127.5, size=32, timeout=5)
    assert len(proxy.seen) == 2 and proxy.seen[1][2] <= 6


def test_refusals_are_tried_again_by_aio_too(proxy, dataset):
    async def by_aio():
        async with isoscope.aio.connect(proxy.address) as through:
            again = await through.dataset("shells")
            proxy.failures = [refusal(0.02), refusal(0.02)]
            first = (await again.render(127.5, size=32)).png
            proxy.failures = [refusal(60)]
            with pytest.raises(isoscope.ResourceExhaustedError):
                await again.render(127.5, size=32, timeout=5)
            return first

    assert asyncio.run(by_aio()) == dataset.render(127.5, size=32).png


def test_damaged_details_are_a_final_refusal_and_nothing_worse(proxy):
    code, sentence, details = refusal(0.01)
    with isoscope.connect(proxy.address) as through:
        for size in range(0, len(details), 7):
            proxy.failures = [(code, sentence, details[:size])]
            with pytest.raises(isoscope.ResourceExhaustedError):
                through.datasets()
        proxy.failures = [(code, sentence, bytes(range(255, 0, -1)))]
        with pytest.raises(isoscope.ResourceExhaustedError):
            through.datasets()


HOSTILE = "no \x1b]0;title\x07\x1b[2Jsuch\rthing\x7f\x9b31m\nreally \u202egnp.exe\u2028\U000e0041"


@pytest.mark.parametrize("twin", ["blocking", "aio"])
def test_a_servers_text_does_not_steer_the_terminal_that_shows_the_error(proxy, twin):
    async def by_aio():
        async with isoscope.aio.connect(proxy.address) as through:
            proxy.failures = [(grpc.StatusCode.NOT_FOUND, HOSTILE)]
            await through.datasets()

    def blocking():
        with isoscope.connect(proxy.address) as through:
            proxy.failures = [(grpc.StatusCode.NOT_FOUND, HOSTILE)]
            through.datasets()

    with pytest.raises(isoscope.NotFoundError) as caught:
        blocking() if twin == "blocking" else asyncio.run(by_aio())
    assert str(caught.value) == "no ?]0;title??[2Jsuch?thing??31m\nreally ?gnp.exe??"
    # As the interpreter prints it, with what the error came from.
    shown = "".join(traceback.format_exception(None, caught.value, caught.value.__traceback__))
    assert "title" in shown and not [c for c in shown if unicodedata.category(c) == "Cc" and c != "\n"], shown


def test_every_call_has_a_deadline_and_the_metadata(proxy):
    with isoscope.connect(proxy.address, timeout=50, token="s3cret", metadata=[("X-Trace", "7")]) as through:
        dataset = through["shells"]
        dataset.render(127.5, size=16).pick(3, 3)
        dataset.mesh(127.5)
        dataset.histogram()
        through.agents()
        dataset.render(127.5, size=16, timeout=5)
    assert len(proxy.seen) == 8
    for method, metadata, left in proxy.seen:
        assert metadata["authorization"] == "Bearer s3cret" and metadata["x-trace"] == "7", method
        assert 0 < left <= 52, method  # gRPC rounds up on the way
    assert proxy.seen[-1][2] <= 6 and proxy.seen[0][2] <= 11


def test_a_missing_or_wrong_token_is_unauthenticated_with_the_servers_sentence(client):
    with Proxy(client, token="right") as proxy:
        for token in (None, "wrong"):
            with pytest.raises(isoscope.UnauthenticatedError, match="a token is needed") as caught:
                isoscope.connect(proxy.address, token=token)
            assert isinstance(caught.value, PermissionError)
        with isoscope.connect(proxy.address, token="right") as through:
            assert through["shells"].dims == (48, 40, 32)


def need_openssl():
    if shutil.which("openssl") is None:
        skips.skip("openssl", "no program openssl to make certificates with")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    need_openssl()
    return make_certificates(tmp_path_factory.mktemp("certificates"))


def key_and_certificate(folder):
    return (folder / "server.key").read_bytes(), (folder / "server.pem").read_bytes()


def test_tls_checks_the_server_and_encrypts_the_token(client, dataset, certificates):
    credentials = grpc.ssl_server_credentials([key_and_certificate(certificates)])
    with Proxy(client, credentials=credentials, token="t") as proxy:
        tls = {"ca_file": certificates / "ca.pem", "server_name": "isoscope.test", "token": "t"}
        with isoscope.connect(proxy.address, **tls) as through:
            assert through["shells"].render(127.5, size=40).png == dataset.render(127.5, size=40).png

        async def by_aio():
            async with isoscope.aio.connect(proxy.address, **tls) as through:
                return (await (await through.dataset("shells")).render(127.5, size=40)).png

        assert asyncio.run(by_aio()) == dataset.render(127.5, size=40).png
        with pytest.raises(isoscope.UnavailableError, match="certificate"):
            isoscope.connect(proxy.address, tls=True, server_name="isoscope.test", connect_timeout=5)
        with pytest.raises(isoscope.UnavailableError):
            isoscope.connect(proxy.address, connect_timeout=5, **{**tls, "server_name": "other.test"})
        with pytest.raises(isoscope.UnavailableError, match="tls=True"):
            isoscope.connect(proxy.address, connect_timeout=5)


def test_a_server_that_wants_a_client_certificate_gets_it(client, certificates):
    credentials = grpc.ssl_server_credentials(
        [key_and_certificate(certificates)], (certificates / "ca.pem").read_bytes(), True
    )
    with Proxy(client, credentials=credentials) as proxy:
        tls = {"ca_file": certificates / "ca.pem", "server_name": "isoscope.test", "connect_timeout": 5}
        own = {"cert_file": certificates / "client.pem", "key_file": certificates / "client.key"}
        with isoscope.connect(proxy.address, **tls, **own) as through:
            assert "shells" in through
        with pytest.raises(isoscope.UnavailableError):
            isoscope.connect(proxy.address, **tls)


def test_no_server_is_said_with_what_to_start():
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with pytest.raises(isoscope.UnavailableError, match=f"no coordinator answers at localhost:{port}.*isoscope serve"):
        isoscope.connect(f"localhost:{port}")


def test_a_server_that_never_answers_is_given_up_at_the_deadline():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        with pytest.raises((isoscope.DeadlineExceededError, isoscope.UnavailableError)):
            isoscope.connect(f"127.0.0.1:{silent.getsockname()[1]}", connect_timeout=0.5)


def test_a_call_past_its_deadline_says_its_time(dataset):
    with pytest.raises(isoscope.DeadlineExceededError, match="within 1e-06 s.*timeout=SECONDS"):
        dataset.render(127.5, timeout=1e-6)


def test_a_closed_client_refuses_calls_and_closes_again(client):
    other = isoscope.connect(client.address, token_file=client.token_file)
    dataset = other["shells"]
    other.close()
    other.close()
    for call in (other.datasets, lambda: dataset.render(1), lambda: dataset.mesh(1)):
        with pytest.raises(isoscope.CancelledError, match="closed"):
            call()


FORKS = """
import multiprocessing, sys
import isoscope

dataset = isoscope.connect(sys.argv[1], token_file=sys.argv[2])["shells"]
expected = dataset.render(127.5, size=48).png
context = multiprocessing.get_context("fork")

def child(queue):
    queue.put(dataset.render(127.5, size=48).png == expected)

queue = context.Queue()
children = [context.Process(target=child, args=(queue,)) for _ in range(3)]
for one in children:
    one.start()
print([queue.get(timeout=30) for _ in children], dataset.render(127.5, size=48).png == expected)
"""


def test_a_forked_child_has_a_connection_of_its_own(client):
    """In a process of its own: gRPC forks only where no call and no server of the process is at work."""
    command = [sys.executable, "-c", FORKS, client.address, client.token_file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "[True, True, True] True", done.stderr


FORKS_TWICE = """
import os, sys
if sys.argv[3] == "grpc first":
    import grpc
    grpc.insecure_channel("unix:nobody").close()
import isoscope

dataset = isoscope.connect(sys.argv[1], token_file=sys.argv[2])["shells"]
dataset.render(127.5, size=8)
for _ in range(2):
    child = os.fork()
    if child == 0:
        try:
            dataset.render(127.5, size=8)
            print("rendered", flush=True)
        except isoscope.FailedPreconditionError as error:
            print(error, flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


@pytest.mark.parametrize(
    ("first", "strategy", "can_call"),
    [("isoscope first", None, True), ("grpc first", None, False), ("isoscope first", "epoll1", False)],
)
def test_no_child_shares_an_epoll_set_of_grpc_with_its_parent(client, first, strategy, can_call):
    """Each took events of the other: half of the children waited for 5 or 10 s on a busy machine, and some failed."""
    command = [sys.executable, "-c", FORKS_TWICE, client.address, client.token_file, first]
    environment = {name: value for name, value in os.environ.items() if name != "GRPC_POLL_STRATEGY"}
    if strategy:
        environment["GRPC_POLL_STRATEGY"] = strategy
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    lines = done.stdout.splitlines()
    assert len(lines) == 2, done.stdout + done.stderr
    for line in lines:
        assert line == "rendered" if can_call else "waits by epoll" in line, done.stdout


EPOLL_SETS = """
import os, sys
import isoscope

isoscope.connect(sys.argv[1], token_file=sys.argv[2])["shells"].render(127.5, size=8)
links = [f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd")]
print(sum(os.readlink(link) == "anon_inode:[eventpoll]" for link in links if os.path.lexists(link)))
"""


def test_grpc_keeps_no_epoll_set_after_a_call(client):
    command = [sys.executable, "-c", EPOLL_SETS, client.address, client.token_file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "0", done.stdout + done.stderr


FORKS_OFTEN = """
import collections, os, sys
import isoscope

dataset = isoscope.connect(sys.argv[1], token_file=sys.argv[2])["shells"]
expected = dataset.render(127.5, size=8).png
ends = collections.Counter()
for _ in range(20):
    dataset.render(127.5, size=8)
    child = os.fork()
    if child == 0:
        os._exit(0 if dataset.render(127.5, size=8).png == expected else 1)
    ends[os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])] += 1
print(dict(ends))
"""


@pytest.mark.parametrize("support", ["0", "1"])
def test_no_fork_after_a_call_ends_the_child(client, support):
    """gRPC's own handlers alone ended 3 of 100 children on a busy machine before they ran."""
    command = [sys.executable, "-c", FORKS_OFTEN, client.address, client.token_file]
    environment = os.environ | {"GRPC_ENABLE_FORK_SUPPORT": support}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "{0: 20}", done.stderr


FORK_IN_SHUTDOWN = """
import os, sys, threading, time
import isoscope

dataset = isoscope.connect(sys.argv[1], token_file=sys.argv[2])["shells"]
dataset.render(127.5, size=8)
is_named, has_ended = threading.Event(), threading.Event()

def as_the_thread_of_grpc():
    with open(f"/proc/self/task/{threading.get_native_id()}/comm", "w") as name:
        name.write("grpc_shutdown")
    is_named.set()
    time.sleep(0.3)
    has_ended.set()

threading.Thread(target=as_the_thread_of_grpc).start()
is_named.wait()
child = os.fork()
if child == 0:
    os._exit(0 if has_ended.is_set() and dataset.render(127.5, size=8).png else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def test_a_fork_waits_for_the_thread_that_shuts_grpc_down(client):
    """It holds a lock that a new channel needs: on a busy machine a child waited for it for ever."""
    command = [sys.executable, "-c", FORK_IN_SHUTDOWN, client.address, client.token_file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "0", done.stderr


FORKS_AT_WORK = """
import os, sys
import isoscope

client = isoscope.connect(sys.argv[1], token_file=sys.argv[2])
channel = client._channel.get()

def calls_in_child():
    try:
        return client["shells"].name
    except isoscope.FailedPreconditionError as error:
        return str(error)

def in_child(work):
    read, write = os.pipe()
    if os.fork() == 0:
        os.write(write, work().encode())
        os._exit(0)
    os.close(write)
    with open(read) as pipe:
        print(pipe.read(), flush=True)

with client._channel.call_at_work():
    in_child(calls_in_child)
    in_child(lambda: (in_child(calls_in_child), "above: a grandchild")[1])
    print(client._channel.get() is channel)
in_child(calls_in_child)
print(client._channel.get() is channel, client["shells"].name)
"""


def test_a_child_that_was_forked_in_a_call_refuses_calls_and_its_parent_goes_on(client):
    command = [sys.executable, "-c", FORKS_AT_WORK, client.address, client.token_file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    lines = done.stdout.splitlines()
    assert len(lines) == 6, done.stdout + done.stderr
    assert "was forked while gRPC was at work" in lines[0] and "method 'spawn'" in lines[0]
    assert lines[2] == "above: a grandchild" and "was forked while gRPC was at work" in lines[1], lines
    assert lines[3:] == ["True", "shells", "False shells"]


THREADS_AROUND_A_FORK = """
import contextlib, os, sys, time
import isoscope

def executor_threads():
    found = set()
    for task in os.listdir("/proc/self/task"):
        with contextlib.suppress(OSError), open(f"/proc/self/task/{task}/comm") as name:
            if name.read().strip() in ("default-executo", "resolver-execut"):
                found.add(task)
    return found

client = isoscope.connect(sys.argv[1], token_file=sys.argv[2])
client["shells"]
with client._channel.call_at_work():
    while not (before := executor_threads()):  # a thread takes its name when it first runs
        time.sleep(0.01)
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)
    print(before <= executor_threads())
"""


def test_grpc_does_not_end_its_threads_at_a_fork_in_a_call(client):
    """Its own handlers do, and then wait for a thread that waits for the fork to end: this hung on a busy machine."""
    command = [sys.executable, "-c", THREADS_AROUND_A_FORK, client.address, client.token_file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "True", done.stdout + done.stderr


FORK_BEFORE_THREADS_HAVE_NAMES = """
import os, sys
import isoscope
from isoscope import _process_channel

_process_channel._has_core_threads = lambda: False
client = isoscope.connect(sys.argv[1], token_file=sys.argv[2])
client._channel.get()
with client._channel.call_at_work():
    child = os.fork()
    if child == 0:
        try:
            client["shells"]
        except isoscope.FailedPreconditionError:
            os._exit(0)
        os._exit(1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def test_a_child_of_an_open_channel_refuses_calls_though_no_thread_of_grpc_has_its_name_yet(client):
    """A new thread has its creator's name until it runs; the child's copy of gRPC would wait for it for ever."""
    command = [sys.executable, "-c", FORK_BEFORE_THREADS_HAVE_NAMES, client.address, client.token_file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "0", done.stderr


def test_threads_share_a_client(dataset):
    expected = {angle: dataset.render(127.5, size=32, azimuth=angle).png for angle in (0, 40, 80)}
    wrong = []

    def work(angle):
        for _ in range(5):
            if dataset.render(127.5, size=32, azimuth=angle).png != expected[angle]:
                wrong.append(angle)

    threads = [threading.Thread(target=work, args=(angle,)) for angle in expected for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_the_async_client_does_what_the_blocking_one_does(client, dataset):
    async def all_of_it():
        async with isoscope.aio.connect(client.address, token_file=client.token_file) as through:
            assert [one.name for one in await through.datasets()] == ["shells"]
            assert (await through.capabilities()) == client.capabilities()
            assert [agent.address for agent in await through.agents()] == [one.address for one in client.agents()]
            shells = await through.dataset("shells")
            assert shells.bounds == dataset.bounds and (await shells.refresh()) == shells
            angles = (0, 30, 60, 90)
            frames = await asyncio.gather(
                *[shells.render(127.5, size=40, azimuth=angle, planes=["depth"]) for angle in angles]
            )
            for angle, frame in zip(angles, frames):
                same = dataset.render(127.5, size=40, azimuth=angle)
                assert frame.png == same.png and (frame.depth == same.depth).all()
            assert await shells.pick((20, 20), frame=frames[1]) == dataset.pick((20, 20), 127.5, size=40, azimuth=30)
            assert await shells.pick([(0, 0)], 127.5, size=40) == [None]
            assert (await shells.mesh(127.5)).area == dataset.mesh(127.5).area
            assert (await shells.histogram()).edges.tolist() == dataset.histogram().edges.tolist()
            assert await shells.suggestions() == dataset.suggestions()
            with pytest.raises(isoscope.IsoscopeError, match='planes=\\["normal"\\]'):
                frames[0].normal
            with pytest.raises(isoscope.IsoscopeError, match="frame=frame"):
                frames[0].pick(1, 1)
            with pytest.raises(LookupError, match="shells"):
                await through.dataset("head")
            with pytest.raises(isoscope.DeadlineExceededError):
                await shells.render(127.5, timeout=1e-6)
        with pytest.raises(isoscope.CancelledError, match="closed"):
            await shells.render(127.5)
        with pytest.raises(ConnectionError, match="no coordinator answers"):
            await isoscope.aio.connect("localhost:1")

    asyncio.run(all_of_it())


def test_a_cancelled_task_ends_its_call(client):
    async def cancel():
        async with isoscope.aio.connect(client.address, token_file=client.token_file) as through:
            shells = await through.dataset("shells")
            for _ in range(10):
                task = asyncio.create_task(shells.render(127.5, size=3000, samples=4))
                await asyncio.sleep(0.05)
                if task.cancel():  # else a busy machine has drawn it before
                    break
            with pytest.raises(asyncio.CancelledError):
                await task
            assert (await shells.render(127.5, size=16)).width == 16

    asyncio.run(cancel())


def test_both_clients_have_the_same_names_and_arguments():
    import inspect

    def public(cls):
        return {name for name in vars(cls) if not name.startswith("_")}

    blocking_only = {"view"}
    assert public(isoscope.Dataset) - blocking_only == public(isoscope.aio.Dataset)
    mapping_only = {"keys"}  # a mapping can't be awaited
    assert public(isoscope.Client) - mapping_only == public(isoscope.aio.Client)
    for name in ("render", "pick", "mesh", "histogram"):
        blocking, awaited = (inspect.signature(getattr(cls, name)) for cls in (isoscope.Dataset, isoscope.aio.Dataset))
        assert blocking.parameters == awaited.parameters, name
        types, same = (typing.get_type_hints(getattr(cls, name)) for cls in (isoscope.Dataset, isoscope.aio.Dataset))
        assert types == same, name
    assert typing.get_type_hints(isoscope.connect)["return"] is isoscope.Client
    assert inspect.signature(isoscope.connect).parameters == inspect.signature(isoscope.aio.connect).parameters


def test_the_hosts_environment_stays_as_it_was(client):
    code = (
        "import os\n"
        "before = dict(os.environ)\n"
        "import isoscope, sys\n"
        "isoscope.connect(sys.argv[1], token_file=sys.argv[2])['shells'].render(127.5, size=16)\n"
        "assert dict(os.environ) == before\n"
    )
    for variables in ({}, {"GRPC_VERBOSITY": "ERROR"}):
        environment = {key: text for key, text in os.environ.items() if not key.startswith("GRPC_")} | variables
        command = [sys.executable, "-c", code, client.address, client.token_file]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr


def test_grpc_writes_no_lines_beside_our_errors():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer():
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"no TLS\n" * 9)
                connection.recv(4096)

        threading.Thread(target=answer, daemon=True).start()
        code = (
            "import isoscope, sys\n"
            "try:\n"
            "    isoscope.connect(sys.argv[1], tls=True, connect_timeout=3)\n"
            "except isoscope.IsoscopeError:\n"
            "    print('refused')\n"
        )
        environment = {key: text for key, text in os.environ.items() if key != "GRPC_VERBOSITY"}
        command = [sys.executable, "-c", code, f"127.0.0.1:{server.getsockname()[1]}"]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert (done.stdout.strip(), done.stderr) == ("refused", "")


ONE_HANDLER = """
import os
import isoscope
from isoscope._channel import Target
from isoscope.client import Client

registered = []
os.register_at_fork = lambda **handlers: registered.append(handlers)
clients = [Client(Target("localhost:1")) for _ in range(5)]
for client in clients:
    client._channel._lock.acquire()  # as a thread of the parent does in the moment of the fork
pid = os.fork()
if pid == 0:
    os._exit(0 if all(client._channel._lock.acquire(timeout=5) for client in clients) else 1)
print(len(registered), os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""


def test_a_process_has_one_fork_handler_however_many_clients_it_makes():
    """In a process of its own, as above."""
    done = subprocess.run([sys.executable, "-c", ONE_HANDLER], capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["0", "0"], done.stderr


@pytest.fixture(scope="module")
def secure_server(programs, folder, tmp_path_factory):
    """The service itself with TLS and a token file: its address and the folder of certificates."""
    need_openssl()
    tls = tmp_path_factory.mktemp("tls") / "tls"
    subprocess.run(["bash", str(ROOT / "scripts" / "make_certificates.sh"), str(tls)], check=True, capture_output=True)
    digest = hashlib.sha256(b"blind").hexdigest()
    tokens = json.loads((tls / "tokens.json").read_text())
    tokens["tokens"].append({"name": "blind", "sha256": digest, "datasets": ["another"]})
    (tls / "tokens.json").write_text(json.dumps(tokens))
    command = [
        str(programs / "isoscope"), "serve", str(folder), "--listen", "127.0.0.1:0", "--renderer", "cpu", "--threads", "1",
        "--tls-cert", str(tls / "coordinator.pem"), "--tls-key", str(tls / "coordinator.key"),
        "--tls-ca", str(tls / "ca.pem"), "--tokens", str(tls / "tokens.json"),
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        try:
            yield server.stdout.readline().strip(), tls
        finally:
            server.terminate()


def test_the_service_itself_takes_tokens_and_certificates_over_tls(secure_server, dataset):
    address, tls = secure_server
    ca = {"ca_file": tls / "ca.pem"}
    expected = dataset.render(127.5, size=40).png
    with isoscope.connect(address, token=(tls / "token").read_text(), **ca) as through:
        assert through["shells"].render(127.5, size=40).png == expected
        assert through["shells"].mesh(127.5).area == dataset.mesh(127.5).area
    with isoscope.connect(address, cert_file=tls / "client.pem", key_file=tls / "client.key", **ca) as through:
        assert through["shells"].render(127.5, size=40).png == expected
    with isoscope.connect(address, token="blind", **ca) as through:
        assert through.datasets() == []
        with pytest.raises(LookupError):
            through["shells"]
    for token, sentence in ((None, "asks who calls"), ("wrong", "not known")):
        with pytest.raises(isoscope.UnauthenticatedError, match=sentence):
            isoscope.connect(address, token=token, **ca)
    with pytest.raises(isoscope.PermissionDeniedError, match="the role agent"):
        isoscope.connect(address, cert_file=tls / "agent.pem", key_file=tls / "agent.key", **ca)
    with pytest.raises(isoscope.UnavailableError):
        isoscope.connect(address, connect_timeout=5)
