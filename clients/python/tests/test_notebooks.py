"""The example notebooks: they run, show the pictures that are saved in them, and keep these as HTML."""

import base64
import importlib.util

import pytest

import skips
from conftest import PACKAGE

NOTEBOOKS = sorted((PACKAGE / "examples").glob("*.ipynb"))


def pictures(notebook):
    """The PNGs of all cells, in order."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    encoded = [output["data"]["image/png"] for output in outputs if "image/png" in output.get("data", {})]
    return [base64.b64decode(text) for text in encoded]


@pytest.fixture
def execute(programs, monkeypatch):
    for module in ("nbclient", "nbformat", "ipykernel"):
        if importlib.util.find_spec(module) is None:
            skips.skip("python", f"no {module} (python3-{module}) to execute notebooks with")
    monkeypatch.syspath_prepend(str(PACKAGE / "tools"))
    from run_notebooks import execute

    return execute


def test_there_are_examples():
    assert len(NOTEBOOKS) >= 4


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_the_pictures_that_it_holds(execute, path):
    import nbformat

    saved = nbformat.read(path, as_version=4)
    for module in ("xarray", "dask"):
        if f"import {module}" in path.read_text(encoding="utf-8") and importlib.util.find_spec(module) is None:
            skips.skip("python", f"no {module} (python3-{module}) for {path.name}")
    nbformat.validate(saved)
    assert path.stat().st_size < 300 * 1024
    expected = pictures(saved)
    assert expected and all(png[:8] == b"\x89PNG\r\n\x1a\n" for png in expected)
    assert pictures(execute(path)) == expected, "run clients/python/tools/run_notebooks.py, and look at the pictures"


def test_the_html_of_a_notebook_holds_its_pictures():
    if importlib.util.find_spec("nbconvert") is None:
        skips.skip("python", "no nbconvert (python3-nbconvert)")
    import nbconvert
    import nbformat

    for path in NOTEBOOKS:
        notebook = nbformat.read(path, as_version=4)
        html, _ = nbconvert.HTMLExporter().from_notebook_node(notebook)
        text = "".join(html.split())
        for png in pictures(notebook):
            assert base64.b64encode(png).decode() in text, path.name


