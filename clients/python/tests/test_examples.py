"""The web back ends of examples/: each runs, gives the exact picture, and passes refusals on."""

import importlib.util
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import skips
from conftest import ROOT
from free_ports import free_port


def get(url):
    """Returns the HTTP status and the body."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(url, timeout=30) as response:
            return response.status, response.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def check_endpoint(command, cwd, port, dataset, environment=None):
    process = subprocess.Popen(
        command, cwd=cwd, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        for _ in range(1200):
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                assert process.poll() is None, process.stderr.read()
                time.sleep(0.1)
        base = f"http://127.0.0.1:{port}"
        status, body = get(f"{base}/shells.png?isovalue=127.5&width=120&height=90")
        assert status == 200 and body == dataset.render(127.5, view="front", size=(120, 90)).png
        status, body = get(f"{base}/head.png?isovalue=1")
        assert status == 404 and b'there are: "shells"' in body
        status, body = get(f"{base}/shells.png?isovalue=1&width=0")
        assert status == 400 and b"viewport.width_px is 0" in body
        status, body = get(f"{base}/shells.png?isovalue=127.5&width=1400&height=1200")
        assert status == 200 and body == dataset.render(127.5, view="front", size=(1400, 1200)).png
    finally:
        process.terminate()
        process.wait(120)
        process.stderr.close()


def test_the_python_back_end_serves_exact_pictures(client, dataset):
    if importlib.util.find_spec("aiohttp") is None:
        skips.skip("python", "no aiohttp (python3-aiohttp)")
    port = free_port()
    script = ROOT / "examples" / "python" / "picture_server.py"
    server = ["--server", client.address, "--token-file", client.token_file]
    check_endpoint([sys.executable, script, *server, "--port", str(port)], ROOT, port, dataset)


def test_the_node_back_end_serves_exact_pictures(client, dataset, tmp_path):
    if shutil.which("npm") is None or shutil.which("node") is None:
        skips.skip("node", "no node and npm")
    # A copy: npm writes beside package.json.
    folder = tmp_path / "examples" / "node"
    shutil.copytree(ROOT / "examples" / "node", folder, ignore=shutil.ignore_patterns("node_modules"))
    shutil.copytree(ROOT / "proto", tmp_path / "proto")
    command = ["npm", "install", "--no-audit", "--no-fund", "--no-package-lock", "--fetch-timeout=30000"]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    except subprocess.TimeoutExpired:
        skips.skip("npm", "npm install takes more than two minutes")
    if done.returncode != 0:
        skips.skip("npm", f"npm can't install here: {done.stderr.strip()[-200:]}")
    port = free_port()
    environment = {**os.environ, "ISOSCOPE_TOKEN": pathlib.Path(client.token_file).read_text()}
    check_endpoint(["node", "picture_server.js", client.address, str(port)], folder, port, dataset, environment)
