"""The package itself: messages as current as the protos, types, the wheel."""

import ast
import filecmp
import graphlib
import importlib.util
import os
import pathlib
import runpy
import shutil
import subprocess
import sys
import tarfile
import zipfile

import pytest

import skips
from conftest import PACKAGE, ROOT


def version_of(program):
    if shutil.which(program) is None:
        return None
    return subprocess.run([program, "--version"], capture_output=True, text=True).stdout.strip()


def test_the_messages_are_those_of_the_protos(tmp_path):
    if version_of("protoc") != "libprotoc 3.21.12":
        skips.skip("protoc", "needs protoc 3.21.12 (protobuf-compiler)")
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


def test_modules_import_each_other_in_one_direction():
    """Also those that functions import, or type checkers alone."""
    source = PACKAGE / "src"
    paths = [path for path in source.rglob("*.py") if path.stem != "__init__" and path.parent.name != "_proto"]
    modules = {".".join(path.relative_to(source).with_suffix("").parts): path for path in paths}
    assert {"isoscope.local", "isoscope._serving.gateway"} <= modules.keys()
    imported = {name: set() for name in modules}
    for name, path in modules.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                imported[name] |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)} & modules.keys()
    graphlib.TopologicalSorter(imported).prepare()  # raises CycleError


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


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """The wheel and the sdist that `python3 -m build` makes of the checkout; $ISOSCOPE_VERSION is 3.2.1-4-gabc."""
    for module in ("build", "setuptools", "wheel", "pip", "ensurepip"):
        if importlib.util.find_spec(module) is None:
            skips.skip("python", f"no {module} (python3-{module}) to build a wheel with")
    # A copy: building writes beside setup.py.
    copy = tmp_path_factory.mktemp("checkout")
    source = copy / "clients" / "python"
    shutil.copytree(PACKAGE, source, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build", "dist"))
    shutil.copytree(ROOT / "clients" / "web", copy / "clients" / "web")
    for name in ("CMakeLists.txt", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    command = [sys.executable, "-m", "build", "--no-isolation", source]
    environment = {**os.environ, "ISOSCOPE_VERSION": "3.2.1-4-gabc"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,), (archive,) = (source / "dist").glob("*.whl"), (source / "dist").glob("*.tar.gz")
    return {".whl": wheel, ".tar.gz": archive}


def test_wheel_and_sdist_hold_messages_types_viewer_and_the_projects_version(distributions):
    assert distributions[".whl"].name == "isoscope-3.2.1+4.gabc-py3-none-any.whl"
    assert distributions[".tar.gz"].name == "isoscope-3.2.1+4.gabc.tar.gz"
    inside = {
        "isoscope/py.typed", "isoscope/_proto/frame_pb2.py", "isoscope/_proto/frame_pb2.pyi",
        "isoscope/_proto/isosurface_service_pb2.py", "isoscope/_static/isoscope-view.js",
    }  # fmt: skip
    names = zipfile.ZipFile(distributions[".whl"]).namelist()
    assert inside <= set(names) and not any("test" in name for name in names)
    with tarfile.open(distributions[".tar.gz"]) as archive:
        sources = {name.partition("/")[2] for name in archive.getnames()}
    assert {f"src/{name}" for name in inside} | {"setup.py", "README.md", "LICENSE"} <= sources
    assert not any(name.startswith(("tests", "tools")) for name in sources)


@pytest.mark.parametrize("kind", [".whl", ".tar.gz"])
def test_what_was_built_is_installed_in_a_fresh_environment_and_renders(
    distributions, programs, folder, tmp_path, kind
):
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "ISOSCOPE_VERSION")}
    flags = ["--disable-pip-version-check", "--no-index", "--no-deps", "--no-build-isolation", "--quiet"]
    install = [python, "-m", "pip", "install", *flags, distributions[kind]]
    done = subprocess.run(install, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    code = (
        "import isoscope, sys\n"
        "from isoscope import _viewer_module\n"
        "assert 'export default' in _viewer_module.text()\n"
        "print(isoscope.__version__, isoscope.__file__)\n"
        "with isoscope.serve(sys.argv[1], renderer='cpu') as client:\n"
        "    print(client.dataset().render(127.5, size=24).rgb.shape)\n"
    )
    done = subprocess.run(
        [python, "-c", code, folder], env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    version, path = first.split()
    assert version == "3.2.1+4.gabc" and second == "(24, 24, 3)"
    assert pathlib.Path(path).is_relative_to(tmp_path / "venv"), path


def test_a_copy_of_the_folder_alone_is_installed_and_works(tmp_path):
    for module in ("setuptools", "wheel", "pip"):
        if importlib.util.find_spec(module) is None:
            skips.skip("python", f"no {module} (python3-{module}) to install with")
    # It lies as in a checkout of another project, whose program is not run.
    copy = tmp_path / "other" / "vendored" / "isoscope"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build", "dist"))
    (tmp_path / "other" / "scripts").mkdir()
    (tmp_path / "other" / "scripts" / "version.sh").write_text("echo 6.6.6\n")
    environment = {name: value for name, value in os.environ.items() if name != "ISOSCOPE_VERSION"}
    others = [part for part in environment.pop("PYTHONPATH").split(os.pathsep) if part != str(PACKAGE / "src")]
    flags = ["--disable-pip-version-check", "--no-index", "--no-deps", "--no-build-isolation", "--quiet"]
    install = [sys.executable, "-m", "pip", "install", *flags, "--target", tmp_path / "installed", copy]
    done = subprocess.run(install, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    code = "import isoscope; print(isoscope.__version__, isoscope.__file__)"
    for path, folder in (("installed", "installed/isoscope"), ("other/vendored/isoscope/src",) * 2):
        found = {**environment, "PYTHONPATH": os.pathsep.join([str(tmp_path / path), *others])}
        done = subprocess.run([sys.executable, "-c", code], env=found, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        version, file = done.stdout.split()
        assert version == "0+unknown" and pathlib.Path(file).is_relative_to(tmp_path / folder), done.stdout
    named = subprocess.run(
        [sys.executable, "-c", code], env={**found, "ISOSCOPE_VERSION": "1.2.3"}, capture_output=True, text=True
    )
    assert named.stdout.startswith("1.2.3 "), named.stderr


def test_the_version_is_that_of_the_whole_project(monkeypatch):
    path = PACKAGE / "src" / "isoscope" / "_version.py"
    monkeypatch.delenv("ISOSCOPE_VERSION", raising=False)
    module = runpy.run_path(str(path))
    said = subprocess.run(["bash", ROOT / "scripts" / "version.sh"], capture_output=True, text=True, check=True)
    assert module["__version__"] == said.stdout.strip()
    for text, expected in {
        "1.2.3": "1.2.3", "v1.2.3": "1.2.3", "v1.2-7-g0abc12": "1.2+7.g0abc12", "1.2.3-dirty": "1.2.3+dirty",
        "1.2-7-gabc-dirty": "1.2+7.gabc.dirty", "1.2rc1": "1.2rc1", "1.2+7.gabc": "1.2+7.gabc",
    }.items():  # fmt: skip
        assert module["python_version"](text) == expected
    with pytest.raises(ValueError, match="git describe"):
        module["python_version"]("8c9ec9f")
    monkeypatch.setenv("ISOSCOPE_VERSION", "9.8.7")
    assert runpy.run_path(str(path))["__version__"] == "9.8.7"
