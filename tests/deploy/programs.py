"""The flags and variables of the programs, as their --help tells them, and those that deploy/ uses."""

import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]
SERVERS = ("isoscope-agent", "isoscope-coordinator", "isoscope-gateway")


class Program:
    """One program: `flags` as "--listen", `variables` as "ISOSCOPE_LISTEN", `port` of its --listen."""

    def __init__(self, path: pathlib.Path, arguments: tuple[str, ...] = ()):
        question = "--help-all" if arguments else "--help"  # a command's --help has the common flags alone
        run = subprocess.run([path, *arguments, question], capture_output=True, text=True, timeout=60)
        if run.returncode != 0:
            raise RuntimeError(f"{path} {arguments} {question}: {run.stdout}{run.stderr}")
        self.flags = set(re.findall(r"--[a-z][a-z-]*", run.stdout)) | {"--help", "--version"}
        self.variables = set(re.findall(r"Env:(\w+)", run.stdout)) | set(re.findall(r"\$(ISOSCOPE_\w+)", run.stdout))
        listen = re.search(r"--listen \S*:(\d+)", run.stdout)
        self.port = int(listen.group(1)) if listen else None
        self.help = run.stdout


def load(folder: pathlib.Path) -> dict[str, Program]:
    """Servers by name, commands as "isoscope render"."""
    programs = {name: Program(folder / name) for name in SERVERS}
    isoscope = Program(folder / "isoscope")
    programs["isoscope"] = isoscope
    for command in re.findall(r"^  ([a-z]+) ", isoscope.help, re.MULTILINE):
        try:
            programs[f"isoscope {command}"] = Program(folder / "isoscope", (command,))
        except RuntimeError:
            continue  # a word of the text, no command
    return programs


# A program at the start of a command, with the rest of its line. A path or a quote may precede it, and a shell's
# options may surround it.
_COMMAND = re.compile(r"(?<![\w./-])(?:[\w.$\"{}/-]*/)?(isoscope(?:-agent|-coordinator|-gateway)?)\"?(?=\s)([^\n]*)")
# Before a name that is no command: of a namespace, or of a party in a certificate.
_NO_COMMAND = re.compile(r"(?:\s-n|--namespace|--agent|--coordinator|--gateway)\s+$")
_END = re.compile(r"[|;`>]|&&|\|\||\s#|\s--\s")


def commands(text: str) -> list[tuple[str, list[str]]]:
    """The commands of our programs in shell, YAML or Markdown: (name, flags), with joined lines."""
    found = []
    text = re.sub(r"\\\n\s*", " ", text)
    for match in _COMMAND.finditer(text):
        if _NO_COMMAND.search(text[max(0, match.start() - 20) : match.start()]):
            continue
        name, rest = match.group(1), _END.split(match.group(2), maxsplit=1)[0]
        words = rest.replace("'", " ").replace('"', " ").replace(",", " ").split()
        if name == "isoscope":
            if not words or not re.fullmatch(r"[a-z]+", words[0]):
                continue
            name = f"isoscope {words[0]}"
        flags = [re.match(r"--[a-z][a-z-]*", w).group(0) for w in words if re.match(r"--[a-z]", w)]
        found.append((name, flags))
    return found
