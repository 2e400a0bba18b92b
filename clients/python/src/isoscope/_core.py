"""The calls of both clients, without I/O: what to send, and what the answer means.

    call = _core.render(dataset, 60)    # checks the arguments, assembles the request
    for message in ...:                 # the client's part: a channel, threads or an event loop
        call.add(message)
    frame = call.result(...)            # decodes the answer
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, ParamSpec, TypeVar, Union, cast, get_type_hints

from isoscope import _answer, _request
from isoscope._call import Call, Do, One
from isoscope._channel import CONNECT_TIMEOUT, DEFAULT_TIMEOUT, Target, make_target
from isoscope._proto import cluster_service_pb2 as cluster_pb
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope.camera import CameraLike
from isoscope.data import (
    AgentState,
    Capabilities,
    DatasetInfo,
    Histogram,
    LabelValues,
    Mesh,
    PickedPoint,
    SurfaceMeasures,
)
from isoscope.errors import InvalidArgumentError
from isoscope.frame import Frame, ImageFormat, PlaneName
from isoscope.labels import Label, LabelsLike
from isoscope.look import (
    AmbientOcclusion,
    ClipLike,
    ColorByLike,
    ColorLike,
    LightLike,
    Silhouette,
    SurfaceLike,
    as_pixels,
)

_P = ParamSpec("_P")
_R = TypeVar("_R")


def shaped_like(model: Callable[_P, Any]) -> Callable[[Callable[..., _R]], Callable[_P, _R]]:
    """Gives a function the parameters and the text of `model`, to which it passes all of its arguments."""

    def shape(function: Any) -> Any:
        returned = function.__annotations__["return"]
        function.__signature__ = inspect.signature(model).replace(return_annotation=returned)
        # Names in the annotations of the model belong to this module, "return" to the function's.
        function.__annotations__ = {**get_type_hints(model), "return": returned}
        function.__doc__ = model.__doc__
        return function

    return shape


# ---------------------------------------------------------------------------------------- of a server


def connection(
    address: str = "localhost:50051",
    *,
    timeout: float = DEFAULT_TIMEOUT,
    connect_timeout: float = CONNECT_TIMEOUT,
    tls: bool | None = None,
    ca_file: str | os.PathLike[str] | None = None,
    cert_file: str | os.PathLike[str] | None = None,
    key_file: str | os.PathLike[str] | None = None,
    server_name: str | None = None,
    token: str | None = None,
    token_file: str | os.PathLike[str] | None = None,
    allow_insecure_token: bool = False,
    metadata: Sequence[tuple[str, str]] = (),
) -> tuple[Target, float]:
    """Connects to a coordinator and asks for its version, so that a wrong address fails here.

        with isoscope.connect("host:50051") as client:
            client["head"].render(isovalue=60).save("head.png")

    `isoscope.aio.connect` is awaited: `await connect(...)`, or `async with connect(...) as client`.

    Args:
        address: HOST:PORT, HOST (port 50051), or unix:PATH.
        timeout: deadline of each call in seconds; calls can have one of their own.
        connect_timeout: deadline of the first call.
        tls: whether to encrypt; by default if a file or a server name is given.
        ca_file: PEM file of the authorities that may have signed the server's certificate.
        cert_file, key_file: PEM files of a client certificate, for servers that want one.
        server_name: name in the server's certificate, where it isn't the address's host. The defaults of these are
            $ISOSCOPE_TLS_CA, $ISOSCOPE_TLS_CERT, $ISOSCOPE_TLS_KEY, $ISOSCOPE_TLS_SERVER_NAME, as of the programs.
        token: sent as `authorization: Bearer TOKEN` with each call; default: $ISOSCOPE_TOKEN.
        token_file: a file with that token, instead.
        allow_insecure_token: send the token unencrypted to another machine.
        metadata: more metadata of each call.

    Raises:
        UnavailableError: no server answers there.
        UnauthenticatedError: the server wants another token.
        InvalidArgumentError: the arguments do not fit each other.

    Calls are tried again on UNAVAILABLE only, four times within some two seconds. Thread-safe. A
    forked child makes a connection of its own, if no call was at work in the moment of the fork; else it refuses calls.
    """
    target = make_target(
        address, tls=tls, ca_file=ca_file, cert_file=cert_file, key_file=key_file, server_name=server_name,
        token=token, token_file=token_file, allow_insecure_token=allow_insecure_token, metadata=metadata,
        timeout=timeout,
    )  # fmt: skip
    return target, connect_timeout


def datasets(timeout: float | None) -> Call[list[dict[str, Any]]]:
    """The fields of each dataset."""
    decode = One(lambda response: [_answer.dataset_fields(proto) for proto in response.datasets])
    return Call(datasets_pb.ListDatasetsRequest(), decode, timeout)


def dataset(name: str, timeout: float | None) -> Call[dict[str, Any]]:
    """The fields of one dataset."""
    decode = One(lambda response: _answer.dataset_fields(response.dataset))
    return Call(datasets_pb.GetDatasetRequest(name=name), decode, timeout)


def capabilities(timeout: float | None) -> Call[Capabilities]:
    """The server's version and limits."""
    return Call(cluster_pb.GetCapabilitiesRequest(), One(_answer.capabilities), timeout)


