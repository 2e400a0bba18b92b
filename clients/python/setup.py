"""Builds the wheel: takes the viewer's module along from where the web client keeps it."""

import pathlib
import shutil

from setuptools import setup
from setuptools.command.build_py import build_py

HERE = pathlib.Path(__file__).resolve().parent
VIEWER = HERE.parent / "web" / "isoscope-view.js"


class BuildWithViewer(build_py):
    """Copies clients/web/isoscope-view.js to isoscope/_static, where the folder is there."""

    def run(self):
        super().run()
        if VIEWER.is_file():
            static = pathlib.Path(self.build_lib) / "isoscope" / "_static"
            static.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(VIEWER, static / VIEWER.name)


setup(cmdclass={"build_py": BuildWithViewer})
