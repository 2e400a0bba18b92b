#!/usr/bin/env python3
"""Real processes, faults by a seeded schedule, continuous load; every answer is judged. See docs/lab/robustness.md.

Exit codes: 0 no finding, 1 findings, 2 wrong usage, 3 the harness itself could not go on, 77 something is missing here.
"""

import argparse
import contextlib
import dataclasses
import pathlib
import shutil
import signal
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import robustness  # noqa: E402

try:
    from robustness import documented, model, pool, report, schedule
    from robustness.cluster import MAX_FRAME_S, ROOT, Cluster, HarnessError
    from robustness.faults import Injector
    from robustness.load import Load, Watchdog
    from robustness.quiet import Quiet
except ImportError as error:
    robustness.try_another_python(error)


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Kinds of faults:\n" + "\n".join(f"  {name:22s} {kind.tells}" for name, kind in schedule.KINDS.items()),
    )  # fmt: skip
    add = parser.add_argument
    add("--seed", type=int, default=1, help="decides requests and faults (default: 1)")
    add("--faults", type=int, default=40, help="how many (default: 40)")
    add("--rate", type=float, default=2.0, help="faults a second in the mean (default: 2)")
    add("--at-once", type=int, default=3, help="faults at a time, at most (default: 3)")
    add("--storm", type=int, default=100, help="faults between two quiet checks (default: 100)")
    add("--kinds", help="only these kinds, separated by commas (default: all)")
    add("--calm", action="store_true", help="one agent at a time is hit, the rest is well: replicas must hide it, so "
        "every error is a finding")  # fmt: skip
    add("--shards", type=int, default=2, help="default: 2")
    add("--replicas", type=int, default=2, help="agents for each shard (default: 2)")
    add("--coordinators", type=int, default=2, help="default: 2")
    add("--clients", type=int, default=6, help="threads that ask (default: 6)")
    add("--plaintext", action="store_true", help="without TLS: bits that flip on the way may then alter answers")
    add("--partial", action="store_true", help="also frames that may lack shards (allow_partial)")
    add("--bin", type=pathlib.Path, default=ROOT / "build/release/bin", help="folder of the programs")
    add("--keep", type=pathlib.Path, help="new folder for data and logs; else a temporary one, kept after findings")
    add("--json", type=pathlib.Path, help="file for the report as JSON")
    add("--text", type=pathlib.Path, help="file for the report as text; it is printed, too")
    add("--schedule", action="store_true", help="only print the schedule")
    options = parser.parse_args(arguments)
    for name in ("shards", "replicas", "coordinators", "clients"):
        if not 1 <= getattr(options, name) <= 64:
            parser.error(f"--{name} {getattr(options, name)}: not in 1 to 64")
    if options.calm and options.replicas < 2:
        parser.error("--calm needs --replicas of at least 2")
    return options


def make_faults(options):
    topology = schedule.Topology(options.shards, options.replicas, options.coordinators)
    kinds = options.kinds.split(",") if options.kinds else None
    at_once, settle = options.at_once, 0.5
    if options.calm:
        kinds, at_once, settle = kinds or schedule.HIDDEN_BY_REPLICAS, 1, 2.5
    return topology, schedule.make_schedule(
        options.seed, options.faults, topology, kinds, options.rate, at_once, options.storm, settle
    )


def make_references(cluster, requests, with_partial):
    """{(request, missing shards): digest}, from quiet clusters of one agent."""
    shards = range(cluster.topology.shards)
    tls = cluster.tls if cluster.is_tls else None
    partial = pool.with_partial(requests)
    references = {}
    with cluster.reference(shards) as address, contextlib.closing(pool.Client(address, tls)) as client:
        for name, digest in pool.make_references(client, requests).items():
            references[name, ()] = digest
    if not with_partial:
        return references
    for request in partial:
        references[request.name, ()] = references[request.reference, ()]
    for missing in shards if len(shards) > 1 else ():
        with cluster.reference([s for s in shards if s != missing]) as address:
            with contextlib.closing(pool.Client(address, tls)) as client:
                for request in partial:
                    digest, found = client.ask(request, 60)
                    if found != (missing,):
                        raise HarnessError(f"{request.name} without shard {missing} says that {found} are missing")
                    references[request.name, found] = digest
    return references


