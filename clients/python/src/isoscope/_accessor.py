"""`array.isoscope` of every xarray.DataArray and xarray.Dataset: `array.isoscope.render(60)`.

`install` registers it. xarray takes half a second to import, and most programs never do: so xarray that is not imported
yet gets it at the end of its import, by a finder of modules that knows this one name. Without xarray nothing happens.

An accessor serves its array at the first call and keeps the client. xarray keeps one accessor for each object, so a
change in place must not show the samples of before: each call compares a checksum of samples, coordinates and
attributes with that of the array as it was served.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Iterable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

import numpy as np

from isoscope import _core
from isoscope._mesh import Mesh
from isoscope._serving import samples
from isoscope.client import Client, Dataset
from isoscope.data import Histogram, SurfaceMeasures
from isoscope.frame import Frame
from isoscope.local import serve
from isoscope.viewer import View

_NAME = "isoscope"


class IsoscopeAccessor:
    """Pictures of an xarray.DataArray or xarray.Dataset, which is served from this machine at the first call.

        array.isoscope.render(60, view="top")
        array.isoscope.dataset(resample=True)      # with arguments of `isoscope.serve`; later calls keep them
        dataset.isoscope.render(60, field="t", step="last")
        array.isoscope.close()                     # ends the programs at once, not with the array

    Each call compares the array with what is served, and serves it again after a change: it reads all samples that are
    in memory, a gigabyte in about a second. `dataset()` returns what is served, whose calls compare nothing.
    """

    def __init__(self, source: Any) -> None:
        self._source = source
        self._client: Client | None = None
        self._options: dict[str, Any] = {}
        self._state: list[Any] = []

    def serve(self, **options: Any) -> Client:
        """Returns `isoscope.serve(array, **options)`: a client of its own."""
        return serve(self._source, **options)

    def dataset(self, **options: Any) -> Dataset:
        """Returns the served array.

        Args:
            options: arguments of `isoscope.serve`; default: those of the call before.

        Raises:
            InvalidArgumentError, ProgramError: as of `isoscope.serve`.
        """
        options = options or self._options
        state = _state_of(self._source)
        if self._client is None or options != self._options or state != self._state:
            # Frames of before may still ask the client of before, which ends when nobody has it any more.
            self._client = serve(self._source, **options)
            self._options, self._state = options, state
        return self._client.dataset()

    @_core.shaped_like(_core.render)
    def render(self, *what: Any, **how: Any) -> Frame:
        return self.dataset().render(*what, **how)

    @_core.shaped_like(_core.mesh)
    def mesh(self, *what: Any, **how: Any) -> Mesh:
        return self.dataset().mesh(*what, **how)

    @_core.shaped_like(_core.measure)
    def measure(self, *what: Any, **how: Any) -> list[SurfaceMeasures]:
        return self.dataset().measure(*what, **how)

    @_core.shaped_like(_core.histogram)
    def histogram(self, *what: Any, **how: Any) -> Histogram:
        return self.dataset().histogram(*what, **how)

    def view(self, isovalue: float | None = None, **how: Any) -> View:
        """Returns a view for a notebook cell, as `Dataset.view` does."""
        return self.dataset().view(isovalue, **how)

    def close(self) -> None:
        """Ends the programs that serve the array; the next call starts them again. Any number of times."""
        client, self._client = self._client, None
        if client is not None:
            client.close()


# ---- what was served


def _state_of(source: Any) -> list[Any]:
    """Returns what tells an array from itself after a change. Its parts compare; it may hold the samples."""
    variables = (
        {name: source[name].variable for name in source.data_vars}
        if hasattr(source, "data_vars")
        else {source.name: source.variable}
    )
    found: list[Any] = []
    for name, variable in [*variables.items(), *((name, one.variable) for name, one in source.coords.items())]:
        attributes = repr(sorted(map(repr, variable.attrs.items())))
        found.append((str(name), variable.dims, variable.shape, str(variable.dtype), attributes, _samples_of(variable)))
    return found


def _samples_of(variable: Any) -> Any:
    if variable.chunks is not None:  # computed, or read in chunks: such arrays do not change
        return getattr(variable.data, "name", None) or _Same(variable.data)
    held = variable._data  # `data` would read an array that was opened lazily
    if isinstance(held, np.ndarray):
        return _checksum(held)
    return _checksum(variable.values) if variable.ndim <= 1 else _Same(held)


class _Same:
    """An object that is equal to itself alone, and lives as long as this."""

    def __init__(self, held: Any) -> None:
        self._held = held

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other._held is self._held

    __hash__ = None  # type: ignore[assignment]


def _checksum(array: np.ndarray[Any, Any]) -> Any:
    if array.dtype.hasobject:
        return repr(array.tolist())
    total = 0
    held = np.atleast_1d(array)
    for index in samples.parts(held.shape, held.dtype.itemsize):
        total = zlib.crc32(np.ascontiguousarray(held[index]).reshape(-1).view(np.uint8).data, total)
    return total


# ---- registration


def install() -> None:
    """Gives the accessor to xarray: now, or when it is imported."""
    xarray = sys.modules.get("xarray")
    if xarray is not None and hasattr(xarray, "register_dataset_accessor"):
        _register(xarray)
    elif not any(isinstance(one, _Finder) for one in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


def _register(xarray: Any) -> None:
    if not hasattr(xarray.DataArray, _NAME):
        xarray.register_dataarray_accessor(_NAME)(IsoscopeAccessor)
        xarray.register_dataset_accessor(_NAME)(IsoscopeAccessor)


class _Finder(MetaPathFinder):
    """Finds xarray as the other finders do, and has the accessor registered once it is imported."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "xarray":
            return None
        for spec in self._specs(fullname, path, target):
            if spec.loader is not None and hasattr(spec.loader, "exec_module"):
                spec.loader = _Loader(spec.loader, self)
            return spec
        return None

    def _specs(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None
    ) -> Iterable[ModuleSpec]:
        for finder in list(sys.meta_path):
            find = getattr(finder, "find_spec", None)
            if finder is not self and find is not None:
                spec = find(fullname, path, target)
                if spec is not None:
                    yield spec


class _Loader(Loader):
    """Executes a module as its own loader does, and registers the accessor."""

    def __init__(self, loader: Any, finder: _Finder) -> None:
        self._loader = loader
        self._finder = finder

    def __getattr__(self, name: str) -> Any:
        """Gives the rest of the loader to those who only ask whether xarray is there."""
        return getattr(self._loader, name)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        created: ModuleType | None = self._loader.create_module(spec)
        return created

    def exec_module(self, module: ModuleType) -> None:
        # The module looks as if it had been imported without this.
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        if self._finder in sys.meta_path:
            sys.meta_path.remove(self._finder)
        _register(module)
