"""The package itself: messages as current as the protos, types, the wheel."""

import filecmp
import importlib.util
import pathlib
import shutil
import subprocess
import sys
import zipfile

import skips
from conftest import PACKAGE, ROOT


def version_of(program):
    if shutil.which(program) is None:
        return None
    return subprocess.run([program, "--version"], capture_output=True, text=True).stdout.strip()


def test_the_messages_are_those_of_the_protos(tmp_path):
    if version_of("protoc") != "libprotoc 3.21.12" or shutil.which("grpc_python_plugin") is None:
        skips.skip("protoc", "needs protoc 3.21.12 and grpc_python_plugin (protobuf-compiler, protobuf-compiler-grpc)")
    subprocess.run([PACKAGE / "tools" / "regenerate_proto.sh", tmp_path], check=True)
    committed = PACKAGE / "src" / "isoscope" / "_proto"
    names = sorted(path.name for path in tmp_path.iterdir())
    kept = sorted(path.name for path in committed.iterdir() if "_pb2" in path.name)
    assert names == kept, "run clients/python/tools/regenerate_proto.sh"
    _, differ, missing = filecmp.cmpfiles(tmp_path, committed, names, shallow=False)
    assert not differ and not missing, f"{differ}: run clients/python/tools/regenerate_proto.sh"


def test_the_types_are_strict():
    if importlib.util.find_spec("mypy") is None:
        skips.skip("python", "no mypy")
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", "--cache-dir", "/dev/null"]
    done = subprocess.run(command, cwd=PACKAGE, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_no_message_shows_in_the_api():
    """Signatures of public functions and fields name no class of protobuf."""
    import inspect

    import isoscope

    shown = []
    for name in isoscope.__all__:
        thing = getattr(isoscope, name)
        members = [(name, thing)] + [(f"{name}.{key}", member) for key, member in inspect.getmembers(thing)]
        for path, member in members:
            if not any(part.startswith("_") for part in path.split(".")) and inspect.isfunction(member):
                text = str(inspect.signature(member))
                if "_pb" in text or "pb." in text:
                    shown.append(path)
    assert shown == []


def test_every_public_name_is_documented():
    import inspect

    import isoscope

    for name in isoscope.__all__:
        thing = getattr(isoscope, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            assert inspect.getdoc(thing), name
        if inspect.isclass(thing) and thing.__module__.startswith("isoscope"):
            for key, member in vars(thing).items():
                if not key.startswith("_") and inspect.isfunction(member):
                    assert inspect.getdoc(member), f"{name}.{key}"


def test_the_wheel_is_built_installed_and_imported(tmp_path):
    for module in ("setuptools", "wheel", "pip"):
        if importlib.util.find_spec(module) is None:
            skips.skip("python", f"no {module} (python3-{module}) to build a wheel with")
    # A copy: building writes beside setup.py.
    source = tmp_path / "clients" / "python"
    shutil.copytree(PACKAGE, source, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build"))
    viewer = ROOT / "clients" / "web" / "isoscope-view.js"
    if viewer.is_file():
        (tmp_path / "clients" / "web").mkdir()
        shutil.copy(viewer, tmp_path / "clients" / "web")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    flags = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet"]
    subprocess.run([*pip, "wheel", *flags, "--wheel-dir", tmp_path / "wheels", source], check=True)
    (wheel,) = (tmp_path / "wheels").iterdir()
    assert wheel.name == "isoscope-0.1.0-py3-none-any.whl"
    names = zipfile.ZipFile(wheel).namelist()
    assert {"isoscope/py.typed", "isoscope/_proto/frame_pb2.py", "isoscope/_proto/frame_pb2.pyi"} <= set(names)
    assert ("isoscope/_static/isoscope-view.js" in names) == viewer.is_file()
    assert not any("test" in name for name in names)
    site = tmp_path / "site"
    subprocess.run([*pip, "install", *flags, "--target", site, wheel], check=True)
    code = "import isoscope; print(isoscope.__version__, isoscope.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", code], env={"PYTHONPATH": str(site)}, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.split()[0] == "0.1.0" and pathlib.Path(done.stdout.split()[1]).is_relative_to(site), done.stderr