def agents(timeout: float | None) -> Call[list[AgentState]]:
    """The agents of the cluster."""
    return Call(cluster_pb.GetClusterStatusRequest(), One(_answer.agents), timeout)


# ---------------------------------------------------------------------------------------- of a dataset


@dataclass(frozen=True, kw_only=True, repr=False)
class DatasetOfClient(DatasetInfo):
    """A dataset with the client that its calls go through."""

    _client: Any = field(compare=False)

    def __repr__(self) -> str:
        ends = "empty" if self.range is None else f"{self.range[0]:g} to {self.range[1]:g}"
        return f"Dataset({self.name!r}, {' x '.join(map(str, self.dims))} {self.dtype.name}, {ends})"


# The parameters and the texts of these are those of the methods of both clients' datasets: hence self.


def render(
    self: DatasetOfClient,
    isovalue: float | None = None,
    *,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
    labels: LabelsLike | None = None,
    smooth_labels: bool = False,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | Literal["first", "last"] | None = None,
    color: ColorLike | None = None,
    camera: CameraLike | None = None,
    view: str | None = None,
    azimuth: float | None = None,
    elevation: float | None = None,
    zoom: float | None = None,
    fit: Literal["volume", "surface", "cells"] | None = None,
    size: tuple[int, int] | int = (1024, 1024),
    region: tuple[int, int, int, int] | None = None,
    background: ColorLike | None = None,
    clip: ClipLike | None = None,
    lights: Sequence[LightLike] | LightLike = (),
    color_by: ColorByLike | None = None,
    nan_color: ColorLike | None = None,
    samples: int | None = None,
    ambient_occlusion: AmbientOcclusion | bool = False,
    silhouette: Silhouette | bool = False,
    max_layers: int | None = None,
    level: int | None = None,
    max_spacing: float | None = None,
    culling: Literal["depth", "mask", "none"] = "depth",
    format: ImageFormat = "png",
    quality: int | None = None,
    planes: Sequence[PlaneName] = (),
    allow_partial: bool = False,
    count_unresolved: bool = False,
    timeout: float | None = None,
) -> Call[Frame]:
    """Renders one frame.

        dataset.render(60, view="anterior", size=(800, 600))
        dataset.render(surfaces=[Surface(75), Surface(30, color="tan", opacity=0.35)], azimuth=30)
        dataset.render(1.5, field="velocity", time=0.25, color_by="temperature")

    Args:
        isovalue: level of the only surface, field units.
        surfaces: 1 to 128 surfaces (or isovalues) instead.
        labels: surfaces of labels, after the others: values or names, each element a surface; a tuple within is one
            surface of several labels. "all": one for each that `present_labels` returns.
        smooth_labels: moves vertices of `labels` by at most a quarter of a sample: small steps become slopes, long ones
            stay; neighbours still meet without gaps.
        field: field whose surfaces are drawn; default: the first of `Dataset.fields`. "velocity:x" names a component,
            too.
        component: "x", "y", "z", a number or "magnitude"; default: the only one, or the magnitude.
        time: the step nearest to it is drawn, of two the earlier; `frame.time` says which.
        step: number of the step, "first" or "last" (-1), instead of a time; default: the last.
        color: colour of the only surface; default: a light clay.
        camera: Camera, or (eye, target, up). Without anything of the camera the picture is the first look, as of
            `isoscope render` and of the page: patients from anterior, others turned by 30 and 20 degrees; the box of
            the surface's cells fills it, with 4 samples a pixel and a material that keeps colours. With any of the
            next four, it begins along -z with +y up, sees the volume, and has the server's defaults.
        view: side to look from, one of isoscope.VIEWS.
        azimuth, elevation: degrees to turn from there, about up and about the right axis.
        zoom: divides the angle of view.
        fit: "volume"; or what the picture frames instead: "surface", the blocks that the surface meets; "cells",
            tightly its cells, however the volume is cut.
        size: (width, height), pixels, or one number for both.
        region: window (x, y, width, height) of that picture, with exactly its pixels; then `size`
            may be up to 65536 on each side.
        background: colour behind, with alpha; default: opaque black.
        clip: part of the world that is shown.
        lights: up to 4 lights in place of the head light.
        color_by: quantity or field that surfaces without one of their own show: ColorBy, or words as
            "temperature:magma:280,320".
        nan_color: colour where a field that colours show, or the samples of caps with a map, are missing (NaN);
            default: grey, 0.5; purple with the maps "grey" and "cividis", which have that grey.
        samples: 1, 4, 9 or 16 samples a pixel, for smooth edges; default: 4 of a first look, else 1.
        ambient_occlusion, silhouette: effects; True for their defaults.
        max_layers: translucent fragments that show in a pixel, 1 to 16; default 8.
        level: one of `Dataset.levels`, or 0, the default: the samples, exact. A level may lack what is thinner than one
            of its samples.
        max_spacing: chooses the level instead: the coarsest one whose samples are at most so many pixels apart, where
            the volume is nearest to the eye. `frame.level` says which.
        culling: "depth" and "none" give the same bytes; "mask" is approximate.
        format: "png", "jpeg", "rgba" or "none".
        quality: of a JPEG, 1 to 100.
        planes: planes to send along: "depth", "surface_index", "position", "normal", "depth_bounds".
        allow_partial: draw what there is if some shards are not served; `frame.stats.missing_shards`
            says what is missing. Else that is an error.
        count_unresolved: count the blocks that a level shows nothing of, `frame.stats.unresolved_block_count`; the
            first frame of a surface at a level waits for it.
        timeout: deadline in seconds; default: the client's.

    A surface that does not show, and that no other one hides, is no error: a SurfaceWarning says why.

    Raises:
        InvalidArgumentError: names the argument, its value and the allowed values.
        IsoscopeError: see isoscope.errors. A frame is right or an error, never incomplete.
    """
    request = _request.frame(
        self, isovalue, surfaces=surfaces, labels=labels, smooth_labels=smooth_labels, camera=camera, view=view,
        azimuth=azimuth, elevation=elevation, zoom=zoom, fit=fit, size=size, region=region, clip=clip, max_layers=max_layers, field=field,
        component=component, time=time, step=step, capabilities=self._client._capabilities,
    )  # fmt: skip
    _request.set_appearance(
        request, color=color, background=background, lights=lights, color_by=color_by, nan_color=nan_color, samples=samples,
        culling=culling, effects={"ambient_occlusion": ambient_occlusion, "silhouette": silhouette},
    )  # fmt: skip
    if _request.asks_first_look(camera, view, azimuth, elevation, zoom, fit):
        _request.set_first_look(request)
    _request.set_level(request, level, max_spacing, self._client._capabilities)
    _request.set_output(request, format, quality, planes)
    request.allow_partial = bool(allow_partial)
    if count_unresolved:  # older servers refuse the field
        request.with_unresolved_count = True
    _request.ask_for_notes(request, self._client._capabilities)
    return frame(_expecting(self, request), timeout)


