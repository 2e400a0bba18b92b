"""The gateway that the first view of a client of `serve` starts, and the cell that shows its page."""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

import isoscope
import skips
from conftest import ROOT
from isoscope import viewer
from isoscope._serving import notebook_origins as origins
from isoscope._serving.programs import find_beside
from test_local import children_of, is_alive, wait_until

HERE = "http://localhost:8888"


@pytest.fixture(autouse=True)
def without_widgets(monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    viewer._widget_class.cache_clear()
    yield
    viewer._widget_class.cache_clear()


@pytest.fixture(scope="module")
def client(folder, programs):
    if not (programs / "isoscope-gateway").is_file():
        pytest.fail(f"no program {programs / 'isoscope-gateway'} beside isoscope: the build makes both")
    with isoscope.serve(folder, renderer="cpu", threads=2) as client:
        yield client


@pytest.fixture(scope="module")
def dataset(client):
    return client["shells"]


def get(url, **headers):
    """Returns status, headers and body."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(urllib.request.Request(url, headers=headers), timeout=30) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def script_of(view):
    html = view._repr_mimebundle_()["text/html"]
    assert html.count("<script>") == html.count("</script>") == 1
    return re.search(r"<script>(.*)</script>", html, re.DOTALL).group(1)


def token_in(script):
    return re.search(r'"\\?[&?]token=([^"&]*)"', script).group(1)


def test_the_first_view_starts_a_gateway_whose_page_the_cell_shows(client, dataset):
    view = dataset.view(127.5, size=(800, 600), origin=HERE)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", view.gateway) and "the gateway's page" in repr(view)
    script = script_of(view)
    assert "iframe" in script and "width:1128px;height:648px" in script
    # A smaller one would be the page of a phone.
    assert "width:780px;height:440px" in script_of(dataset.view(127.5, size=(300, 200), origin=HERE))
    token = token_in(script)
    status, headers, body = get(f"{view.gateway}v1/datasets?token={token}")
    assert status == 200 and json.loads(body)["datasets"][0]["name"] == "shells"
    assert get(f"{view.gateway}v1/datasets")[0] == 401
    # The page of the notebook, and no other, may show the page and take its module.
    status, headers, _ = get(view.gateway)
    assert status == 200 and HERE in re.search("frame-ancestors[^;]*", headers["Content-Security-Policy"]).group()
    assert get(f"{view.gateway}view-state.js", Origin=HERE)[1]["Access-Control-Allow-Origin"] == HERE
    assert get(f"{view.gateway}view-state.js", Origin="http://localhost:1")[0] == 403


def test_the_cell_and_the_command_lines_tell_no_token_of_the_server(client, dataset):
    view = dataset.view(127.5, size=(32, 32), origin=HERE)
    token = pathlib.Path(client.token_file).read_text()
    own = token_in(script_of(view))
    assert token != own and token not in str(view._repr_mimebundle_())
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes()
        except OSError:
            continue
        assert own.encode() not in words and token.encode() not in words, path
    for path in pathlib.Path(client.token_file).parent.iterdir():
        assert path.stat().st_mode & 0o777 == 0o600, path


def test_the_pages_address_is_the_view_in_the_words_of_the_page(dataset):
    if not shutil.which("node"):
        skips.skip("node", "no node to run the cell's script with")
    surfaces = [isoscope.Surface(127.5, color="tan", opacity=0.4), isoscope.Surface(60, color_by="z:turbo")]
    clip = isoscope.Clip(planes=[(1, 0, 0, 10)])
    view = dataset.view(surfaces=surfaces, view="top", clip=clip, size=(64, 48), origin=HERE)
    module = json.dumps((ROOT / "clients" / "web" / "view-state.js").as_uri())
    script = script_of(view).replace("new URL('view-state.js', base).href", module)
    assert module in script
    stub = """
        const note = {}, root = {querySelector: () => note, replaceChildren: (frame) => {
          const {stateFromHash} = modules;
          const url = new URL(frame.src);
          console.log(JSON.stringify({origin: url.origin, query: Object.fromEntries(url.searchParams),
            read: stateFromHash(url.hash), title: frame.title}));
        }};
        const modules = await import(PATH);
        globalThis.location = {origin: 'http://localhost:8888'};
        globalThis.document = {baseURI: 'http://localhost:8888/notebooks/a.ipynb', body: {dataset: {jpThemeLight: 'false'}},
          getElementById: () => root, createElement: () => ({style: {}})};
    """.replace("PATH", module)
    done = subprocess.run(["node", "--input-type=module", "-"], input=stub + script, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["origin"] + "/" == view.gateway and said["query"]["theme"] == "dark" and said["query"]["token"]
    assert said["read"]["problems"] == [] and said["title"] == "isosurface of shells"
    state = said["read"]["state"]
    assert [one["isovalue"] for one in state["surfaces"]] == [127.5, 60] and state["dataset"] == "shells"
    assert state["surfaces"][0]["color"]["alpha"] == pytest.approx(0.4)
    eye = dataset.camera("top").eye
    assert [state["camera"]["eye"][axis] for axis in "xyz"] == list(eye)
    assert "backgroundColor" not in state, "the page has that of the theme"


@pytest.mark.filterwarnings("ignore::isoscope.SurfaceWarning")
def test_an_isovalue_alone_is_a_surface_of_the_page(dataset):
    for isovalue in (0, 127.5):
        script = script_of(dataset.view(isovalue, size=(16, 16), origin=HERE))
        state = json.loads(re.search(r"stateToHash\((.*)\);", script).group(1))
        assert [one["isovalue"] for one in state["surfaces"]] == [isovalue] and "isovalue" not in state


def test_another_origin_joins_at_the_same_address(dataset):
    first = dataset.view(127.5, size=(16, 16), origin=HERE)
    second = dataset.view(127.5, size=(16, 16), origin="https://hub.example.org")
    assert first.gateway == second.gateway and token_in(script_of(first)) == token_in(script_of(second))
    for origin in (HERE, "https://hub.example.org"):
        status, headers, _ = get(f"{first.gateway}view-state.js", Origin=origin)
        assert status == 200 and headers["Access-Control-Allow-Origin"] == origin


def test_a_text_that_is_no_origin_leaves_the_cells_of_before(dataset):
    first = dataset.view(127.5, size=(16, 16), origin=HERE)
    wrong = dataset.view(127.5, size=(16, 16), origin="no origin")
    assert "is not an origin" in wrong._repr_mimebundle_()["text/html"] and not wrong.gateway
    status, headers, _ = get(f"{first.gateway}view-state.js", Origin=HERE)
    assert status == 200 and headers["Access-Control-Allow-Origin"] == HERE


def test_a_gateway_that_died_is_started_again_and_none_outlives_its_client(folder):
    with isoscope.serve(folder, renderer="cpu", threads=1) as client:
        before = {pid for pid, _ in children_of(os.getpid())}
        client["shells"].view(127.5, size=(16, 16), origin=HERE)

        def gateways():
            keepers = {pid for pid, _ in children_of(os.getpid())} - before
            found = [one for keeper in keepers for one in children_of(keeper)]
            return [pid for pid, args in found if "isoscope-gateway" in args and "sh -c" not in args]

        (pid,) = gateways()
        os.kill(pid, 9)
        assert wait_until(lambda: not is_alive(pid))
        assert wait_until(lambda: not gateways())
        view = client["shells"].view(127.5, size=(16, 16), origin=HERE)
        assert get(view.gateway)[0] == 200
        (pid,) = gateways()
    assert wait_until(lambda: not is_alive(pid))
    dead = client._start_gateway
    with pytest.raises(isoscope.IsoscopeError, match="closed"):
        dead([HERE])


def test_without_the_program_the_cell_is_the_picture_and_says_why(folder, programs, tmp_path, monkeypatch):
    (tmp_path / "isoscope").symlink_to(programs / "isoscope")
    copied = tmp_path / "copied"
    copied.mkdir()
    (copied / "isoscope").write_text(f'#!/bin/sh\nexec "{programs}/isoscope" "$@"\n')
    (copied / "isoscope").chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setenv("ISOSCOPE_BIN", str(copied))
    assert find_beside(str(copied / "isoscope"), "isoscope-gateway") is None
    # Beside what a link means, it is found.
    beside = pathlib.Path(find_beside(str(tmp_path / "isoscope"), "isoscope-gateway"))
    assert beside.parent == (programs / "isoscope").resolve().parent
    with isoscope.serve(folder, renderer="cpu", threads=1) as client:
        html = client["shells"].view(127.5, size=(16, 16))._repr_mimebundle_()["text/html"]
    assert "isoscope-gateway&#x27; is neither beside" in html and "<script" not in html


def test_a_gateway_without_frames_serves_the_module(folder, programs, tmp_path, monkeypatch):
    """A gateway of a version before --allow-framing."""
    for name in ("isoscope", "isoscope-gateway"):
        said = "The following arguments were not expected: --allow-framing\\nRun with --help for more information."
        refuses = f'case "$*" in *--allow-framing*) printf "{said}\\n" >&2; exit 2;; esac\n'
        first = refuses if name != "isoscope" else ""
        (tmp_path / name).write_text(f'#!/bin/sh\n{first}exec "{programs / name}" "$@"\n')
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("ISOSCOPE_BIN", str(tmp_path))
    with isoscope.serve(folder, renderer="cpu", threads=1) as client:
        view = client["shells"].view(127.5, size=(16, 16), origin=HERE)
        html = view._repr_mimebundle_()["text/html"]
        assert "iframe" not in html and "mount(live" in html and "inlined, frames from http" in repr(view)
        assert get(f"{view.gateway}view-state.js", Origin=HERE)[1]["Access-Control-Allow-Origin"] == HERE


# ---- origins of notebooks


@pytest.fixture
def runtime(tmp_path, monkeypatch):
    for name in ("ISOSCOPE_ALLOW_ORIGIN", "JPY_PARENT_PID"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setitem(sys.modules, "jupyter_core.paths", None)

    def add(name, **server):
        (tmp_path / name).write_text(json.dumps(server))

    return add


def test_the_origin_is_that_of_the_server_that_started_the_kernel(runtime, monkeypatch):
    other = subprocess.Popen(["sleep", "60"])
    try:
        runtime("jpserver-1.json", pid=os.getpid(), url="http://localhost:8890/lab/")
        runtime("nbserver-2.json", pid=other.pid, url="https://Host.Example:9999/")
        runtime("jpserver-3.json", pid=2**22 + 1, url="http://localhost:1/")
        monkeypatch.setenv("JPY_PARENT_PID", str(other.pid))
        assert origins.notebook_origins() == (
            "https://host.example:9999", "https://localhost:9999", "https://127.0.0.1:9999",
        )  # fmt: skip
        monkeypatch.delenv("JPY_PARENT_PID")
        found = origins.notebook_origins()
        assert {"http://localhost:8890", "http://127.0.0.1:8890", "https://host.example:9999"} <= set(found)
        assert not any(origin.endswith(":1") for origin in found)
    finally:
        other.kill()
        other.wait()


def test_without_a_server_it_is_jupyters_usual_port_and_a_variable_adds_to_it(runtime, monkeypatch, tmp_path):
    (tmp_path / "jpserver-4.json").write_text("no JSON")
    runtime("jpserver-5.json", pid=os.getpid(), url="unix:///tmp/a")
    runtime("jpserver-6.json", pid="none", url="http://a:1/")
    usual = ("http://localhost:8888", "http://127.0.0.1:8888")
    assert origins.notebook_origins() == usual
    monkeypatch.setenv("ISOSCOPE_ALLOW_ORIGIN", "https://hub.example.org https://other.example.org")
    assert origins.notebook_origins() == ("https://hub.example.org", "https://other.example.org", *usual)
    runtime("jpserver-7.json", pid=os.getpid(), url="http://localhost:80/")
    assert "http://127.0.0.1" in origins.notebook_origins()
