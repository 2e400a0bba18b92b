"""The examples of docs/python.md run, in one go, and hold what they say."""

import importlib.util
import re

import numpy as np
import pytest

import isoscope
import skips
from conftest import ROOT

PAGE = ROOT / "docs" / "python.md"


def test_the_examples_of_arrays_run(programs, tmp_path, monkeypatch):
    for module in ("xarray", "dask", "zarr", "fsspec"):
        if importlib.util.find_spec(module) is None:
            skips.skip("python", f"no {module} (python3-{module})")
    section = PAGE.read_text(encoding="utf-8").partition("\n## Arrays of a notebook\n")[2]
    blocks = re.findall(r"^```python\n(.*?)^```$", section, re.DOTALL | re.MULTILINE)
    assert len(blocks) >= 4
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)  # the project's own page
    frame, ball = names["frame"], names["ball"]
    with isoscope.serve(ball, spacing=(1, 0.25, 0.5), origin=(0, 10, 0)) as client:
        assert client.dataset().render(0.7, size=(80, 60)).png == frame.png
    assert (tmp_path / "ball.png").read_bytes() == frame.png and (tmp_path / "ball.stl").stat().st_size > 1000
    assert float(names["nearest"]) == pytest.approx(np.nanmin(names["planes"].depth))
    assert 19 < float(names["top"]) < 20 and int(names["counts"].sum()) == ball.size
