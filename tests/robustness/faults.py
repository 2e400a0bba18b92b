"""Carries faults out, and heals them. One thread for each fault in work; targets are locked one by one."""

import concurrent.futures
import json
import random
import subprocess
import sys
import threading
import time

from robustness.cluster import HERE, HarnessError

# Files of a shard that are verified when it is opened: an agent must not start with a flipped bit in one of them.
OPENED = ("block_index.bin", "ranges.bin", "manifest.json", "shard.json")


def flip_bits(path, pristine, bits, chance):
    """Flips bits of a file in place, from what `pristine` has. Returns how many bytes differ now."""
    data = bytearray(pristine)
    for _ in range(bits):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    overwrite(path, data)
    return sum(a != b for a, b in zip(data, pristine))


def overwrite(path, data):
    """In place: who has the file open sees it."""
    with open(path, "r+b") as file:
        file.write(data)


class Injector:
    """Carries out schedules against a cluster."""

    def __init__(self, cluster, episodes, report, on_finding):
        self._cluster, self._episodes, self._report = cluster, episodes, report
        self._on_finding = on_finding
        self._locks = {}
        self._guard = threading.Lock()

    def run_storm(self, faults):
        """Returns when all of them are healed."""
        begin = time.monotonic()
        with concurrent.futures.ThreadPoolExecutor(16) as threads:
            futures = []
            for fault in faults:
                time.sleep(max(0.0, begin + fault.start_s - time.monotonic()))
                futures.append(threads.submit(self.carry_out, fault))
            for future in futures:
                future.result()

    def carry_out(self, fault):
        with self._guard:
            lock = self._locks.setdefault(fault.target, threading.Lock())
        with lock:
            episode = self._episodes.begin(fault.kind, fault.target, time.monotonic())
            try:
                act = getattr(self, f"_{fault.kind}", None) or getattr(self, "_" + fault.kind.split("_")[0])
                episode.note = act(fault, random.Random(fault.seed)) or ""
            finally:
                self._episodes.end(episode, time.monotonic())
        self._report.add_fault(fault, episode)

    # Processes.

    def _process(self, fault):
        return self._cluster.processes[fault.target]

    def _kill(self, fault, _):
        process = self._process(fault)
        process.kill()
        time.sleep(fault.duration_s)
        self._start(process)

    _restart = _kill

    def _stop(self, fault, _):
        process = self._process(fault)
        process.stop()
        time.sleep(fault.duration_s)
        process.resume()

    def _drain(self, fault, _):
        process = self._process(fault)
        if problem := process.drain():
            self._on_finding("drain", problem)
        time.sleep(fault.duration_s)
        self._start(process)

    def _start(self, process, **how):
        process.kill()  # nothing, unless it crashed and was started again meanwhile
        process.may_fail = False
        process.start(**how, wait=False)
        if not process.wait_until_up():
            process.kill()
            self._on_finding("start", f"{process.name} did not start: {process.tail()}")
            process.start()

    # Links.

    def _link(self, fault, begin, end):
        self._cluster.proxy("set", link=fault.target, **begin)
        time.sleep(fault.duration_s)
        self._cluster.proxy("set", link=fault.target, **end)

    def _cut(self, fault, _):
        self._cluster.proxy("set", link=fault.target, refuse=True)
        self._cluster.proxy("cut", link=fault.target)
        time.sleep(fault.duration_s)
        self._cluster.proxy("set", link=fault.target, refuse=False)

    def _delay(self, fault, chance):
        self._link(fault, {"delay_s": chance.uniform(0.005, 0.2)}, {"delay_s": 0})

    def _throttle(self, fault, chance):
        self._link(fault, {"bytes_per_s": chance.uniform(20e3, 400e3)}, {"bytes_per_s": 0})

    def _blackhole(self, fault, chance):
        self._link(fault, {"stalled": True}, {"stalled": False})
        if chance.random() < 0.5:  # the other half goes on where it was
            self._cluster.proxy("cut", link=fault.target)

    def _corrupt(self, fault, chance):
        every = 2000 * 100 ** chance.random()
        self._link(fault, {"flip_every": every, "seed": fault.seed}, {"flip_every": 0})

    # Shards.

    def _damage(self, fault, chance, file, bits, is_anew):
        """Flips bits of the agent's own copy for a while; `is_anew`: it opens them so."""
        process = self._process(fault)
        path = self._cluster.own_shard(fault.target) / file
        right = self._cluster.shard("right", self._cluster.shard_of(fault.target)) / file
        pristine = right.read_bytes()
        if is_anew:
            process.kill()
        flipped = flip_bits(path, pristine, bits, chance)
        is_up = True
        if is_anew:
            process.may_fail = True
            process.start(wait=False)
            is_up = process.wait_until_up()
        if is_up and is_anew and flipped and file in OPENED:
            self._on_finding("damage", f"{fault}: the agent serves although {flipped} bytes of {file} are damaged")
        time.sleep(fault.duration_s)
        if is_up and chance.random() < 0.5:
            overwrite(path, pristine)  # must be well again without a restart
            process.may_fail = False
        else:
            process.kill()
            overwrite(path, pristine)
            self._start(process)
        return f"{file}, {flipped} bytes"

    def _flip_blocks(self, fault, chance):
        return self._damage(fault, chance, "blocks.bin", chance.choice((1, 8, 64, 512)), chance.random() < 0.5)

    def _flip_pages(self, fault, chance):
        return self._damage(fault, chance, "interval_tree.bin", chance.choice((1, 8, 64)), chance.random() < 0.5)

    def _flip_tables(self, fault, chance):
        return self._damage(fault, chance, chance.choice((*OPENED, "histogram.bin")), chance.choice((1, 2, 8)), True)

    # Replicas that serve something else.

    def _skew(self, fault, _):
        cluster, process = self._cluster, self._process(fault)
        place = "other" if fault.kind == "skew_dataset" else "recut"
        process.kill()
        shard = cluster.shard(place, cluster.shard_of(fault.target))
        self._start(process, argv=cluster.agent_argv(process.port, shard, draw=cluster.draws[fault.target]))
        time.sleep(fault.duration_s)
        process.kill()
        self._start(process)

    # Disks.

    def _full_log(self, fault, _):
        process = self._process(fault)
        process.kill()
        self._start(process, log="/dev/full")
        time.sleep(fault.duration_s)
        process.kill()
        self._start(process)

    def _full_disk(self, fault, _):
        """disk_trial.py, in a name space of its own where it may mount a small file system."""
        trial = [sys.executable, HERE / "disk_trial.py", self._cluster.binaries, self._cluster.folder, str(fault.seed)]
        last = ""
        for command in (["unshare", "--user", "--map-root-user", "--mount", *trial, "tmpfs"], [*trial, "limit"]):
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=120, stdin=subprocess.DEVNULL)
            except OSError as error:
                last = str(error)
                continue
            if done.returncode == 77:  # no file system may be mounted here
                last = done.stderr
                continue
            if done.returncode != 0:
                if command[0] == "unshare" and done.stderr.startswith("unshare:"):
                    last = done.stderr
                    continue
                raise HarnessError(f"disk_trial.py: {done.stderr}")
            result = json.loads(done.stdout)
            for problem in result["problems"]:
                self._on_finding("disk", f"{fault}: {problem}")
            return result["note"]
        return f"skipped: {last.strip()}"