def frame(request: pb.RenderIsosurfaceRequest, timeout: float | None = None) -> Call[Frame]:
    """The frame of a request. Always as a stream: a picture of any size stays below every limit of messages."""
    parts = _answer.FrameParts(request, _FrameCalls)
    return Call(pb.RenderIsosurfaceStreamRequest(request=request), parts, timeout)


@dataclass(frozen=True)
class _FrameCalls:
    """The later calls of a frame, by `do` of its client."""

    do: Do

    def point(
        self, request: pb.RenderIsosurfaceRequest, pixel: tuple[int, int], all_fields: bool
    ) -> PickedPoint | None:
        return cast(Union[PickedPoint, None], self.do(points(request, pixel, all_fields)))

    def plane(self, request: pb.RenderIsosurfaceRequest, name: PlaneName) -> Frame:
        return cast(Frame, self.do(plane(request, name)))


def plane(request: pb.RenderIsosurfaceRequest, name: PlaneName) -> Call[Frame]:
    """A frame of nothing but one more plane of the frame that `request` asked for."""
    return frame(_request.plane(request, name))


def points(
    request: pb.RenderIsosurfaceRequest, pixels: Any, all_fields: bool = False, timeout: float | None = None
) -> Call[Any]:
    """Asks for the points at pixels of a frame: a list in their order; for a single (column, row), its point."""
    several, is_one = as_pixels(pixels)

    def decode(response: pb.PickSurfaceResponse) -> PickedPoint | None | list[PickedPoint | None]:
        found = _answer.picked(response, several)
        return found[0] if is_one else found

    return Call(_request.pick(request, several, all_fields), One(decode), timeout)


