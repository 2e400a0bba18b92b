"""Threads that ask all the time, each with connections of its own, and have every answer judged."""

import random
import threading
import time

from robustness.model import Answer
from robustness.pool import Client, FrameFailed, grpc

# A deadline that most faults outlast, and one that most end in.
DEADLINES_S = (1.0, 2.5, 5.0)
# A call without its own deadline: the server's limit applies. The library would wait this long, which reveals a server
# that never answers.
PATIENCE_S = 60.0
PATIENT_SHARE = 0.2
PAUSE_AFTER_ERROR_S = 0.05


class Watchdog(threading.Thread):
    """Notes when this process, and so the machine, did not run."""

    def __init__(self, episodes):
        super().__init__(daemon=True)
        self._episodes = episodes
        self._ended = threading.Event()

    def run(self):
        last = time.monotonic()
        while not self._ended.wait(0.02):
            now = time.monotonic()
            if now - last > 0.15:
                self._episodes.stall(last, now)
            last = now

    def end(self):
        self._ended.set()
        self.join()


class Load:
    """`clients` threads. They run between resume() and pause()."""

    def __init__(self, clients, cluster, pool, judge, report, seed, max_frame_s, is_calm=False):
        self._cluster, self._pool, self._judge, self._report = cluster, pool, judge, report
        self._max_frame_s = max_frame_s
        # In a calm run no error is right, so no deadline is short.
        self._deadlines_s = (20.0,) if is_calm else DEADLINES_S
        self._patient_share = 0.0 if is_calm else PATIENT_SHARE
        self._running = threading.Event()
        self._ended = threading.Event()
        self._parked = threading.Barrier(clients + 1)
        self._threads = [
            threading.Thread(target=self._ask_all_the_time, args=(random.Random(seed * 1000 + number),), daemon=True)
            for number in range(clients)
        ]
        for thread in self._threads:
            thread.start()

    def resume(self):
        self._running.set()
        self._parked.wait()

    def pause(self):
        """Returns when every call has been answered."""
        self._running.clear()
        self._parked.wait(PATIENCE_S + 30)

    def end(self):
        """When paused."""
        self._ended.set()
        self._running.set()
        self._parked.wait()
        for thread in self._threads:
            thread.join(PATIENCE_S)

    def _ask_all_the_time(self, chance):
        tls = self._cluster.tls if self._cluster.is_tls else None
        clients = {}
        while True:
            self._running.wait()
            self._parked.wait()
            if self._ended.is_set():
                break
            while self._running.is_set():
                coordinator = chance.choice(self._cluster.topology.coordinator_names())
                request = chance.choice(self._pool)
                # A stream has no limit of its own.
                is_patient = chance.random() < self._patient_share and request.method != "Interact"
                key = (coordinator, is_patient)
                if key not in clients:
                    clients[key] = Client(self._cluster.address(coordinator, is_direct=is_patient), tls)
                deadline = None if is_patient else chance.choice(self._deadlines_s)
                answer = self.ask(clients[key], request, coordinator, deadline)
                self._judge.judge(answer)
                self._report.add(answer)
                if answer.code != "OK":
                    time.sleep(PAUSE_AFTER_ERROR_S)
            self._parked.wait()
        for client in clients.values():
            client.close()

    def ask(self, client, request, coordinator, deadline_s):
        """deadline_s: None leaves it to the server, asked directly."""
        begin = time.monotonic()
        answer = Answer(request.name, request.method, coordinator, begin, begin,
                        deadline_s or self._max_frame_s, "OK", is_direct=deadline_s is None)  # fmt: skip
        try:
            answer.digest, answer.missing = client.ask(request, deadline_s or PATIENCE_S)
        except grpc.RpcError as error:
            answer.code, answer.message = error.code().name, error.details() or ""
            metadata = error.trailing_metadata() if hasattr(error, "trailing_metadata") else None
            answer.request_id = dict(metadata or ()).get("x-request-id", "")
        except FrameFailed as error:
            answer.code, answer.message = error.code, error.message
        except Exception as error:  # an answer that can't be read is an answer, too
            answer.code, answer.message = "UNREADABLE", f"{type(error).__name__}: {error}"
        answer.end = time.monotonic()
        return answer
