#!/usr/bin/env python3
"""Keeps deploy/ honest: what its files say exists, and agrees.

    check_deploy.py PROGRAMS [-v] [TEST...]

PROGRAMS is the folder of the programs: every flag and variable in deploy/ must be in their --help. Checks whose tool
is missing are skipped and say so: kubectl (Debian: kubernetes-client), shellcheck, systemd-analyze, docker-compose.
Kubernetes objects are checked against their types if ISOSCOPE_KUBERNETES_MODELS names a folder in which
`npm install kubernetes-models` was run; that needs tsc and node (Debian: node-typescript nodejs).
Exits with 77 where Python lacks yaml (Debian: python3-yaml).
"""

import functools
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path[:0] = [str(pathlib.Path(__file__).resolve().parent), str(pathlib.Path(__file__).resolve().parents[1] / "support")]
import skips  # noqa: E402

try:
    import yaml
except ImportError:
    # Debian's packages are for Debian's Python.
    debian = "/usr/bin/python3"
    if sys.executable != debian and os.path.exists(debian):
        os.execv(debian, [debian, *sys.argv])
    skips.skip_program("python", "no yaml for this Python (Debian: python3-yaml)")

import programs as program_help  # noqa: E402

ROOT = program_help.ROOT
DEPLOY = ROOT / "deploy"
DOCUMENTS = [DEPLOY / "README.md", ROOT / "docs" / "deployment.md"]
OVERLAYS = ["overlays/try", "overlays/production"]
PROGRAMS: dict = {}

# Variables that deploy/ reads itself, by file. Everything else must be a program's.
OWN_VARIABLES = {
    "compose.yaml": {"ISOSCOPE_DATASET", "ISOSCOPE_PUBLISH", "ISOSCOPE_GATEWAY_PUBLISH", "ISOSCOPE_AGENT_MEMORY",
                     "ISOSCOPE_COORDINATOR_MEMORY", "ISOSCOPE_GATEWAY_MEMORY"},
    "compose.tls.yaml": {"ISOSCOPE_CERTIFICATES", "ISOSCOPE_USER"},
    "demo.yaml": {"ISOSCOPE_PUBLISH", "ISOSCOPE_GATEWAY_PUBLISH"},
    "swarm/stack.yaml": {"ISOSCOPE_DATASET", "ISOSCOPE_CERTIFICATES", "ISOSCOPE_REGISTRY", "ISOSCOPE_VERSION",
                         "ISOSCOPE_REPLICAS", "ISOSCOPE_COORDINATORS", "ISOSCOPE_GATEWAYS", "ISOSCOPE_KEYS",
                         "ISOSCOPE_AGENT_MEMORY", "ISOSCOPE_COORDINATOR_MEMORY"},
    "slurm/partition.sbatch": {"ISOSCOPE_BIN", "ISOSCOPE_PARTS"},
    "slurm/isoscope.sbatch": {"ISOSCOPE_BIN", "ISOSCOPE_INPUT", "ISOSCOPE_PARTITION_OPTIONS", "ISOSCOPE_SHARDS",
                              "ISOSCOPE_LOCAL", "ISOSCOPE_RUN", "ISOSCOPE_PORT", "ISOSCOPE_AGENT_PORT",
                              "ISOSCOPE_START_SECONDS", "ISOSCOPE_CERTIFICATES", "ISOSCOPE_DATASET"},
}


def need(*tools: str) -> None:
    for tool in tools:
        if shutil.which(tool) is None:
            skips.skip("deploy", f"no {tool}")


def files(*patterns: str) -> list[pathlib.Path]:
    return sorted(path for pattern in patterns for path in DEPLOY.rglob(pattern))


def output(*command, **options) -> str:
    run = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=120, **options)
    if run.returncode != 0:
        raise AssertionError(f"{' '.join(map(str, command))} ended with {run.returncode}:\n{run.stdout}{run.stderr}")
    return run.stdout


def all_variables() -> set[str]:
    return set().union(*(program.variables for program in PROGRAMS.values()))


def interpolated(text: str) -> str:
    """Compose's ${NAME:-default} with its defaults."""
    return re.sub(r"\$\{(\w+)(?::-([^}]*)|:\?[^}]*)?\}", lambda m: "x" if m.group(2) is None else m.group(2), text)