_PICK_ARGUMENTS = (
    "surfaces", "labels", "smooth_labels", "camera", "view", "azimuth", "elevation", "zoom", "fit", "size", "clip",
    "max_layers", "field", "component", "time", "step",
)  # fmt: skip


def pick(
    self: DatasetOfClient,
    pixels: tuple[int, int] | Sequence[Sequence[int]],
    isovalue: float | None = None,
    *,
    frame: Frame | None = None,
    all_fields: bool = False,
    timeout: float | None = None,
    **look: Any,
) -> Call[PickedPoint | None | list[PickedPoint | None]]:
    """Tells what pixels show: point, depth, surface, normal, gradient.

        dataset.pick((512, 400), 60, azimuth=30)
        dataset.pick([(9, 8), (10, 8)], frame=frame)
        flow.pick((512, 400), 310, field="temperature", all_fields=True).field_values

    Args:
        pixels: one (column, row), or a sequence or array of 1 to 1000; row 0 is the top.
        isovalue: as in `render`.
        frame: the frame whose pixels are meant, instead of isovalue and the rest.
        all_fields: whether the points have the values of all fields; only for datasets with fields.
        look: surfaces, labels, smooth_labels, camera, view, azimuth, elevation, zoom, fit, size, clip, max_layers,
            field, component, time, step, as in `render`.
        timeout: deadline in seconds; default: the client's.

    Returns:
        For one pixel, its point, or None where the background shows; for several, a list of these.
    """
    if frame is None:
        unknown = [name for name in look if name not in _PICK_ARGUMENTS]
        if unknown:
            raise InvalidArgumentError(f"pick: unknown argument {unknown[0]!r}; expected {', '.join(_PICK_ARGUMENTS)}")
        request = _expecting(self, _request.frame(self, isovalue, **look, capabilities=self._client._capabilities))
    elif isovalue is not None or look:
        given = "isovalue" if isovalue is not None else next(iter(look))
        raise InvalidArgumentError(f"pick: {given} can't be given with frame, which has it")
    else:
        request = frame._request
    return points(request, pixels, all_fields, timeout)


def mesh(
    self: DatasetOfClient,
    isovalue: float | None = None,
    *,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
    labels: LabelsLike | None = None,
    smooth_labels: bool = False,
    clip: ClipLike | None = None,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | Literal["first", "last"] | None = None,
    closed: bool = False,
    level: int = 0,
    timeout: float | None = None,
) -> Call[Mesh]:
    """Returns whole isosurfaces as one welded mesh in memory: 36 bytes a triangle, or so.

    For meshes larger than memory, and for files, there is `isoscope export`.

    Args:
        isovalue: level of the only surface, field units.
        surfaces: surfaces (or isovalues) instead, any number.
        labels, smooth_labels: surfaces of labels, as in `render`; a smooth mesh can't be cut by `clip`.
        clip: triangles are cut at its borders.
        field, component, time, step: as in `render`.
        closed: closes each surface where its solid ends: at the border of the volume and of `clip`, and at NaN.
        level: one of `Dataset.levels`, for a coarser mesh; 0 is exact.
        timeout: deadline in seconds; default: the client's.
    """
    request = _exported(self, isovalue, surfaces, clip, field, component, time, step, labels, smooth_labels, closed)
    _request.set_mesh_level(request, level, self._client._capabilities)
    return Call(request, _answer.MeshParts(request), timeout)


def notes_on_mesh(call: Call[Mesh], mesh: Mesh, capabilities: Capabilities | None) -> Call[Frame] | None:
    """Returns a small frame of the surfaces that have no triangles, whose notes become warnings; None: no need."""
    request = cast(pb.ExportIsosurfaceRequest, call.request)
    empty = _request.frame_of_empty(request, set(mesh.triangle_surface.tolist()))
    _request.ask_for_notes(empty, capabilities)
    if not empty.surfaces or not empty.with_notes:
        return None
    return frame(empty, call.timeout)