def storms(faults):
    """The faults of each storm."""
    count = faults[-1].storm + 1 if faults else 0
    return [[fault for fault in faults if fault.storm == number] for number in range(count)]


class Run:
    """One run of the harness."""

    def __init__(self, options, topology, folder):
        self.options, self.topology, self.folder = options, topology, folder
        self.report = report.Report()
        self.episodes = model.Episodes()
        self.cluster = Cluster(topology, options.bin, folder, options.seed, not options.plaintext, self.report.find)

    def execute(self, faults):
        self.cluster.make_data()
        requests = pool.make_pool(self.options.seed, Cluster.NAME)
        references = make_references(self.cluster, requests, self.options.partial)
        if self.options.partial:
            requests += pool.with_partial(requests)
        documented_codes = documented.load()
        if self.options.calm:
            documented_codes = {}  # replicas hide everything: no code is right
        judge = model.Judge(references, documented_codes, self.episodes, self.options.plaintext)
        self.cluster.start(pool.least_agent_mib(requests))
        watchdog = Watchdog(self.episodes)
        watchdog.start()
        load = Load(self.options.clients, self.cluster, requests, judge, self.report, self.options.seed, MAX_FRAME_S,
                    is_calm=self.options.calm)  # fmt: skip
        quiet = Quiet(self.cluster, requests, load, judge, self.report, self.report.find)
        injector = Injector(self.cluster, self.episodes, self.report, self.report.find)
        quiet.check()
        for number, storm in enumerate(storms(faults)):
            load.resume()
            injector.run_storm(storm)
            load.pause()
            quiet.check()
            if self.options.json:  # so far
                report.write_json(self.options.json, self._data())
            totals = self.report.totals()
            print(f"storm {number}: {totals['faults']} faults, {totals['answers']} answers, {totals['exact']} exact, "
                  f"{totals['findings']} findings, {totals['seconds']:.0f} s; {self.report.codes()}", flush=True)  # fmt: skip
        load.end()
        data = self._data()
        self.cluster.end()
        watchdog.end()
        return {**data, **self.report.end_of_run()}

    def _data(self):
        flipped = self.cluster.proxy("counts")["flipped"]
        return self.report.to_json(self._described(), self.episodes.stalls(), flipped)

    def _described(self):
        options, topology = self.options, self.topology
        return {
            "seed": options.seed, "tls": not options.plaintext, "clients": options.clients, "calm": options.calm,
            "rate": options.rate, "at_once": options.at_once, "partial": options.partial,
            "topology": f"{topology.shards} shards x {topology.replicas} replicas, "
            f"{topology.coordinators} coordinators",
            "agents": {agent: dataclasses.asdict(draw) for agent, draw in self.cluster.draws.items()},
        }  # fmt: skip


def main(arguments=None):
    options = parse_arguments(arguments)
    try:
        topology, faults = make_faults(options)
    except ValueError as error:
        print(f"run.py: {error}", file=sys.stderr)
        return 2
    if options.schedule:
        print("\n".join(map(str, faults)))
        return 0
    if not (options.bin / "isoscope-coordinator").is_file():
        robustness.skips.skip_program("programs", f"none in {options.bin}: build them, or name their folder with --bin")
    if not options.plaintext and not shutil.which("openssl"):
        robustness.skips.skip_program("openssl", "it makes the certificates; on Debian: apt-get install openssl")
    if options.keep:
        options.keep.mkdir(parents=True)
    folder = options.keep or pathlib.Path(tempfile.mkdtemp(prefix="isoscope-robustness-"))
    run = Run(options, topology, folder.resolve())
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(3))  # and so ends what it started
    has_ended = False
    try:
        data = run.execute(faults)
        has_ended = True
    except HarnessError as error:
        print(f"run.py: the harness can't go on: {error}; data and logs: {folder}", file=sys.stderr)
        return 3
    finally:
        if not has_ended:
            run.cluster.kill_all()
    text = report.to_text(data)
    print(text)
    if options.text:
        options.text.write_text(text)
    if options.json:
        report.write_json(options.json, data)
    if data["totals"]["findings"]:
        print(f"data and logs: {folder}")
        return 1
    if not options.keep:
        shutil.rmtree(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
