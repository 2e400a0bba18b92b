#!/usr/bin/env python3
"""Tries metrics and alert rules with a real Prometheus, on this machine.

    deploy/observability/prometheus_trial.py [FOLDER]

FOLDER holds the programs of Isoscope (default: build/release/bin). Starts two agents, a coordinator,
a gateway and Prometheus on free ports of 127.0.0.1, renders some frames, asks Prometheus for what it
has seen, then kills an agent and waits until Prometheus sees that, too. Ends all of them.

Exit code: 0 if Prometheus saw everything, 1 if not, 77 if `prometheus` or `promtool` is missing.
"""

import json
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests" / "support"))
import skips  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
PATIENCE_SECONDS = 120
FRAMES = 3

CONFIG = """
global: {{scrape_interval: 1s, evaluation_interval: 1s}}
rule_files: ["{rules}"]
scrape_configs:
  - job_name: isoscope-coordinator
    static_configs: [{{targets: ["{coordinator}"]}}]
  - job_name: isoscope-agent
    static_configs: [{{targets: ["{agent0}", "{agent1}"]}}]
  - job_name: isoscope-gateway
    static_configs: [{{targets: ["{gateway}"]}}]
"""


class Server:
    """A program, its log, and the addresses that it printed."""

    def __init__(self, folder, name, argv, started=None):
        self.name = name
        self.log = folder / f"{name}.log"
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(argv, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        if started is not None:
            self.address = self.find(rf" {started} .*?address=(\S+)")
            self.metrics = self.find(r" metrics_started address=(\S+)")

    def find(self, pattern):
        end = time.monotonic() + PATIENCE_SECONDS
        while time.monotonic() < end:
            found = re.search(pattern, self.log.read_text(errors="replace"))
            if found:
                return found.group(1)
            if self.process.poll() is not None:
                break
            time.sleep(0.05)
        sys.exit(f"{self.name} did not start:\n{self.log.read_text(errors='replace')}")


class Prometheus:
    """Asks a Prometheus on this machine."""

    def __init__(self, port):
        self.url = f"http://127.0.0.1:{port}"

    def get(self, path, **parameters):
        query = urllib.parse.urlencode(parameters)
        with urllib.request.urlopen(f"{self.url}{path}?{query}", timeout=60) as answer:
            return json.load(answer)["data"]

    def value(self, expression):
        """The value of an expression with one series; None without a series."""
        result = self.get("/api/v1/query", query=expression)["result"]
        return float(result[0]["value"][1]) if len(result) == 1 else None

    def wait_for(self, expression, is_right):
        end = time.monotonic() + PATIENCE_SECONDS
        value = None
        while time.monotonic() < end:
            try:
                value = self.value(expression)
            except (urllib.error.URLError, ConnectionError):
                pass  # it has just been started
            if value is not None and is_right(value):
                print(f"{expression} = {value:g}")
                return
            time.sleep(0.2)
        sys.exit(f"{expression} is {value} after {PATIENCE_SECONDS} s")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def start_cluster(folder, programs):
    volume, dataset = folder / "v.nrrd", folder / "v"
    isoscope = programs / "isoscope"
    subprocess.run([isoscope, "generate", "gyroid", "--dims", "48,48,48", "--type", "uint8", "--output", volume],
                   check=True, stdout=subprocess.DEVNULL)
    subprocess.run([isoscope, "partition", volume, "--output", dataset, "--shards", "2"], check=True,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    listen = ["--listen", "127.0.0.1:0", "--metrics-listen", "0"]
    servers = {}
    for i, shard in enumerate(sorted(dataset.glob("shard-*"))):
        servers[f"agent{i}"] = Server(
            folder, f"agent{i}",
            [programs / "isoscope-agent", shard, "--renderer", "cpu", "--threads", "1", *listen], "agent_started")
    servers["coordinator"] = Server(
        folder, "coordinator",
        [programs / "isoscope-coordinator", "--agent", servers["agent0"].address, "--agent", servers["agent1"].address,
         *listen], "coordinator_started")
    servers["coordinator"].find(r" (dataset_ready) ")
    servers["gateway"] = Server(
        folder, "gateway", [programs / "isoscope-gateway", "--server", servers["coordinator"].address, *listen],
        "gateway_started")
    return servers


def try_all(folder, programs, servers):
    servers.update(start_cluster(folder, programs))
    port = free_port()
    config = folder / "prometheus.yml"
    config.write_text(CONFIG.format(
        rules=HERE / "alerts.yml", coordinator=servers["coordinator"].metrics, gateway=servers["gateway"].metrics,
        agent0=servers["agent0"].metrics, agent1=servers["agent1"].metrics))
    subprocess.run(["promtool", "check", "config", config], check=True, stdout=subprocess.DEVNULL)
    servers["prometheus"] = Server(
        folder, "prometheus",
        ["prometheus", f"--config.file={config}", f"--storage.tsdb.path={folder / 'tsdb'}",
         f"--web.listen-address=127.0.0.1:{port}"])
    prometheus = Prometheus(port)
    for i in range(FRAMES):
        subprocess.run([programs / "isoscope", "render", "--server", servers["coordinator"].address, "--isovalue", "127.5",
                        "--azimuth", str(10 * i), "--width", "64", "--height", "64", "--output", folder / "p.png"],
                       check=True, stdout=subprocess.DEVNULL)
    with urllib.request.urlopen(f"http://{servers['gateway'].address}/healthz", timeout=60) as answer:
        assert answer.status == 200

    prometheus.wait_for('sum(up{job=~"isoscope-.*"})', lambda v: v == 4)
    prometheus.wait_for("count(isoscope_build_info)", lambda v: v == 4)
    prometheus.wait_for('isoscope_frames_total{outcome="done"}', lambda v: v == FRAMES)
    prometheus.wait_for("sum(isoscope_frame_duration_seconds_count)", lambda v: v == FRAMES)
    prometheus.wait_for('sum(isoscope_agent_frames_total{outcome="done"})', lambda v: v == 2 * FRAMES)
    prometheus.wait_for("sum(isoscope_agent_triangles_total)", lambda v: v > 0)
    prometheus.wait_for('sum(isoscope_cache_lookups_total{cache="meshes", result="hit"})', lambda v: v > 0)
    prometheus.wait_for('isoscope_http_requests_total{status="200"}', lambda v: v >= 1)
    prometheus.wait_for('isoscope_agents{state="reachable"}', lambda v: v == 2)

    servers["agent1"].process.kill()
    prometheus.wait_for('isoscope_agents{state="unreachable"}', lambda v: v == 1)
    prometheus.wait_for('isoscope_datasets{state="incomplete"}', lambda v: v == 1)
    prometheus.wait_for('count(ALERTS{alertname="IsoscopeAgentUnreachable", alertstate="pending"})', lambda v: v == 1)
    broken = [rule["name"] for group in prometheus.get("/api/v1/rules")["groups"] for rule in group["rules"]
              if rule["health"] != "ok"]
    if broken:
        sys.exit(f"rules that Prometheus can't evaluate: {broken}")


def main():
    missing = [name for name in ("prometheus", "promtool") if shutil.which(name) is None]
    if missing:
        skips.skip_program("prometheus", f"{', '.join(missing)} not found; on Debian: apt-get install prometheus")
    programs = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else HERE.parents[1] / "build/release/bin").resolve()
    servers = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            try_all(pathlib.Path(folder), programs, servers)
        finally:
            for server in servers.values():
                server.process.kill()
            for server in servers.values():
                server.process.wait()
    print("Prometheus saw everything")
    return 0


if __name__ == "__main__":
    sys.exit(main())