def measure(
    self: DatasetOfClient,
    isovalue: float | None = None,
    *,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
    labels: LabelsLike | None = None,
    smooth_labels: bool = False,
    clip: ClipLike | None = None,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | Literal["first", "last"] | None = None,
    closed: bool = False,
    timeout: float | None = None,
) -> Call[list[SurfaceMeasures]]:
    """Returns area and enclosed volume of each surface, which the server computes: no mesh is sent.

    The numbers are those of the whole surfaces, to the last digit the same for any number of agents.

    Args:
        isovalue, surfaces, labels, smooth_labels, clip, field, component, time, step, closed, timeout: as in `mesh`.
    """
    request = _request.measure(
        _exported(self, isovalue, surfaces, clip, field, component, time, step, labels, smooth_labels, closed)
    )
    return Call(request, _answer.MeasuresOfSurfaces(request), timeout)


def _exported(self: DatasetOfClient, *what: Any) -> Any:
    request: Callable[..., Any] = _request.export
    return _expecting(self, request(self, *what, self._client._capabilities))


def histogram(
    self: DatasetOfClient,
    bins: int = 256,
    range: tuple[float, float] | None = None,
    *,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | Literal["first", "last"] | None = None,
    timeout: float | None = None,
) -> Call[Histogram]:
    """Counts the samples by value, and estimates what the surface at each value costs.

    Args:
        bins: most bins, 1 to 4096.
        range: values to look at, widened to whole bins; default: all finite samples.
        field, component, time, step: as in `render`.
        timeout: deadline in seconds; default: the client's.
    """
    request = _expecting(self, _request.histogram(self, bins, range, field, component, time, step))
    return Call(request, One(_answer.histogram), timeout)


_MAX_LISTED_VALUES = 65536
_SELECTION = ("field", "component", "time", "step", "timeout")


def label_values(
    self: DatasetOfClient,
    *,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | Literal["first", "last"] | None = None,
    timeout: float | None = None,
) -> Call[LabelValues]:
    """Lists the values of samples of any type, as far as they may be labels."""
    request = _expecting(self, _request.histogram(self, 1, None, field, component, time, step))
    request.max_label_value_count = _MAX_LISTED_VALUES
    return Call(request, One(_answer.label_values), timeout)


def has_exact_bins(dataset: DatasetOfClient, what: dict[str, Any]) -> bool:
    """Whether a histogram of 4096 bins tells the values of the samples, or the server lists none."""
    capabilities = dataset._client._capabilities
    if capabilities is None or "label_values" not in capabilities.features:
        return True
    is_small = dataset.range is not None and dataset.range[1] - dataset.range[0] < 4096
    return dataset.dtype.kind in "iu" and is_small and not {"field", "component"} & what.keys()


def wants_present(how: dict[str, Any]) -> bool:
    """True for the arguments of a call with labels="all"."""
    return isinstance(how.get("labels"), str) and how["labels"] == "all"


def selection_of(how: dict[str, Any]) -> dict[str, Any]:
    """Returns the arguments of `histogram` that say which samples a call is about."""
    return {name: how[name] for name in _SELECTION if how.get(name) is not None}


def present(dataset: DatasetInfo, counted: Histogram) -> tuple[Label, ...]:
    """Returns the labels but 0 that samples have, by a histogram of 4096 bins; those with names if it is not exact."""
    known = {label.value: label for label in dataset.labels}
    widths = counted.edges[1:] - counted.edges[:-1]
    if not (dataset.dtype.kind in "iu" and counted.has_sample_counts and (widths == 1).all()):
        return tuple(label for label in dataset.labels if label.value != 0)
    values = (float(value) for value in counted.edges[:-1][counted.sample_count > 0])
    return tuple(known.get(value, Label(value)) for value in values if value != 0)


def listed(dataset: DatasetInfo, found: LabelValues) -> tuple[Label, ...]:
    """Returns the labels but 0 that samples have; those with names if the values are no labels."""
    known = {label.value: label for label in dataset.labels}
    if found.has_more or found.other_value is not None:
        if not known:
            why = (
                f"there are more than {len(found.values)} different values"
                if found.other_value is None
                else f"a sample is {found.other_value!r}, and labels are whole numbers from -2^53 to 2^53"
            )
            raise InvalidArgumentError(f"labels='all': {why}; give values")
        return tuple(label for label in dataset.labels if label.value != 0)
    return tuple(known.get(value, Label(value)) for value in found.values if value != 0)


def _expecting(dataset: DatasetOfClient, request: _R) -> _R:
    _request.expect_dataset(cast(Any, request), dataset, dataset._client._capabilities)
    return request
