"""The version. In a wheel and in an sdist setup.py has put the version itself here, in place of this module.

In a checkout it is that of the whole project, which scripts/version.sh says; $ISOSCOPE_VERSION is taken instead where it
is set. `git describe` of n commits after a tag becomes VERSION+n.gCOMMIT, as PEP 440 has it. A copy of the folder
without the rest of the project does not know it: 0+unknown.
"""

import os
import pathlib
import re
import subprocess


def python_version(text: str) -> str:
    """Returns the version as PEP 440 writes it, also of `git describe`; ValueError if it is none."""
    match = re.fullmatch(r"v?(\d+(?:\.\d+)*)(?:-(\d+)-(g[0-9a-f]+))?(-dirty)?", text.strip())
    if match is None:
        if re.fullmatch(r"\d+(\.\d+)*((a|b|rc)\d+)?(\.post\d+)?(\.dev\d+)?(\+[a-z0-9]+(\.[a-z0-9]+)*)?", text.strip()):
            return text.strip()
        raise ValueError(f"version {text!r}: must be as 1.2.3, or as git describe writes it")
    local = [part for part in (match[2], match[3], match[4] and "dirty") if part]
    return match[1] + ("+" + ".".join(local) if local else "")


def _of_project() -> str:
    named = os.environ.get("ISOSCOPE_VERSION")
    if named:
        return named
    above = pathlib.Path(__file__).resolve().parents
    package, root = above[2], above[min(4, len(above) - 1)]
    script = root / "scripts" / "version.sh"
    # A program of another project that lies around the copy is none of ours.
    if package != root / "clients" / "python" or not script.is_file():
        return "0+unknown"
    return subprocess.run(["bash", str(script)], check=True, capture_output=True, text=True).stdout.strip()


__version__ = python_version(_of_project())
