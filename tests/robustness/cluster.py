"""The processes of a cluster on loopback ports: started, killed, stopped, drained, and watched.

Everything lies in one folder: the volume, the datasets, each agent's own copy of its shard, logs, certificates.
A process that ends and was not told to is a finding.
"""

import contextlib
import dataclasses
import json
import math
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
MAX_FRAME_S = 4.0
DRAIN_S = 3.0
START_S = 30.0
MEMORY_LIMIT_MIB = 512
# An agent starts with 96 MiB at least; with TLS and the tables of a shard it holds a bit more.
LEAST_AGENT_MIB = 112
AGENT_THREADS = (1, 8)


class HarnessError(Exception):
    """The harness can't go on: it is not a finding about the programs."""


class Ports:
    """Free ports below those that systems assign to clients: a dead server keeps its port."""

    def __init__(self, seed):
        self._chance = random.Random(seed ^ os.getpid())
        self._given = set()

    def take(self):
        for _ in range(1000):
            port = self._chance.randrange(20000, 32000)
            if port in self._given:
                continue
            with socket.socket() as probe:
                try:
                    probe.bind(("127.0.0.1", port))
                except OSError:
                    continue
            self._given.add(port)
            return port
        raise HarnessError("no free port in [20000, 32000)")


def answers(port):
    """Returns true if a process listens there."""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=0.5):
            return True
    except OSError:
        return False