class TestPrograms(unittest.TestCase):
    """Flags and variables."""

    def test_every_flag_of_a_command_is_in_the_help(self):
        paths = files("*.yaml", "*.sh", "*.sbatch", "*.service", "*.conf", "*.md") + DOCUMENTS[1:]
        count = 0
        for path in filter(pathlib.Path.exists, paths):
            for name, flags in program_help.commands(path.read_text()):
                with self.subTest(path=str(path.relative_to(ROOT)), command=name):
                    if not flags:
                        continue  # or prose: "the user isoscope reads"
                    self.assertIn(name, PROGRAMS)
                    self.assertEqual(set(flags) - PROGRAMS[name].flags, set())
                    count += len(flags)
        self.assertGreater(count, 20)

    def test_every_variable_is_a_programs_or_the_files_own(self):
        known = all_variables()
        for path in files("*.yaml", "*.sh", "*.sbatch", "*.service", "*.env"):
            name = str(path.relative_to(DEPLOY))
            own = OWN_VARIABLES.get(name, set())
            with self.subTest(path=name):
                used = set(re.findall(r"\bISOSCOPE_[A-Z_]+\b", path.read_text()))
                self.assertEqual(used - known - own, set())
                self.assertEqual(own - used, set(), "in OWN_VARIABLES, but not used")

    def test_variables_of_documents_exist(self):
        own = set().union(*OWN_VARIABLES.values()) | {"ISOSCOPE_KUBERNETES_MODELS", "ISOSCOPE_DEPLOY_PACKAGES"}
        for path in filter(pathlib.Path.exists, DOCUMENTS):
            with self.subTest(path=path.name):
                used = set(re.findall(r"\bISOSCOPE_[A-Z_]+\b", path.read_text()))
                self.assertEqual(used - all_variables() - own, set())

    def test_environment_files_of_systemd_belong_to_their_program(self):
        for path in files("systemd/env/*.env"):
            program = PROGRAMS["isoscope-" + re.match(r"[a-z]+", path.name).group(0)]
            for name, value in re.findall(r"^#?(ISOSCOPE_\w+)=(.*)$", path.read_text(), re.MULTILINE):
                with self.subTest(path=path.name, variable=name):
                    self.assertIn(name, program.variables)

    def test_links_of_documents_lead_somewhere(self):
        for path in filter(pathlib.Path.exists, DOCUMENTS):
            for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", path.read_text()):
                if not target.startswith("http"):
                    with self.subTest(path=path.name, target=target):
                        self.assertTrue((path.parent / target).exists())


class TestShell(unittest.TestCase):
    """Scripts, and shell inside of YAML."""

    SCRIPTS = files("*.sh", "*.sbatch") + sorted((ROOT / "tests" / "deploy").glob("*.sh")) + [
        ROOT / "scripts" / f"{name}.sh" for name in ("swarm_test", "container_test", "package", "version")] + sorted(
        (ROOT / "cmake" / "debian").glob("*/p*"))

    def test_scripts_parse(self):
        for path in self.SCRIPTS:
            with self.subTest(path=path.name):
                output("bash", "-n", path)
                self.assertTrue(os.access(path, os.X_OK), "not executable")

    def test_shellcheck_finds_nothing(self):
        need("shellcheck")
        output("shellcheck", *self.SCRIPTS)

    def test_shell_in_kubernetes_parses(self):
        scripts = 0
        for path in files("kubernetes/**/*.yaml"):
            for script in re.findall(r"^( +)- \|\n((?:\1  .*\n|\n)+)", path.read_text(), re.MULTILINE):
                if "isoscope" in script[1] and "path:" not in script[1]:
                    output("bash", "-n", "-c", script[1])
                    scripts += 1
        self.assertGreaterEqual(scripts, 3)


