"""The schedule of faults: a pure function of the seed and the topology.

Faults come at random, `rate` a second in the mean, at most `at_once` at a time, and never two on one
target at a time: who is dead can't be stopped. They are dealt in storms; between two storms nothing
is wrong, and quiet.py looks. The times are seconds from the begin of the storm.
"""

import dataclasses
import random


@dataclasses.dataclass(frozen=True)
class Topology:
    """The cluster: each of `replicas` agents serves each of `shards`; all coordinators know all agents."""

    shards: int = 2
    replicas: int = 2
    coordinators: int = 2

    def agents(self):
        return [f"a{shard}.{replica}" for shard in range(self.shards) for replica in range(self.replicas)]

    def coordinator_names(self):
        return [f"c{index}" for index in range(self.coordinators)]

    def agent_links(self):
        return [f"{c}>{a}" for c in self.coordinator_names() for a in self.agents()]

    def client_links(self):
        return [f"client>{c}" for c in self.coordinator_names()]


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of fault: who is hit, how often beside the others, for how long (seconds), and how it is told."""

    target: str
    weight: float
    duration_s: tuple[float, float]
    tells: str


# Durations are short beside the deadlines of load.py, or as long: both must be right.
KINDS = {
    "kill_agent": Kind("agent", 3, (0.0, 1.5), "SIGKILL; started again after the time"),
    "kill_coordinator": Kind("coordinator", 1.5, (0.0, 0.8), "SIGKILL; started again after the time"),
    "stop_agent": Kind("agent", 3, (0.05, 1.5), "SIGSTOP, SIGCONT after the time"),
    "stop_coordinator": Kind("coordinator", 1.5, (0.05, 1.0), "SIGSTOP, SIGCONT after the time"),
    "restart_agent": Kind("agent", 2, (0.0, 0.0), "SIGKILL and started at once"),
    "restart_coordinator": Kind("coordinator", 1, (0.0, 0.0), "SIGKILL and started at once"),
    "drain_agent": Kind("agent", 2, (0.0, 1.0), "SIGTERM; must end with 0; started again after the time"),
    "drain_coordinator": Kind("coordinator", 1, (0.0, 0.5), "SIGTERM; must end with 0; started again after the time"),
    "cut_agent_link": Kind("agent_link", 2, (0.0, 1.0), "connections reset, new ones refused for the time"),
    "delay_agent_link": Kind("agent_link", 1.5, (0.2, 2.0), "each piece of data waits, 5 to 200 ms"),
    "throttle_agent_link": Kind("agent_link", 1.5, (0.2, 2.0), "20 to 400 KB a second"),
    "blackhole_agent_link": Kind("agent_link", 2, (0.1, 2.0), "connections stay, no byte moves for the time"),
    "corrupt_agent_link": Kind("agent_link", 2.5, (0.2, 2.0), "a bit flips every 2 to 200 KB, both ways"),
    "cut_client_link": Kind("client_link", 1, (0.0, 0.5), "connections reset, new ones refused for the time"),
    "delay_client_link": Kind("client_link", 1, (0.2, 1.5), "each piece of data waits, 5 to 200 ms"),
    "throttle_client_link": Kind("client_link", 1, (0.2, 1.5), "20 to 400 KB a second"),
    "blackhole_client_link": Kind("client_link", 1, (0.1, 1.5), "connections stay, no byte moves for the time"),
    "corrupt_client_link": Kind("client_link", 1.5, (0.2, 1.5), "a bit flips every 2 to 200 KB, both ways"),
    "flip_blocks": Kind("agent", 2.5, (0.2, 2.0), "bits of blocks.bin flip in place; half of the agents start anew"),
    "flip_pages": Kind("agent", 1.5, (0.2, 2.0), "bits of the interval tree flip; half of the agents start anew"),
    "flip_tables": Kind("agent", 1.5, (0.2, 1.5), "bits of another file of the shard flip, and the agent starts anew"),
    "skew_dataset": Kind("agent", 1, (0.3, 1.5), "the agent comes back with another volume under the same name"),
    "skew_shards": Kind("agent", 1, (0.3, 1.5), "the agent comes back with the volume in another number of shards"),
    "full_log": Kind("agent", 0.5, (0.3, 1.5), "the agent comes back with its log on a full device"),
    "full_disk": Kind("disk", 0.5, (0.0, 0.0), "partition, render and export onto a file system without room"),
}

# Those that a replica must hide: whatever befalls one agent, or its link, while the rest is well.
HIDDEN_BY_REPLICAS = tuple(name for name, kind in KINDS.items() if kind.target in ("agent", "agent_link"))


@dataclasses.dataclass(frozen=True)
class Fault:
    """One fault. `seed` decides what else there is to choose: bits, delays, rates."""

    number: int
    storm: int
    start_s: float
    kind: str
    target: str
    duration_s: float
    seed: int

    def __str__(self):
        return (
            f"{self.number:5d}  storm {self.storm:3d}  {self.start_s:7.2f} s  {self.kind:22s} {self.target:12s}"
            f" for {self.duration_s:.2f} s"
        )


def targets_of(topology: Topology) -> dict[str, list[str]]:
    return {
        "agent": topology.agents(),
        "coordinator": topology.coordinator_names(),
        "agent_link": topology.agent_links(),
        "client_link": topology.client_links(),
        "disk": ["disk"],
    }


def make_schedule(seed, count, topology, kinds=None, rate=2.0, at_once=3, per_storm=100, settle_s=0.5):
    """The faults in order of their numbers.

    at_once=1 makes a calm schedule: one fault at a time, `settle_s` after the end of the one before.
    """
    names = sorted(kinds or KINDS)
    unknown = [name for name in names if name not in KINDS]
    if unknown:
        raise ValueError(f"no kind of fault: {', '.join(unknown)}; there are {', '.join(sorted(KINDS))}")
    if count < 0 or rate <= 0 or at_once < 1 or per_storm < 1:
        raise ValueError(f"faults {count}, rate {rate}, at once {at_once}, in a storm {per_storm}: out of range")
    chance = random.Random(seed)
    targets = targets_of(topology)
    faults = []
    now, ends = 0.0, []  # ends: (time, target) of the faults in work
    for number in range(count):
        if number % per_storm == 0:
            now, ends = 0.0, []
        now += chance.expovariate(rate)
        kind = chance.choices(names, [KINDS[name].weight for name in names])[0]
        duration = round(chance.uniform(*KINDS[kind].duration_s), 3)
        target = chance.choice(targets[KINDS[kind].target])
        # Until there is room for one more, and this target is well.
        while True:
            ends = [(end, whom) for end, whom in ends if end > now]
            waits = [end for end, whom in ends if whom == target]
            if not waits and len(ends) < at_once:
                break
            now = max(waits) if waits else min(end for end, _ in ends)
        # Processes take a moment to start after a fault has ended.
        ends.append((now + duration + settle_s, target))
        faults.append(
            Fault(number, number // per_storm, round(now, 3), kind, target, duration, chance.getrandbits(32))
        )
    return faults