class Process:
    """One program that listens on one port; may be started again and again. Its owner serialises the calls."""

    def __init__(self, name, argv, port, folder, on_exit, limit_mib=MEMORY_LIMIT_MIB):
        self.name, self.argv, self.port, self.limit_mib = name, argv, port, limit_mib
        self.log = folder / f"{name}.log"
        self._on_exit = on_exit  # (name, exit code, last lines)
        self._process = None
        self._lock = threading.Lock()
        self.is_wanted = False
        self.may_fail = False  # it was given a broken shard: it may refuse to start

    def start(self, argv=None, log=None, wait=True):
        with self._lock, open(log or self.log, "ab", buffering=0) as out:
            if self.is_alive():
                raise HarnessError(f"{self.name} is started although it runs")
            self._process = subprocess.Popen(
                argv or self.argv, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True
            )
            self.is_wanted = True
        if wait:
            self.wait_until_up()

    def wait_until_up(self, timeout=START_S):
        """Whether it listens; not if it has ended and was allowed to."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            if answers(self.port):
                return True
            if self._process.poll() is not None:
                return False
            time.sleep(0.02)
        raise HarnessError(f"{self.name} does not listen on port {self.port} after {timeout} s: {self.tail()}")

    def check(self):
        """Reports an unexpected exit, once."""
        with self._lock:
            code = self._process.poll() if self._process and self.is_wanted else None
            if code is None:
                return
            self.is_wanted = False
        if self.may_fail and code == 1:
            return
        self._on_exit(self.name, code, self.tail())
        with contextlib.suppress(HarnessError):  # a fault was faster
            self.start(wait=False)  # the run goes on

    def kill(self):
        with self._lock:
            self.is_wanted = False
            process = self._process
        if process and process.poll() is None:
            process.kill()
        if process:
            process.wait()

    def signal(self, number):
        if self._process and self._process.poll() is None:
            self._process.send_signal(number)

    def stop(self):
        self.signal(signal.SIGSTOP)

    def resume(self):
        self.signal(signal.SIGCONT)

    def drain(self):
        """SIGTERM, and waits. Returns "" or why that was not right."""
        with self._lock:
            self.is_wanted = False
            process = self._process
        if process is None or process.poll() is not None:
            return ""
        begin = time.monotonic()
        process.send_signal(signal.SIGTERM)
        try:
            code = process.wait(DRAIN_S + 10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return f"{self.name} did not end {time.monotonic() - begin:.1f} s after SIGTERM: {self.tail()}"
        return "" if code == 0 else f"{self.name} ended with {code} after SIGTERM: {self.tail()}"

    def is_alive(self):
        return self._process is not None and self._process.poll() is None

    def facts(self):
        """Resident bytes, descriptors and threads now; {} if it is gone."""
        try:
            proc = pathlib.Path("/proc") / str(self._process.pid)
            status = dict(line.split(":", 1) for line in (proc / "status").read_text().splitlines())
            return {
                "resident_bytes": int(status["VmRSS"].split()[0]) * 1024,
                "threads": int(status["Threads"]),
                "descriptors": len(os.listdir(proc / "fd")),
            }
        except (OSError, KeyError, ValueError, AttributeError):
            return {}

    def tail(self, lines=5):
        try:
            return " | ".join(self.log.read_text(errors="replace").splitlines()[-lines:])
        except OSError:
            return ""


class ProxyClient:
    """Speaks with proxy.py. Thread-safe."""

    def __init__(self):
        self._process = subprocess.Popen(
            [sys.executable, HERE / "proxy.py"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        self._lock = threading.Lock()

    def __call__(self, do, **values):
        with self._lock:
            self._process.stdin.write(json.dumps({"do": do, **values}) + "\n")
            self._process.stdin.flush()
            answer = json.loads(self._process.stdout.readline() or '{"ok": false, "error": "the proxy has ended"}')
        if not answer["ok"]:
            raise HarnessError(f"proxy: {do} {values}: {answer['error']}")
        return answer

    def close(self):
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait(10)
        self._process.stdout.close()


def run_isoscope(binaries, *arguments, timeout=120, **options):
    """One command, to its end: subprocess.CompletedProcess."""
    command = [str(binaries / "isoscope"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=timeout, **options)


@dataclasses.dataclass(frozen=True)
class AgentDraw:
    """The flags of an agent that may not show in its answers."""

    threads: int = 1
    limit_mib: int = MEMORY_LIMIT_MIB


def draw_agents(seed, topology, least_mib):
    """{agent: its draw}. Replicas take turns with the threads; limits are log-uniform from the least to the usual."""
    chance = random.Random(seed)
    least = min(max(least_mib, LEAST_AGENT_MIB), MEMORY_LIMIT_MIB)
    draws = {}
    for agent in topology.agents():
        shard, replica = map(int, agent[1:].split("."))
        limit = least * (MEMORY_LIMIT_MIB / least) ** chance.random()
        # Half of the agents have the least: there memory is tight.
        draws[agent] = AgentDraw(
            AGENT_THREADS[(shard + replica) % len(AGENT_THREADS)], least if chance.random() < 0.5 else math.ceil(limit)
        )
    return draws


class Cluster:
    """The processes, their data and the links between them."""

    NAME = "flow"  # of the dataset

    def __init__(self, topology, binaries, folder, seed, is_tls, on_finding):
        self.topology, self.binaries, self.folder = topology, binaries, folder
        self.is_tls = is_tls
        self._on_finding = on_finding  # (kind, sentence)
        self._ports = Ports(seed)
        self._seed = seed
        self.draws = {}
        self._watching = threading.Event()
        self._watcher = None
        self.tls = folder / "tls"
        self.processes = {}
        self.link_ports = {}
        self.proxy = None
        self.locks = {}

    # Data.

    def make_data(self):
        volumes = {"volume": ("mixing", 1), "other": ("mixing", 2)}
        dims = "56,48,40"
        for name, (field, seed) in volumes.items():
            self._must("generate", field, "--dims", dims, "--type", "uint8", "--seed", seed, "--waves", 24,
                       "--output", self.folder / f"{name}.nrrd")  # fmt: skip
        shards = self.topology.shards
        for place, volume, count in (
            ("right", "volume", shards),
            ("other", "other", max(shards, 2)),
            ("recut", "volume", shards + 1),
        ):
            (self.folder / place).mkdir()
            self._must("partition", self.folder / f"{volume}.nrrd", "--output", self.folder / place / self.NAME,
                       "--shards", count)  # fmt: skip
        for agent in self.topology.agents():
            shutil.copytree(self.shard("right", self.shard_of(agent)), self.own_shard(agent))
        if self.is_tls:
            subprocess.run(
                ["bash", ROOT / "scripts/make_certificates.sh", self.tls], check=True, stdout=subprocess.DEVNULL
            )

    def _must(self, *arguments):
        done = run_isoscope(self.binaries, *arguments)
        if done.returncode != 0:
            raise HarnessError(f"isoscope {arguments}: {done.stderr}")

    def shard_of(self, agent):
        return int(agent[1:].split(".")[0])

    def shard(self, place, index):
        folders = sorted((self.folder / place / self.NAME).glob("shard-*"))
        return folders[index]

    def own_shard(self, agent):
        return self.folder / "agents" / agent / self.shard("right", self.shard_of(agent)).name

    # Processes.

    def _tls_flags(self, party):
        if not self.is_tls:
            return []
        return ["--tls-cert", self.tls / f"{party}.pem", "--tls-key", self.tls / f"{party}.key",
                "--tls-ca", self.tls / "ca.pem"]  # fmt: skip

    def agent_argv(self, port, *shards, draw=AgentDraw()):
        return [str(word) for word in (
            self.binaries / "isoscope-agent", *shards, "--listen", f"127.0.0.1:{port}", "--renderer", "cpu",
            "--threads", draw.threads, "--memory-limit", f"{draw.limit_mib}MiB", "--drain-seconds", DRAIN_S,
            *self._tls_flags("agent"),
        )]  # fmt: skip

    def _coordinator_argv(self, port, agent_ports):
        return [str(word) for word in (
            self.binaries / "isoscope-coordinator", "--listen", f"127.0.0.1:{port}",
            *(f"--agent=127.0.0.1:{agent}" for agent in agent_ports), "--poll-seconds", 0.25,
            "--max-frame-seconds", MAX_FRAME_S, "--memory-limit", f"{MEMORY_LIMIT_MIB}MiB", "--drain-seconds", DRAIN_S,
            *self._tls_flags("coordinator"),
        )]  # fmt: skip

    def _add(self, name, argv, port, limit_mib=MEMORY_LIMIT_MIB):
        self.processes[name] = Process(name, argv, port, self.folder, self._note_exit, limit_mib)

    def _note_exit(self, name, code, tail):
        self._on_finding("exit", f"{name} ended with {code}, which nobody asked for: {tail}")

    def _open_link(self, name, port):
        self.link_ports[name] = self._ports.take()
        self.proxy("open", link=name, port=self.link_ports[name], to=port)

    def start(self, least_agent_mib=LEAST_AGENT_MIB):
        """`least_agent_mib`: the least memory limit with which an agent can answer every request."""
        self.proxy = ProxyClient()
        self.draws = draw_agents(self._seed, self.topology, least_agent_mib)
        for agent, draw in self.draws.items():
            port = self._ports.take()
            self._add(agent, self.agent_argv(port, self.own_shard(agent), draw=draw), port, draw.limit_mib)
        for coordinator in self.topology.coordinator_names():
            links = [f"{coordinator}>{agent}" for agent in self.topology.agents()]
            for link, agent in zip(links, self.topology.agents()):
                self._open_link(link, self.processes[agent].port)
            port = self._ports.take()
            self._add(coordinator, self._coordinator_argv(port, [self.link_ports[link] for link in links]), port)
            self._open_link(f"client>{coordinator}", port)
        for process in self.processes.values():
            process.start(wait=False)
        for process in self.processes.values():
            if not process.wait_until_up():
                raise HarnessError(f"{process.name} did not start: {process.tail()}")
        self.locks = {name: threading.Lock() for name in self.processes}
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    def _watch(self):
        while not self._watching.wait(0.2):
            for process in self.processes.values():
                process.check()

    @contextlib.contextmanager
    def reference(self, shards):
        """A quiet cluster of one agent that serves these shards: the address of its coordinator."""
        agent_port, port = self._ports.take(), self._ports.take()
        folders = [self.shard("right", index) for index in shards]
        agent = Process("reference-agent", self.agent_argv(agent_port, *folders), agent_port, self.folder,
                        self._note_exit)  # fmt: skip
        coordinator = Process("reference-coordinator", self._coordinator_argv(port, [agent_port]), port, self.folder,
                              self._note_exit)  # fmt: skip
        try:
            for process in (agent, coordinator):
                process.start()
            yield f"127.0.0.1:{port}"
        finally:
            for process in (coordinator, agent):
                process.kill()

    def address(self, coordinator, is_direct=False):
        """Where clients find a coordinator: through the harness's proxy, or not."""
        port = self.processes[coordinator].port if is_direct else self.link_ports[f"client>{coordinator}"]
        return f"127.0.0.1:{port}"

    def end(self):
        """Ends all; each must end in time with 0."""
        self._watching.set()
        if self._watcher:
            self._watcher.join()
        for process in self.processes.values():
            process.check()
            process.resume()
            if problem := process.drain():
                self._on_finding("end", problem)
        if self.proxy:
            self.proxy.close()

    def kill_all(self):
        """The way out after an error of the harness."""
        self._watching.set()
        for process in self.processes.values():
            process.kill()
        if self.proxy:
            self.proxy.close()
