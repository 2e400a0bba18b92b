"""The origins of the pages that show this notebook: "http://localhost:8888".

A kernel is not told them. A Jupyter server writes a file for each of its processes into the runtime folder of the user,
and tells its kernels the number of its process. Browsers call the loopback address by several names.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import pathlib
import sys
from typing import Any
from urllib.parse import urlsplit

_LOOPBACK_NAMES = ("localhost", "127.0.0.1")
_USUAL_PORT = 8888
# Browsers leave these out of an origin.
_DEFAULT_PORTS = {"http": 80, "https": 443}


def notebook_origins() -> tuple[str, ...]:
    """Returns those of $ISOSCOPE_ALLOW_ORIGIN, and of the Jupyter server that started this kernel.

    If that is unknown, those of all Jupyter servers of this user; without any, those of Jupyter's usual port.
    """
    named = os.environ.get("ISOSCOPE_ALLOW_ORIGIN", "").split()
    servers = _servers()
    parent = os.environ.get("JPY_PARENT_PID")
    mine = [server for server in servers if str(server.get("pid")) == parent]
    found = [origin for server in mine or servers for origin in _origins_of(server)]
    return tuple(dict.fromkeys([*named, *(found or _loopback_origins("http", _USUAL_PORT))]))


def _runtime_folder() -> pathlib.Path:
    with contextlib.suppress(Exception):
        paths: Any = importlib.import_module("jupyter_core.paths")
        return pathlib.Path(paths.jupyter_runtime_dir())
    named = os.environ.get("JUPYTER_RUNTIME_DIR")
    if named:
        return pathlib.Path(named)
    if sys.platform == "darwin":
        return pathlib.Path.home() / "Library" / "Jupyter" / "runtime"
    data = os.environ.get("XDG_DATA_HOME") or pathlib.Path.home() / ".local" / "share"
    return pathlib.Path(data) / "jupyter" / "runtime"


def _servers() -> list[dict[str, Any]]:
    """Returns what the Jupyter servers that run say of themselves, the newest first."""
    found: list[tuple[float, dict[str, Any]]] = []
    with contextlib.suppress(OSError):
        for pattern in ("jpserver-*.json", "nbserver-*.json"):
            for path in _runtime_folder().glob(pattern):
                with contextlib.suppress(OSError, ValueError):
                    server = json.loads(path.read_text(encoding="utf-8"))
                    if isinstance(server, dict) and _is_alive(server.get("pid")):
                        found.append((path.stat().st_mtime, server))
    return [server for _, server in sorted(found, key=lambda one: one[0], reverse=True)]


def _is_alive(pid: Any) -> bool:
    if not isinstance(pid, int) or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except OSError:
        return False
    return True


def _loopback_origins(scheme: str, port: int) -> list[str]:
    end = "" if port == _DEFAULT_PORTS[scheme] else f":{port}"
    return [f"{scheme}://{name}{end}" for name in _LOOPBACK_NAMES]


def _origins_of(server: dict[str, Any]) -> list[str]:
    try:
        url = urlsplit(str(server.get("url", "")))
        port = url.port or _DEFAULT_PORTS[url.scheme]
    except (KeyError, ValueError):
        return []
    if not url.hostname:
        return []
    origin = f"{url.scheme}://{url.netloc.rpartition('@')[2].lower()}"
    return [origin, *_loopback_origins(url.scheme, port)]