class TestContainers(unittest.TestCase):
    """Compose and Swarm."""

    FILES = ["compose.yaml", "demo.yaml", "swarm/stack.yaml"]

    def services(self, name):
        return yaml.safe_load(interpolated((DEPLOY / name).read_text()))["services"]

    def test_variables_belong_to_the_program_of_the_image(self):
        for name in self.FILES:
            for service, spec in self.services(name).items():
                image = spec["image"].split(":")[0]
                if image not in PROGRAMS:
                    continue
                for variable in spec.get("environment", {}):
                    with self.subTest(file=name, service=service, variable=variable):
                        self.assertIn(variable, PROGRAMS[image].variables)

    def test_names_and_ports_of_dialled_services_exist(self):
        for name in self.FILES:
            services = self.services(name)
            known = set(services)
            for spec in services.values():
                networks = spec.get("networks", [])
                if isinstance(networks, dict):
                    known |= {alias for n in networks.values() for alias in (n or {}).get("aliases", [])}
            for service, spec in services.items():
                for key, port in (("ISOSCOPE_AGENT", 50052), ("ISOSCOPE_SERVER", 50051)):
                    target = spec.get("environment", {}).get(key)
                    if target:
                        with self.subTest(file=name, service=service, target=target):
                            host, said = target.replace("dns:///", "").split(":")
                            self.assertIn(host, known)
                            self.assertEqual(int(said), port)

    def test_published_ports_are_those_that_the_images_listen_on(self):
        dockerfile = (ROOT / "Dockerfile").read_text()
        for name in self.FILES:
            for service, spec in self.services(name).items():
                program = spec["image"].split(":")[0]
                for port in spec.get("ports", []):
                    target = port["target"] if isinstance(port, dict) else int(str(port).split(":")[-1])
                    with self.subTest(file=name, service=service):
                        self.assertEqual(target, PROGRAMS[program].port)
                        self.assertIn(f"EXPOSE {target}\n", dockerfile)

    def test_services_are_hardened_and_may_drain(self):
        for name in self.FILES:
            for service, spec in self.services(name).items():
                with self.subTest(file=name, service=service):
                    self.assertTrue(spec["read_only"])
                    self.assertEqual(spec["cap_drop"], ["ALL"])
                    if name != "demo.yaml":
                        self.assertGreater(int(spec["stop_grace_period"].rstrip("s")), 30)

    def test_swarm_resolves_names_to_tasks_and_probes_health(self):
        for service, spec in self.services("swarm/stack.yaml").items():
            with self.subTest(service=service):
                program = spec["image"].split(":")[0]
                self.assertEqual(spec["deploy"]["endpoint_mode"], "dnsrr")
                self.assertEqual(spec["healthcheck"]["test"], ["CMD", program, "--probe"])
                for port in spec.get("ports", []):
                    self.assertEqual(port["mode"], "host", "dnsrr has no other way to publish")
                order = spec["deploy"]["update_config"]["order"]
                self.assertEqual(order, "stop-first" if "ports" in spec else "start-first")

    def test_swarm_has_a_secret_for_each_that_a_service_takes(self):
        document = yaml.safe_load(interpolated((DEPLOY / "swarm/stack.yaml").read_text()))
        taken = {s["source"] for spec in document["services"].values() for s in spec["secrets"]}
        self.assertEqual(taken, set(document["secrets"]))
        for service, spec in document["services"].items():
            paths = {f"/run/secrets/{s['target']}" for s in spec["secrets"]}
            said = {v for v in spec["environment"].values() if v.startswith("/run/secrets/")}
            with self.subTest(service=service):
                self.assertEqual(said, paths)

    def test_compose_takes_the_files(self):
        need("docker-compose")
        environment = {**os.environ, "ISOSCOPE_DATASET": "/data/head", "ISOSCOPE_CERTIFICATES": "/tmp",
                       "ISOSCOPE_USER": "1000:1000"}
        for names in [[name] for name in self.FILES] + [["compose.yaml", "compose.tls.yaml"]]:
            with self.subTest(files=names):
                options = [word for name in names for word in ("--file", DEPLOY / name)]
                output("docker-compose", *options, "config", "--quiet", env=environment)

    def test_tls_over_compose_leaves_no_service_in_plaintext(self):
        plain = self.services("compose.yaml")
        over = self.services("compose.tls.yaml")
        self.assertEqual(set(plain), set(over))
        for service, spec in over.items():
            program = plain[service]["image"]
            mounted = {volume.split(":")[1] for volume in spec["volumes"]}
            with self.subTest(service=service):
                self.assertEqual(spec["environment"]["ISOSCOPE_INSECURE"], "false")
                self.assertEqual({v for v in spec["environment"].values() if v.startswith("/tls/")}, mounted)
                for variable in spec["environment"]:
                    self.assertIn(variable, PROGRAMS[program].variables)


