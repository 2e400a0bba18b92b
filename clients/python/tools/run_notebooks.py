#!/usr/bin/env python3
"""Executes the example notebooks and saves them with their outputs, for a change of the client or of pictures.

    ISOSCOPE_BIN=build/release/bin /usr/bin/python3 clients/python/tools/run_notebooks.py [FILE.ipynb ...]

Needs python3-nbclient (or nbconvert) and python3-ipykernel.
"""

import os
import pathlib
import sys
import tempfile

import nbclient
import nbformat
import traitlets.config

PACKAGE = pathlib.Path(__file__).resolve().parents[1]


def execute(path: pathlib.Path) -> nbformat.NotebookNode:
    """Returns the notebook with new outputs, and without what differs from run to run."""
    source = os.pathsep.join(filter(None, [str(PACKAGE / "src"), os.environ.get("PYTHONPATH")]))
    os.environ.update(PYTHONPATH=source, PYDEVD_DISABLE_FILE_VALIDATION="1")
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        # Sockets are files: a port that a kernel is given may be another program's when it binds it.
        sockets = {"transport": "ipc", "ip": os.path.join(folder, "kernel")}
        nbclient.NotebookClient(
            notebook,
            timeout=120,
            kernel_name="python3",
            resources={"metadata": {"path": str(path.parent)}},
            config=traitlets.config.Config(KernelManager=sockets),
        ).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        for output in cell.get("outputs", []):
            # The page of a view has an address and a token that end with the kernel; its picture stays.
            if "stateToHash" in output.get("data", {}).get("text/html", ""):
                del output.data["text/html"]
    notebook.metadata = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return notebook


def main() -> None:
    if programs := os.environ.get("ISOSCOPE_BIN"):
        # Kernels run in the folder of their notebook.
        os.environ["ISOSCOPE_BIN"] = os.path.abspath(programs)
    paths = [pathlib.Path(name) for name in sys.argv[1:]] or sorted((PACKAGE / "examples").glob("*.ipynb"))
    for path in paths:
        nbformat.write(execute(path), path)
        print(f"{path}: {path.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
