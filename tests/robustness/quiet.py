"""Between storms nothing is wrong: the cluster must be well soon, right again, and idle."""

import time

from robustness.model import AFTERMATH_S
from robustness.pool import Client, cluster_pb2, grpc

WELL_AFTER_S = 15.0
IDLE_AFTER_S = 6.0
DEADLINE_S = 20.0
MAX_DESCRIPTORS = 256


class Quiet:
    """Looks at a cluster without faults and load."""

    def __init__(self, cluster, pool, load, judge, report, on_finding):
        self._cluster, self._pool, self._load = cluster, pool, load
        self._judge, self._report, self._on_finding = judge, report, on_finding

    def check(self):
        tls = self._cluster.tls if self._cluster.is_tls else None
        for coordinator in self._cluster.topology.coordinator_names():
            client = Client(self._cluster.address(coordinator), tls)
            try:
                self._report.recovery_s.append(self._await_well(client, coordinator))
                self._ask_all(client, coordinator)
                self._await_idle(client, coordinator)
            finally:
                client.close()
        for process in self._cluster.processes.values():
            self._check_size(process.name, process.facts(), process.limit_mib)

    def _check_size(self, name, facts, limit_mib):
        """A process that is idle has its caches, its threads and some connections."""
        self._report.add_facts(name, facts)
        if facts.get("resident_bytes", 0) > limit_mib << 20:
            self._on_finding("memory", f"{name}: {facts['resident_bytes'] >> 20} MiB of {limit_mib} MiB")
        if facts.get("descriptors", 0) > MAX_DESCRIPTORS:
            self._on_finding("descriptors", f"{name} has {facts['descriptors']}, more than {MAX_DESCRIPTORS}")

    def _await_well(self, client, coordinator):
        """Seconds until a frame is exact again."""
        begin = time.monotonic()
        while True:
            answer = self._load.ask(client, self._pool[0], coordinator, DEADLINE_S)
            took = time.monotonic() - begin
            if answer.code == "OK":
                return took
            if took > WELL_AFTER_S:
                self._on_finding("not well", f"{coordinator} {took:.1f} s after the storm: {answer.message}")
                return took
            time.sleep(0.05)

    def _ask_all(self, client, coordinator):
        """Judges answers from caches that were filled during the storm; no fault excuses an error any more."""
        time.sleep(AFTERMATH_S)
        for request in self._pool:
            answer = self._load.ask(client, request, coordinator, DEADLINE_S)
            self._judge.judge(answer)
            self._report.add(answer)

    def _await_idle(self, client, coordinator):
        """Nobody asks: coordinator and agents must have no frame in work."""
        end = time.monotonic() + IDLE_AFTER_S
        while True:
            try:
                status = client.cluster.GetClusterStatus(cluster_pb2.GetClusterStatusRequest(), timeout=DEADLINE_S)
                busy = [f"{agent.address}: {agent.load.working_frame_count}" for agent in status.agents
                        if agent.load.working_frame_count]  # fmt: skip
                lost = [f"{agent.address}: {agent.message}" for agent in status.agents if agent.message]
                if status.load.working_frame_count or status.load.queued_frame_count or status.frames:
                    busy.append(f"itself: {status.load.working_frame_count} + {status.load.queued_frame_count}")
                problem = f"busy: {busy}, not well: {lost}" if busy or lost else ""
            except grpc.RpcError as error:
                problem = f"no status: {error.code().name} {error.details()}"
            if not problem:
                return
            if time.monotonic() > end:
                self._on_finding("not idle", f"{coordinator}, {IDLE_AFTER_S} s after the last answer: {problem}")
                return
            time.sleep(0.2)