def each(*kinds):
    """Makes a test of one object a test of all objects of these kinds, in all overlays."""

    def decorate(method):
        @functools.wraps(method)
        def test(self):
            for overlay, objects in self.overlays.items():
                for item in objects:
                    if item["kind"] in kinds:
                        with self.subTest(overlay=overlay, object=f"{item['kind']}/{item['metadata']['name']}"):
                            method(self, objects, item)

        return test

    return decorate


class TestKubernetes(unittest.TestCase):
    """The objects that kustomize makes."""

    @classmethod
    def setUpClass(cls):
        need("kubectl")
        cls.overlays = {
            name: list(yaml.safe_load_all(output("kubectl", "kustomize", DEPLOY / "kubernetes" / name)))
            for name in OVERLAYS + ["partition", "parts", "parts/finish"]}

    @staticmethod
    def containers(item):
        spec = item["spec"]["template"]["spec"]
        return spec.get("initContainers", []) + spec["containers"]

    @staticmethod
    def labels_of_pods(objects):
        return [item["spec"]["template"]["metadata"]["labels"] for item in objects
                if item["kind"] in ("Deployment", "StatefulSet", "Job")]

    @staticmethod
    def selects(selector, labels):
        return all(labels.get(key) == value for key, value in selector.items())

    @each("Deployment", "StatefulSet")
    def test_selectors_select_their_own_pods_and_no_others(self, objects, item):
        selector = item["spec"]["selector"]["matchLabels"]
        self.assertTrue(self.selects(selector, item["spec"]["template"]["metadata"]["labels"]))
        self.assertEqual(sum(self.selects(selector, labels) for labels in self.labels_of_pods(objects)), 1)

    @each("Service", "PodDisruptionBudget", "NetworkPolicy")
    def test_services_budgets_and_policies_select_pods(self, objects, item):
        spec = item["spec"]
        selector = spec.get("podSelector", spec.get("selector", {}))
        selector = selector.get("matchLabels", selector)
        self.assertTrue(any(self.selects(selector, labels) for labels in self.labels_of_pods(objects)))

    @each("Service")
    def test_ports_of_services_are_named_by_their_pods(self, objects, item):
        for workload in objects:
            if workload["kind"] in ("Deployment", "StatefulSet") and self.selects(
                    item["spec"]["selector"], workload["spec"]["template"]["metadata"]["labels"]):
                named = {p["name"] for c in self.containers(workload) for p in c.get("ports", [])}
                for port in item["spec"]["ports"]:
                    self.assertIn(port["targetPort"], named)

    @each("NetworkPolicy")
    def test_ports_of_policies_are_named_by_the_pods(self, objects, item):
        named = {p["name"] for o in objects if o["kind"] in ("Deployment", "StatefulSet")
                 for c in self.containers(o) for p in c.get("ports", [])}
        for rule in item["spec"].get("ingress", []) + item["spec"].get("egress", []):
            for port in rule.get("ports", []):
                if port["port"] != 53:
                    self.assertIn(port["port"], named)

    @each("Deployment", "StatefulSet")
    def test_containers_listen_on_the_ports_that_they_name(self, _, item):
        for container in item["spec"]["template"]["spec"]["containers"]:
            values = {e["name"]: e.get("value") for e in container["env"]}
            port = int(values["ISOSCOPE_LISTEN"].rsplit(":", 1)[1])
            self.assertEqual(container["ports"][0]["containerPort"], port)
            self.assertEqual(port, PROGRAMS["isoscope-" + container["name"]].port)

    @each("Deployment", "StatefulSet", "Job")
    def test_variables_belong_to_the_program(self, objects, item):
        settings = next((o["data"] for o in objects if o["kind"] == "ConfigMap"), {})
        known = all_variables()
        for container in self.containers(item):
            program = PROGRAMS.get("isoscope-" + container["name"])
            for entry in container.get("env", []):
                if entry["name"].startswith("ISOSCOPE_"):
                    self.assertIn(entry["name"], program.variables)
        for name in settings:
            self.assertTrue(name == "DATASET" or name in known, name)

    @each("Deployment", "StatefulSet", "Job")
    def test_dialled_names_are_services(self, objects, item):
        ports = {o["metadata"]["name"]: [p["port"] for p in o["spec"]["ports"]]
                 for o in objects if o["kind"] == "Service"}
        for container in self.containers(item):
            for entry in container.get("env", []):
                if entry["name"] in ("ISOSCOPE_AGENT", "ISOSCOPE_SERVER"):
                    host, port = entry["value"].replace("dns:///", "").split(":")
                    self.assertIn(int(port), ports[host])
                if entry["name"] == "ISOSCOPE_TLS_SERVER_NAME":
                    self.assertIn(entry["value"], ports)

    @each("Deployment", "StatefulSet")
    def test_programs_probe_themselves(self, _, item):
        for container in item["spec"]["template"]["spec"]["containers"]:
            self.assertIn("livenessProbe", container)
            kinds = {"startupProbe": "--probe=live", "readinessProbe": "--probe=ready", "livenessProbe": "--probe=live"}
            if container["name"] == "gateway":  # it has one health
                kinds = {"startupProbe": "--probe", "readinessProbe": "--probe"}
            for probe, flag in kinds.items():
                self.assertEqual(container[probe]["exec"]["command"], ["isoscope-" + container["name"], flag])

    @each("Deployment", "StatefulSet", "Job")
    def test_pods_have_no_rights(self, _, item):
        spec = item["spec"]["template"]["spec"]
        self.assertIs(spec["automountServiceAccountToken"], False)
        self.assertIs(spec["securityContext"]["runAsNonRoot"], True)
        self.assertEqual(spec["securityContext"]["seccompProfile"]["type"], "RuntimeDefault")
        for container in self.containers(item):
            context = container["securityContext"]
            self.assertIs(context["readOnlyRootFilesystem"], True)
            self.assertIs(context["allowPrivilegeEscalation"], False)
            self.assertEqual(context["capabilities"], {"drop": ["ALL"]})
            self.assertIn("memory", container["resources"]["limits"])
            self.assertIn("cpu", container["resources"]["requests"])

    @each("Deployment", "StatefulSet")
    def test_pods_may_drain(self, objects, item):
        drain = next(o["data"]["ISOSCOPE_DRAIN_SECONDS"] for o in objects if o["kind"] == "ConfigMap")
        self.assertGreater(item["spec"]["template"]["spec"]["terminationGracePeriodSeconds"], int(drain) + 5)

    @each("Deployment", "StatefulSet", "Job")
    def test_volumes_are_there_and_every_mount_has_one(self, objects, item):
        claims_made_by_people = {"isoscope-source"}
        spec = item["spec"]["template"]["spec"]
        claims = {o["metadata"]["name"] for o in objects if o["kind"] == "PersistentVolumeClaim"}
        claims |= {"isoscope-data"} if item["kind"] == "Job" else set()
        names = {v["name"] for v in spec.get("volumes", [])}
        names |= {c["metadata"]["name"] for c in item["spec"].get("volumeClaimTemplates", [])}
        for volume in spec.get("volumes", []):
            if "persistentVolumeClaim" in volume:
                self.assertIn(volume["persistentVolumeClaim"]["claimName"], claims | claims_made_by_people)
        for container in self.containers(item):
            for mount in container.get("volumeMounts", []):
                self.assertIn(mount["name"], names)

    @each("Deployment", "StatefulSet", "Job")
    def test_secrets_are_those_that_the_readme_makes(self, _, item):
        text = (DEPLOY / "README.md").read_text()
        text += "".join(text.replace("$party", party) for party in ("agent", "coordinator", "gateway"))
        for secret in re.findall(r"'secret(?:Name|KeyRef)': (?:'|\{[^}]*'name': ')([\w-]+)", str(item)):
            self.assertIn(secret, text)

    def test_the_two_replica_groups_differ_in_their_letter_alone(self):
        sets = {o["metadata"]["name"]: o for o in self.overlays["overlays/production"] if o["kind"] == "StatefulSet"}
        a, b = (json.dumps(sets[f"isoscope-agents-{letter}"], sort_keys=True) for letter in "ab")
        b = b.replace('"isoscope/replica-group": "b"', '"isoscope/replica-group": "a"')
        b = b.replace("isoscope-agents-b", "isoscope-agents-a").replace('"values": ["b"]', '"values": ["a"]')
        part_of = '"app.kubernetes.io/part-of": "isoscope", '  # of the base alone
        self.assertEqual(a.replace(part_of, ""), b.replace(part_of, ""))

    @each("HorizontalPodAutoscaler", "Ingress")
    def test_autoscaler_ingress_and_budgets_name_what_there_is(self, objects, item):
        names = {(o["kind"], o["metadata"]["name"]) for o in objects}
        if item["kind"] == "Ingress":
            backend = item["spec"]["rules"][0]["http"]["paths"][0]["backend"]["service"]["name"]
            self.assertIn(("Service", backend), names)
        else:
            reference = item["spec"]["scaleTargetRef"]
            self.assertIn((reference["kind"], reference["name"]), names)

    def test_apply_takes_each_object_in_one_step(self):
        text = (DEPLOY / "kubernetes" / "apply.sh").read_text()
        steps = re.findall(r"^  '(\S+?)(?: (\w+))?'$", text, re.MULTILINE)

        def chosen(selector, labels):
            for part in selector.split(","):
                key, _, value = part.partition("=")
                if part.startswith("!") and part[1:] in labels:
                    return False
                if not part.startswith("!") and labels.get(key) != value:
                    return False
            return True

        for overlay in OVERLAYS:
            for item in self.overlays[overlay]:
                taken = [(s, kind) for s, kind in steps if chosen(s, item["metadata"].get("labels", {}))]
                with self.subTest(overlay=overlay, object=f"{item['kind']}/{item['metadata']['name']}"):
                    self.assertEqual(len(taken), 1)
                    if item["kind"] in ("Deployment", "StatefulSet", "Job"):
                        self.assertEqual(taken[0][1], item["kind"].lower())

    def scripts_of(self, kind):
        """The shell of the agents' containers of that kind, in production."""
        for item in self.overlays["overlays/production"]:
            if item["kind"] == "StatefulSet":
                for container in item["spec"]["template"]["spec"][kind]:
                    self.assertEqual(container["command"], ["bash", "-euc"])
                    yield container["args"][0]

    def run_script(self, script, work, ordinal):
        """Runs it with `work` for /data and /local, and an agent that prints its arguments."""
        program = work / "bin" / "isoscope-agent"
        program.parent.mkdir(exist_ok=True)
        program.write_text('#!/bin/sh\necho "$@"\n')
        program.chmod(0o755)
        environment = {"PATH": f"{program.parent}:{os.environ['PATH']}", "POD_NAME": f"isoscope-agents-a-{ordinal}",
                       "DATASET": "head", "SHARDS_AT": f"{work}/local"}
        script = script.replace("/data/", f"{work}/data/").replace("/local/", f"{work}/local/")
        return output("bash", "-euc", script, env=environment)

    def test_a_pod_serves_the_shard_of_its_ordinal_from_its_own_copy(self):
        copies, starts = list(self.scripts_of("initContainers")), list(self.scripts_of("containers"))
        self.assertEqual((len(copies), len(starts)), (2, 2))
        for ordinal in (0, 9, 11):  # 9: printf takes 09 for octal, if it ever got one
            with tempfile.TemporaryDirectory() as work, self.subTest(ordinal=ordinal):
                work = pathlib.Path(work)
                name = f"shard-{ordinal:05}-of-00012"
                for number in range(12):
                    shard = work / "data" / "head" / f"shard-{number:05}-of-00012"
                    shard.mkdir(parents=True)
                    (shard / "blocks.bin").write_text(str(number))
                # A copy that was cut short.
                (work / "local" / "head" / f"{name}.part").mkdir(parents=True)
                (work / "local" / "head" / f"{name}.part" / "old").write_text("")
                self.run_script(copies[0], work, ordinal)
                local = work / "local" / "head"
                self.assertEqual([p.name for p in local.iterdir()], [name])
                self.assertEqual([p.name for p in (local / name).iterdir()], ["blocks.bin"])
                self.assertEqual((local / name / "blocks.bin").read_text(), str(ordinal))
                # Once is enough.
                (local / name / "blocks.bin").write_text("kept")
                self.run_script(copies[0], work, ordinal)
                self.assertEqual((local / name / "blocks.bin").read_text(), "kept")
                self.assertEqual(self.run_script(starts[0], work, ordinal), f"--shard {local / name}\n")

    def test_objects_have_the_types_of_kubernetes(self):
        folder = os.environ.get("ISOSCOPE_KUBERNETES_MODELS")
        if not folder:
            skips.skip("kubernetes-models", "ISOSCOPE_KUBERNETES_MODELS is not set: see the head of this file")
        need("tsc", "node")
        modules = pathlib.Path(folder) / "node_modules"
        objects = [item for overlay in self.overlays.values() for item in overlay]
        with tempfile.TemporaryDirectory() as work:
            work = pathlib.Path(work)
            (work / "node_modules").symlink_to(modules.resolve())
            # tsc refuses unknown fields of a literal and wrong types; the models' own validators check values.
            typed, checked = [], []
            for number, item in enumerate(objects):
                group = item["apiVersion"].split("/")[0] if "/" in item["apiVersion"] else ""
                module = "/".join(filter(None, ["kubernetes-models", group, item["apiVersion"].split("/")[-1],
                                                item["kind"]]))
                typed.append(f'import {{ I{item["kind"]} as T{number} }} from "{module}";\n'
                             f"export const o{number}: T{number} = {json.dumps(item, indent=1)};\n")
                checked.append(f'new (require("{module}").{item["kind"]})({json.dumps(item)}).validate();\n')
            (work / "objects.ts").write_text("".join(typed))
            (work / "objects.js").write_text("".join(checked))
            output("tsc", "--noEmit", "--strict", "--skipLibCheck", "--moduleResolution", "node", "objects.ts", cwd=work)
            output("node", "objects.js", cwd=work)


