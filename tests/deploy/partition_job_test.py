#!/usr/bin/env python3
"""The jobs that cut a volume in parts: the script of Slurm and the shell of the Kubernetes jobs, run as processes.

    partition_job_test.py BIN_FOLDER [unittest arguments]
"""

import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

BIN = os.path.abspath(sys.argv.pop(1)) if len(sys.argv) > 1 else "."
DEPLOY = pathlib.Path(__file__).resolve().parent.parent.parent / "deploy"
SCRIPT = DEPLOY / "slurm/partition.sbatch"
CUT = ["--shards", "2", "--block-cells", "4", "--levels", "1", "--quiet"]


def files_below(folder):
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(pathlib.Path(folder).rglob("*")) if path.is_file()}


class PartitionJobTest(unittest.TestCase):

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        self.source = self.folder / "v.nrrd"
        self.isoscope("generate", "gyroid", "--dims", "41,38,43", "--type", "uint8", "--output", self.source, "--quiet")
        (self.folder / "one").mkdir()
        (self.folder / "many").mkdir()
        self.isoscope("partition", self.source, "--output", self.folder / "one/d", *CUT)
        self.dataset = self.folder / "many/d"

    @staticmethod
    def isoscope(*arguments):
        subprocess.run([os.path.join(BIN, "isoscope"), *map(str, arguments)], check=True, timeout=120)

    def start(self, task, first, last, count, *arguments, **variables):
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("SLURM_", "ISOSCOPE_"))}
        environment |= {"ISOSCOPE_BIN": BIN, **variables}
        if task is not None:
            environment |= {"SLURM_ARRAY_TASK_ID": str(task), "SLURM_ARRAY_TASK_MIN": str(first),
                            "SLURM_ARRAY_TASK_MAX": str(last), "SLURM_ARRAY_TASK_COUNT": str(count)}
        return subprocess.Popen([str(SCRIPT), *map(str, arguments)], env=environment, text=True,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def end(self, process, expected=0):
        said = "".join(process.communicate(timeout=120))
        self.assertEqual(process.returncode, expected, said)
        return said

    def test_an_array_and_a_last_job_make_the_dataset_of_one_process(self):
        tasks = [self.start(task, 0, 3, 4, self.source, self.dataset, *CUT) for task in range(4)]
        for task in tasks:
            self.end(task)
        self.end(self.start(None, 0, 0, 0, "--finish", self.dataset))
        self.assertEqual(files_below(self.dataset), files_below(self.folder / "one/d"))
        self.assertEqual(os.listdir(self.folder / "many"), ["d"])

    def test_a_task_that_was_killed_is_run_again_by_its_number(self):
        for task in (0, 2):
            self.end(self.start(task, 0, 2, 3, self.source, self.dataset, *CUT))
        killed = self.start(1, 0, 2, 3, self.source, self.dataset, *CUT)
        killed.kill()
        killed.communicate(timeout=120)
        # An array of one task can't tell how many parts there are.
        self.assertIn("ISOSCOPE_PARTS", self.end(self.start(1, 1, 1, 1, self.source, self.dataset, *CUT), 1))
        self.end(self.start(1, 1, 1, 1, self.source, self.dataset, *CUT, ISOSCOPE_PARTS="3"))
        self.end(self.start(None, 0, 0, 0, "--finish", self.dataset))
        self.assertEqual(files_below(self.dataset), files_below(self.folder / "one/d"))

    def test_what_is_missing_is_said(self):
        self.assertIn("array", self.end(self.start(None, 0, 0, 0, self.source, self.dataset), 1))
        self.assertIn("usage", self.end(self.start(0, 0, 1, 2, self.source), 1))
        self.assertIn("not an array", self.end(self.start(0, 0, 1, 2, "--finish", self.dataset), 1))
        self.end(self.start(1, 0, 1, 2, self.source, self.dataset, *CUT))
        self.assertIn("part 0 of 2 is not finished", self.end(self.start(None, 0, 0, 0, "--finish", self.dataset), 1))

    def test_the_jobs_of_kubernetes_make_it_too(self):
        text = (DEPLOY / "kubernetes/parts/job.yaml").read_text()
        script = re.search(r"^( +)- \|\n((?:\1  .*\n)+)", text, re.MULTILINE)[2]
        count = int(re.search(r"completions: (\d+)", text)[1])
        self.assertIn(f'{{name: PARTS, value: "{count}"}}', text)
        script = script.replace("/data/", f"{self.folder}/many/")
        for index in range(count):
            environment = os.environ | {
                "PATH": f"{BIN}:{os.environ['PATH']}", "JOB_COMPLETION_INDEX": str(index), "PARTS": str(count),
                "VOLUME": str(self.source), "DATASET": "head", "SHARDS": "2"}
            subprocess.run(["bash", "-euc", script], env=environment, check=True, timeout=120, capture_output=True)
        finish = (DEPLOY / "kubernetes/parts/finish/job.yaml").read_text()
        arguments = re.search(r"args: \[(.*)\]", finish)[1].split(", ")
        self.isoscope(*(word.replace("/data/", f"{self.folder}/many/") for word in arguments))
        (self.folder / "other").mkdir()
        self.isoscope("partition", self.source, "--output", self.folder / "other/head", "--shards", "2", "--quiet")
        self.assertEqual(files_below(self.folder / "many/head"), files_below(self.folder / "other/head"))


if __name__ == "__main__":
    unittest.main()
