#!/usr/bin/env python3
"""Completions in the shells themselves, and man pages by man and mandoc.

    completion_test.py FOLDER PROGRAM

FOLDER is the one that cmake/WriteManuals.cmake fills, PROGRAM is isoscope. A shell or checker that
is not installed is left out, and named.
"""

import os
import pathlib
import pty
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import skips  # noqa: E402

FOLDER = pathlib.Path(sys.argv[1]).resolve()
PROGRAM = pathlib.Path(sys.argv[2]).resolve()
SERVERS = ["isoscope-agent", "isoscope-coordinator", "isoscope-gateway"]
PATIENCE_S = 60


def run(argv, **options):
    return subprocess.run(argv, capture_output=True, text=True, timeout=PATIENCE_S, check=False, **options)


class WithFolder(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.path = pathlib.Path(self.folder.name)
        (self.path / "head.nii.gz").touch()
        (self.path / "head folder").mkdir()

    def tearDown(self):
        self.folder.cleanup()


# A line that is being typed, and what must be offered, and what must not.
LINES = [
    ("isoscope ren", ["render"], ["partition"]),
    ("isoscope ", ["render", "cache", "completion", "help"], ["--culling"]),
    ("isoscope cache ", ["list", "clear"], ["render"]),
    ("isoscope-bench fr", ["frame"], ["paper"]),
    ("isoscope render --cull", ["--culling"], ["--color"]),
    ("isoscope render --culling ", ["depth", "mask", "none"], ["head.nii.gz"]),
    ("isoscope render --show si", ["sixel"], ["kitty"]),
    ("isoscope render he", ["head.nii.gz"], []),
    ("isoscope render --like he", ["head.nii.gz"], []),
    ("isoscope render --culling mask --bac", ["--background"], []),
    ("isoscope-bench frame --rend", ["--renderer"], []),
    ("isoscope-bench frame --renderer e", ["egl"], ["cpu"]),
    ("isoscope partition v.nrrd --distribution g", ["greedy"], ["random"]),
    ("isoscope partition v.nrrd --levels ", ["auto", "none"], ["lz4"]),
    ("isoscope completion ", ["bash", "zsh", "fish"], []),
    ("isoscope help exp", ["export"], ["render"]),
    ("isoscope-agent --rend", ["--renderer"], ["--shard"]),
    ("isoscope-agent --renderer c", ["cpu"], ["egl"]),
    ("isoscope-coordinator --ag", ["--agent"], []),
    ("isoscope render v.nrrd --view ant", ["anterior"], ["posterior"]),
    ("isoscope generate gy", ["gyroid"], ["random"]),
    ("isoscope render --color-by ", ["z", "none"], ["z:viridis"]),
    ("isoscope view v --format nrr", ["nrrd"], ["nifti"]),
    ("isoscope render v --caps=v", [], ["turbo"]),
    ("isoscope export v --format s", ["stl"], ["nrrd"]),
    ("isoscope generate gyroid --type flo", ["float32", "float64"], ["uint8"]),
    ("isoscope render --help", ["--help", "--help-all"], []),
]


@skips.skip_unless(shutil.which("bash"), "shells", "bash is not installed")
class Bash(WithFolder):
    def complete(self, line):
        words = line.split(" ")
        program = words[0]
        script = FOLDER / "bash-completion" / "completions" / program
        quoted = " ".join(f"'{word}'" for word in words)
        code = (f"source {script}; COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; "
                f"_{program.replace('-', '_')}; printf '%s\\n' \"${{COMPREPLY[@]}}\"")
        result = run(["bash", "--norc", "-c", code], cwd=self.path)
        self.assertEqual(result.stderr, "", line)
        return result.stdout.split("\n")

    def test_lines(self):
        for line, offered, not_offered in LINES:
            words = self.complete(line)
            for word in offered:
                self.assertIn(word, words, line)
            for word in not_offered:
                self.assertNotIn(word, words, line)

    def test_folders_alone_where_a_flag_takes_them(self):
        self.assertEqual([word for word in self.complete("isoscope partition v.nrrd --output he") if word],
                         ["head folder"])

    def test_a_flag_with_an_equals_sign(self):
        words = self.complete("isoscope render --culling = m")
        self.assertEqual([word for word in words if word], ["mask"])
        self.assertIn("depth", self.complete("isoscope render --culling ="))

    def test_a_colour_map_behind_a_colon(self):
        # Bash splits at colons, and replaces what is behind the last one.
        for words in ["isoscope render --color-by z : vi", "isoscope render --color-by = z : vi"]:
            self.assertEqual([word for word in self.complete(words) if word], ["viridis"], words)
        self.assertIn("turbo", self.complete("isoscope render --color-by z :"))

    def test_a_value_that_is_a_number_gets_no_files(self):
        self.assertEqual([word for word in self.complete("isoscope render --isovalue ") if word], [])

    def test_a_login_shell_takes_it(self):
        result = run(["bash", "-c", f"source <({PROGRAM} completion bash) && complete -p isoscope"])
        self.assertIn("-F _isoscope isoscope", result.stdout)
        self.assertEqual(result.stderr, "")


@skips.skip_unless(shutil.which("fish"), "shells", "fish is not installed")
class Fish(WithFolder):
    def complete(self, line):
        script = FOLDER / "fish" / "vendor_completions.d" / f"{line.split(' ')[0]}.fish"
        environment = dict(os.environ, HOME=str(self.path), XDG_CONFIG_HOME=str(self.path / "config"),
                           XDG_DATA_HOME=str(self.path / "data"), PATH=f"{PROGRAM.parent}:{os.environ['PATH']}")
        result = run(["fish", "--no-config", "-c", f"source {script}; complete -C '{line}'"], cwd=self.path,
                     env=environment)
        self.assertEqual(result.stderr, "", line)
        return [row.split("\t")[0] for row in result.stdout.split("\n")]

    def test_lines(self):
        for line, offered, not_offered in LINES:
            words = self.complete(line)
            for word in offered:
                self.assertIn(word, words, line)
            for word in not_offered:
                self.assertNotIn(word, words, line)

    def test_a_colour_map_behind_a_colon(self):
        self.assertIn("z:viridis", self.complete("isoscope render --color-by z:vi"))

    def test_folders_alone_where_a_flag_takes_them(self):
        words = self.complete("isoscope partition v.nrrd --output he")
        self.assertIn("head folder/", words)
        self.assertNotIn("head.nii.gz", words)


@skips.skip_unless(shutil.which("zsh"), "shells", "zsh is not installed")
class Zsh(WithFolder):
    """Zsh offers nothing without a terminal: keys are typed into one."""

    def setUp(self):
        super().setUp()
        self.pid, self.fd = pty.fork()
        if self.pid == 0:
            os.chdir(self.path)
            os.environ.update(HOME=str(self.path), TERM="xterm", LANG="C.UTF-8", COLUMNS="200")
            os.execvp("zsh", ["zsh", "-f", "-i"])
        self.text = ""
        folder = FOLDER / "zsh" / "site-functions"
        self.type(f"PS1='ready''> '; fpath=({folder} $fpath); autoload -U compinit; compinit -u -D; "
                  "setopt no_beep auto_list; zstyle ':completion:*' menu no\n")
        self.read_until("ready> ")

    def tearDown(self):
        os.close(self.fd)
        os.waitpid(self.pid, 0)
        super().tearDown()

    def type(self, text):
        os.write(self.fd, text.encode())

    def read_until(self, wanted):
        end = time.monotonic() + PATIENCE_S
        while wanted not in self.text:
            if time.monotonic() > end:
                self.fail(f"zsh did not say {wanted!r}: {self.text!r}")
            if select.select([self.fd], [], [], 0.1)[0]:
                self.text += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "",
                                    os.read(self.fd, 65536).decode(errors="replace"))

    def check(self, line, wanted):
        self.text = ""
        self.type(line + "\t")
        self.read_until(wanted)
        self.type("\x15\n")  # an empty line
        self.read_until("ready> ")

    def test_lines(self):
        self.check("isoscope ren", "isoscope render")
        self.check("isoscope cache l", "isoscope cache list")
        self.check("isoscope-bench pap", "isoscope-bench paper")
        self.check("isoscope render --cull", "isoscope render --culling")
        self.check("isoscope render --culling m", "isoscope render --culling mask")
        self.check("isoscope render head.n", "isoscope render head.nii.gz")
        self.check("isoscope-bench frame --renderer e", "isoscope-bench frame --renderer egl")
        self.check("isoscope render --culling ", "depth")
        self.check("isoscope-agent --renderer c", "isoscope-agent --renderer cpu")
        self.check("isoscope render --view ant", "isoscope render --view anterior")
        self.check("isoscope generate gy", "isoscope generate gyroid")
        self.check("isoscope render --color-by non", "isoscope render --color-by none")
        self.check("isoscope render --color-by z:vi", "isoscope render --color-by z:viridis")