class TestSystemd(unittest.TestCase):
    """Units."""

    UNITS = ["isoscope-agent@0.service", "isoscope-coordinator.service", "isoscope-gateway.service"]

    def setUp(self):
        need("systemd-analyze")
        self.root = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.root, ignore_errors=True)
        units = self.root / "etc/systemd/system"
        units.mkdir(parents=True)
        for path in files("systemd/*.service"):
            shutil.copy(path, units)
        # The targets that they come after, and the programs that they start.
        for target in ("network-online", "local-fs", "multi-user", "sysinit", "basic", "shutdown"):
            (units / f"{target}.target").write_text("[Unit]\nDefaultDependencies=no\n")
        for program in ("usr/local/bin/isoscope-agent", "usr/local/bin/isoscope-coordinator",
                        "usr/local/bin/isoscope-gateway", "bin/sh"):
            path = self.root / program
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("")
            path.chmod(0o755)

    def test_units_are_right(self):
        text = output("systemd-analyze", "verify", f"--root={self.root}", *self.UNITS)
        self.assertEqual(text, "")

    def test_units_are_not_exposed(self):
        """At most 2 of 10: "OK" of systemd-analyze. They need the network, and nothing else."""
        for unit in self.UNITS:
            text = output("systemd-analyze", "security", "--offline=true", f"--root={self.root}", "--no-pager", unit)
            score = float(re.search(r"exposure level for \S+: ([\d.]+)", text).group(1))
            with self.subTest(unit=unit, score=score):
                self.assertLessEqual(score, 2.0)

    def test_units_wait_for_frames_and_for_health(self):
        for path in files("systemd/*.service"):
            text = path.read_text()
            with self.subTest(unit=path.name):
                self.assertGreater(int(re.search(r"TimeoutStopSec=(\d+)", text).group(1)), 30)
                program = re.search(r"ExecStart=/usr/local/bin/(\S+)", text).group(1)
                self.assertIn(f"/usr/local/bin/{program} --probe", text)


class TestSlurm(unittest.TestCase):
    """The job's own head."""

    def test_options_are_described(self):
        text = (DEPLOY / "slurm/isoscope.sbatch").read_text()
        head = text[: text.index("#SBATCH")]
        for name in OWN_VARIABLES["slurm/isoscope.sbatch"] - {"ISOSCOPE_DATASET"}:
            self.assertIn(name, head)

    def test_servers_end_before_slurm_kills_them(self):
        text = (DEPLOY / "slurm/isoscope.sbatch").read_text()
        drain = int(re.search(r"ISOSCOPE_DRAIN_SECONDS:-(\d+)", text).group(1))
        self.assertLess(drain, 30, "Slurm's default KillWait")
        self.assertGreater(int(re.search(r"--signal=B:USR1@(\d+)", text).group(1)), 2 * drain)


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        print(__doc__)
        sys.exit(0 if sys.argv[1:2] in (["-h"], ["--help"]) else 2)
    PROGRAMS.update(program_help.load(pathlib.Path(sys.argv.pop(1))))
    unittest.main()
