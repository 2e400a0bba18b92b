"""Builds the wheel and the sdist: each gets the version of the project, and the viewer's module of clients/web.

An sdist holds both, so that a wheel is built from it without the rest of the repository.
"""

import os
import pathlib
import runpy
import shutil

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = HERE / "src" / "isoscope"
VIEWER = HERE.parent / "web" / "isoscope-view.js"
ASSEMBLE = runpy.run_path(str(PACKAGE / "_viewer_module.py"))["assemble"]
LICENSE = HERE.parents[1] / "LICENSE" if len(HERE.parents) > 1 else HERE / "LICENSE"
IS_CHECKOUT = not (HERE / "PKG-INFO").exists()
VERSION = runpy.run_path(str(PACKAGE / "_version.py"))["__version__"]


def complete(package):
    """Puts into a built package what a checkout keeps elsewhere."""
    version = package / "_version.py"
    # It may be a hard link to the file of the checkout.
    version.unlink(missing_ok=True)
    version.write_text(f'"""The version, as setup.py found it."""\n\n__version__ = "{VERSION}"\n', encoding="utf-8")
    if IS_CHECKOUT and VIEWER.is_file():
        (package / "_static").mkdir(exist_ok=True)
        (package / "_static" / VIEWER.name).write_text(ASSEMBLE(VIEWER), encoding="utf-8")


class BuildComplete(build_py):
    """Completes the package of the wheel."""

    def run(self):
        super().run()
        if not getattr(self, "editable_mode", False):
            complete(pathlib.Path(self.build_lib) / "isoscope")


class SourcesComplete(sdist):
    """Completes the package of the sdist."""

    def make_release_tree(self, base_dir, files):
        super().make_release_tree(base_dir, files)
        complete(pathlib.Path(base_dir, "src", "isoscope"))
        if IS_CHECKOUT and LICENSE.is_file():
            shutil.copyfile(LICENSE, os.path.join(base_dir, "LICENSE"))


setup(version=VERSION, cmdclass={"build_py": BuildComplete, "sdist": SourcesComplete})