class ManPages(unittest.TestCase):
    def pages(self):
        pages = sorted((FOLDER / "man" / "man1").glob("*.1"))
        names = [page.name for page in pages]
        for name in ["isoscope", "isoscope-render", "isoscope-bench-frame", "isoscope-view", *SERVERS]:
            self.assertIn(f"{name}.1", names)
        return pages

    @skips.skip_unless(shutil.which("man"), "shells", "man is not installed")
    def test_man_has_nothing_to_complain_of(self):
        environment = dict(os.environ, MANWIDTH="80", LC_ALL="C.UTF-8")
        for page in self.pages():
            result = run(["man", "--warnings", "-E", "UTF-8", "-l", str(page)], env=environment)
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertEqual(result.stderr, "", page)
            self.assertIn("NAME", result.stdout)

    @skips.skip_unless(shutil.which("mandoc"), "shells", "mandoc is not installed")
    def test_mandoc_has_nothing_to_complain_of(self):
        for page in self.pages():
            result = run(["mandoc", "-T", "lint", "-W", "warning", str(page)])
            self.assertEqual((result.returncode, result.stdout), (0, ""), page)

    def test_every_flag_of_help_is_in_the_page(self):
        for command in ["render", "partition", "view"]:
            page = (FOLDER / "man" / "man1" / f"isoscope-{command.replace(' ', '-')}.1").read_text()
            text = run([str(PROGRAM), *command.split(), "--help-all"]).stdout
            flags = re.findall(r"^  (?:-\w, )?(--[a-z-]+)", text, re.M)
            self.assertGreater(len(flags), 5)
            for flag in flags:
                self.assertIn(flag.replace("-", "\\-"), page, command)


if __name__ == "__main__":
    for tool in ["bash", "zsh", "fish", "man", "mandoc"]:
        if not shutil.which(tool):
            print(f"{tool} is not installed: its part is left out")
    unittest.main(argv=sys.argv[:1], verbosity=2)
