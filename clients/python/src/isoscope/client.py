"""The blocking client. `isoscope.aio` has the same names, to be awaited."""

from __future__ import annotations

import os
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NoReturn, TypeVar, overload

import grpc
import numpy.typing as npt

from isoscope import _wire
from isoscope._channel import CONNECT_TIMEOUT, DEFAULT_TIMEOUT, ProcessChannel, Target, make_channel, make_target
from isoscope._proto import cluster_service_pb2 as cluster_pb
from isoscope._proto import cluster_service_pb2_grpc as cluster_rpc
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import dataset_service_pb2_grpc as datasets_rpc
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope._proto import isosurface_service_pb2_grpc as rpc
from isoscope._retry import Retries
from isoscope.camera import CameraLike
from isoscope.data import AgentState, Capabilities, DatasetInfo, Histogram, Mesh, PickedPoint, Suggestion
from isoscope.errors import InvalidArgumentError, printable, raise_explained
from isoscope.frame import Frame, ImageFormat, PlaneName
from isoscope.look import AmbientOcclusion, ClipLike, ColorBy, ColorLike, LightLike, Silhouette, SurfaceLike, as_pixels
from isoscope.viewer import View, make_view

__all__ = ["Client", "Dataset", "connect"]

_STREAMS: Callable[[Any], Any] = rpc.IsosurfaceServiceStub

_T = TypeVar("_T")


def connect(
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
) -> Client:
    """Connects to a coordinator and asks for its version, so that a wrong address fails here.

        with isoscope.connect("host:50051") as client:
            client["head"].render(isovalue=60).save("head.png")

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
    forked child makes a connection of its own, if no call was at work in the moment of the fork: gRPC can't fork then.
    """
    target = make_target(
        address,
        tls=tls,
        ca_file=ca_file,
        cert_file=cert_file,
        key_file=key_file,
        server_name=server_name,
        token=token,
        token_file=token_file,
        allow_insecure_token=allow_insecure_token,
        metadata=metadata,
        timeout=timeout,
    )
    client = Client(target)
    try:
        client._capabilities = client.capabilities(timeout=connect_timeout)
    except BaseException:
        client.close()
        raise
    return client


class Client:
    """A connection to a coordinator, made by `isoscope.connect` or `isoscope.serve`.

    Close it, or use it as a context manager. Thread-safe.
    """

    def __init__(self, target: Target, on_close: Callable[[], None] | None = None) -> None:
        self._target = target
        self._channel = ProcessChannel(target, make_channel)
        self._on_close = on_close
        self._capabilities: Capabilities | None = None

    # ----------------------------------------------------------------------------- datasets

    def datasets(self, *, timeout: float | None = None) -> list[Dataset]:
        """Returns all datasets, in order of name."""
        response = self._unary(
            datasets_rpc.DatasetServiceStub, "ListDatasets", datasets_pb.ListDatasetsRequest(), timeout
        )
        return [self._dataset(proto) for proto in response.datasets]

    def dataset(self, name: str = "", *, timeout: float | None = None) -> Dataset:
        """Returns a dataset; the name may be left out if the server has just one.

        Raises:
            NotFoundError: there is none of that name; the message lists the datasets.
        """
        request = datasets_pb.GetDatasetRequest(name=name)
        response = self._unary(datasets_rpc.DatasetServiceStub, "GetDataset", request, timeout)
        return self._dataset(response.dataset)

    def __getitem__(self, name: str) -> Dataset:
        return self.dataset(name)

    def __iter__(self) -> Iterator[str]:
        """Gives the names that `client[name]` takes, as a mapping does; `datasets` has the datasets."""
        return iter([dataset.name for dataset in self.datasets()])

    def __contains__(self, name: object) -> bool:
        return any(one == name for one in self)

    # ----------------------------------------------------------------------------- cluster

    def capabilities(self, *, timeout: float | None = None) -> Capabilities:
        """Returns the server's version and limits."""
        request = cluster_pb.GetCapabilitiesRequest()
        return _wire.capabilities_from_proto(
            self._unary(cluster_rpc.ClusterServiceStub, "GetCapabilities", request, timeout)
        )

    def agents(self, *, timeout: float | None = None) -> list[AgentState]:
        """Returns the agents of the cluster, and whether they can be reached."""
        request = cluster_pb.GetClusterStatusRequest()
        return _wire.agents_from_proto(
            self._unary(cluster_rpc.ClusterServiceStub, "GetClusterStatus", request, timeout)
        )

    # ----------------------------------------------------------------------------- the connection

    @property
    def address(self) -> str:
        """Address of the server."""
        return self._target.address

    @property
    def token_file(self) -> str | None:
        """The file with the token that is sent: `--token-file` of the programs; None if it came otherwise, or none.

        `isoscope.serve` makes a token, and this file, which goes when the client is closed.
        """
        return self._target.token_file

    def close(self) -> None:
        """Closes the connection, and ends what `isoscope.serve` had started. Any number of times."""
        channel = self._channel.take_to_close()
        if channel is not None:
            channel.close()
        on_close, self._on_close = self._on_close, None
        if on_close is not None:
            on_close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles where to connect, without the token; see `_shared_client`."""
        return _shared_client, (self._target, self._capabilities)

    def __repr__(self) -> str:
        version = f", version {printable(self._capabilities.version)}" if self._capabilities else ""
        return f"<isoscope.Client of {self.address}{version}>"

    # ----------------------------------------------------------------------------- calls

    def _dataset(self, proto: Any) -> Dataset:
        return Dataset(_client=self, **_wire.dataset_fields(proto))

    def _timeout(self, timeout: float | None) -> float:
        if timeout is None:
            return self._target.timeout
        if not timeout > 0:
            raise InvalidArgumentError(f"timeout {timeout!r}: must be above 0 seconds")
        return timeout

    def _unary(self, stub: Callable[[Any], Any], method: str, request: Any, timeout: float | None) -> Any:
        """Makes one call; errors are this package's."""
        seconds = self._timeout(timeout)
        retries = Retries(seconds)
        while True:
            call = getattr(stub(self._channel.get()), method)
            try:
                return call(request, timeout=retries.timeout(), metadata=self._target.call_metadata())
            except grpc.RpcError as error:
                delay = retries.delay_after(error)
                if delay is None:
                    raise_explained(error, self.address, seconds, self._target.tls)
            except ValueError as error:  # gRPC: the channel was closed by another thread
                raise_closed(error, self.address)
            time.sleep(delay)

    def _stream(self, method: str, request: Any, timeout: float | None, take: Callable[[Any], None]) -> None:
        """Calls `take` for every message of a stream; stops the server if that is interrupted."""
        seconds = self._timeout(timeout)
        retries = Retries(seconds)
        has_taken = False
        while True:
            try:
                call = getattr(_STREAMS(self._channel.get()), method)(
                    request, timeout=retries.timeout(), metadata=self._target.call_metadata()
                )
            except ValueError as error:
                raise_closed(error, self.address)
            try:
                for message in call:
                    has_taken = True
                    take(message)
                return
            except grpc.RpcError as error:
                delay = None if has_taken else retries.delay_after(error)
                if delay is None:
                    raise_explained(error, self.address, seconds, self._target.tls)
            except BaseException:
                call.cancel()
                raise
            time.sleep(delay)

    def _render(self, request: pb.RenderIsosurfaceRequest, timeout: float | None) -> Frame:
        return self._frame_parts(request, timeout).frame(request, fetch=self._plane, pick=self._pick)

    def _frame_parts(self, request: pb.RenderIsosurfaceRequest, timeout: float | None) -> _wire.FrameParts:
        # Always as a stream: a picture of any size stays below every limit of messages.
        parts = _wire.FrameParts()
        in_parts = pb.RenderIsosurfaceStreamRequest(request=request)
        self._stream("RenderIsosurfaceStream", in_parts, timeout, parts.add)
        return parts

    def _plane(self, request: pb.RenderIsosurfaceRequest, plane: PlaneName) -> npt.NDArray[Any]:
        return self._frame_parts(_wire.plane_request(request, plane), None).planes()[plane]

    def _pick(
        self, request: pb.RenderIsosurfaceRequest, pixels: Sequence[tuple[int, int]], timeout: float | None = None
    ) -> list[PickedPoint | None]:
        pick = _wire.pick_request(request, pixels)
        response = self._unary(rpc.IsosurfaceServiceStub, "PickSurface", pick, timeout)
        return _wire.picked_from_proto(response, pixels)


# What unpickled datasets of this process share, by target, as long as one of them lives.
_SHARED: weakref.WeakValueDictionary[Target, Client] = weakref.WeakValueDictionary()


def _shared_client(target: Target, capabilities: Capabilities | None) -> Client:
    """Returns the client of an unpickled dataset. It connects at its first call, with the token of this process."""
    target = target.with_token()
    client = _SHARED.get(target)
    if client is None or client._channel.is_closed:
        client = _SHARED[target] = Client(target)
        client._capabilities = capabilities
    return client


def raise_closed(error: ValueError, address: str) -> NoReturn:
    """Raises CancelledError for a call on a closed channel, else the error itself."""
    from isoscope.errors import CancelledError

    if "closed" in str(error).lower():
        raise CancelledError(f"the client of {address} is closed") from error
    raise error


@dataclass(frozen=True, kw_only=True, repr=False)
class Dataset(DatasetInfo):
    """A volume on the server. Rendering, picking and meshes do not change it; all calls are idempotent.

    Its calls fail with FailedPreconditionError if the name has other contents by now: `refresh` gets them.
    """

    _client: Client = field(compare=False)

    def __repr__(self) -> str:
        ends = "empty" if self.range is None else f"{self.range[0]:g} to {self.range[1]:g}"
        return f"Dataset({self.name!r}, {' x '.join(map(str, self.dims))} {self.dtype.name}, {ends})"

    def render(
        self,
        isovalue: float | None = None,
        *,
        surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
        color: ColorLike | None = None,
        camera: CameraLike | None = None,
        view: str | None = None,
        azimuth: float = 0,
        elevation: float = 0,
        zoom: float = 1,
        fit: Literal["volume", "surface"] = "volume",
        size: tuple[int, int] | int = (1024, 1024),
        region: tuple[int, int, int, int] | None = None,
        background: ColorLike | None = None,
        clip: ClipLike | None = None,
        lights: Sequence[LightLike] | LightLike = (),
        color_by: ColorBy | None = None,
        samples: int | None = None,
        ambient_occlusion: AmbientOcclusion | bool = False,
        silhouette: Silhouette | bool = False,
        max_layers: int | None = None,
        culling: Literal["depth", "mask", "none"] = "depth",
        format: ImageFormat = "png",
        quality: int | None = None,
        planes: Sequence[PlaneName] = (),
        allow_partial: bool = False,
        timeout: float | None = None,
    ) -> Frame:
        """Renders one frame.

            dataset.render(60, view="anterior", size=(800, 600))
            dataset.render(surfaces=[Surface(75), Surface(30, color="tan", opacity=0.35)], azimuth=30)

        Args:
            isovalue: level of the only surface, field units.
            surfaces: 1 to 16 surfaces (or isovalues) instead.
            color: colour of the only surface; default: a light clay.
            camera: Camera, or (eye, target, up); default: sees the whole volume along -z with +y up.
            view: side to look from, one of isoscope.VIEWS.
            azimuth, elevation: degrees to turn from there, about up and about the right axis.
            zoom: divides the angle of view.
            fit: "surface" frames the blocks that the surface meets instead of the volume.
            size: (width, height), pixels, or one number for both.
            region: window (x, y, width, height) of that picture, with exactly its pixels; then `size`
                may be up to 65536 on each side.
            background: colour behind, with alpha; default: opaque black.
            clip: part of the world that is shown.
            lights: up to 4 lights in place of the head light.
            color_by: quantity that surfaces without one of their own show.
            samples: 1, 4, 9 or 16 samples a pixel, for smooth edges.
            ambient_occlusion, silhouette: effects; True for their defaults.
            max_layers: translucent fragments that show in a pixel, 1 to 16; default 8.
            culling: "depth" and "none" give the same bytes; "mask" is approximate.
            format: "png", "jpeg", "rgba" or "none".
            quality: of a JPEG, 1 to 100.
            planes: planes to send along: "depth", "surface_index", "position", "normal".
            allow_partial: draw what there is if some shards are not served; `frame.stats.missing_shards`
                says what is missing. Else that is an error.
            timeout: deadline in seconds; default: the client's.

        Raises:
            InvalidArgumentError: names the argument, its value and the allowed values.
            IsoscopeError: see isoscope.errors. A frame is right or an error, never incomplete.
        """
        request = _wire.frame_request(
            self, isovalue, surfaces=surfaces, camera=camera, view=view, azimuth=azimuth, elevation=elevation,
            zoom=zoom, fit=fit, size=size, region=region, clip=clip, max_layers=max_layers,
        )  # fmt: skip
        _wire.set_appearance(
            request, color=color, background=background, lights=lights, color_by=color_by, samples=samples,
            ambient_occlusion=ambient_occlusion, silhouette=silhouette, culling=culling,
        )  # fmt: skip
        _wire.set_output(request, format, quality, planes)
        request.allow_partial = bool(allow_partial)
        _wire.expect_dataset(request, self, self._client._capabilities)
        return self._client._render(request, timeout)

    @overload
    def pick(
        self, pixels: tuple[int, int], isovalue: float | None = None, *, frame: Frame | None = None, **look: Any
    ) -> PickedPoint | None: ...

    @overload
    def pick(
        self, pixels: Sequence[Sequence[int]], isovalue: float | None = None, *, frame: Frame | None = None, **look: Any
    ) -> list[PickedPoint | None]: ...

    def pick(
        self,
        pixels: tuple[int, int] | Sequence[Sequence[int]],
        isovalue: float | None = None,
        *,
        frame: Frame | None = None,
        timeout: float | None = None,
        **look: Any,
    ) -> PickedPoint | None | list[PickedPoint | None]:
        """Tells what pixels show: point, depth, surface, normal, gradient.

            dataset.pick((512, 400), 60, azimuth=30)
            dataset.pick([(9, 8), (10, 8)], frame=frame)

        Args:
            pixels: one (column, row), or a sequence or array of 1 to 1000; row 0 is the top.
            isovalue: as in `render`.
            frame: the frame whose pixels are meant, instead of isovalue and the rest.
            look: surfaces, camera, view, azimuth, elevation, zoom, fit, size, clip, max_layers, as in `render`.
            timeout: deadline in seconds; default: the client's.

        Returns:
            For one pixel, its point, or None where the background shows; for several, a list of these.
        """
        several, is_one = as_pixels(pixels)
        request = pick_frame(self, self._client._capabilities, isovalue, frame, look)
        points = self._client._pick(request, several, timeout)
        return points[0] if is_one else points

    def mesh(
        self,
        isovalue: float | None = None,
        *,
        surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
        clip: ClipLike | None = None,
        timeout: float | None = None,
    ) -> Mesh:
        """Returns whole isosurfaces as one welded mesh in memory: 36 bytes a triangle, or so.

        For meshes larger than memory, and for files, there is `isoscope export`.

        Args:
            isovalue: level of the only surface, field units.
            surfaces: 1 to 16 surfaces (or isovalues) instead.
            clip: triangles are cut at its borders; nothing closes the cut.
            timeout: deadline in seconds; default: the client's.
        """
        request = _wire.export_request(self, isovalue, surfaces, clip)
        _wire.expect_dataset(request, self, self._client._capabilities)
        parts = _wire.MeshParts(request)
        self._client._stream("ExportIsosurface", request, timeout, parts.add)
        return parts.mesh()

    def histogram(
        self, bins: int = 256, range: tuple[float, float] | None = None, *, timeout: float | None = None
    ) -> Histogram:
        """Counts the samples by value, and estimates what the surface at each value costs.

        Args:
            bins: most bins, 1 to 4096.
            range: values to look at, widened to whole bins; default: all finite samples.
            timeout: deadline in seconds; default: the client's.
        """
        request = _wire.histogram_request(self.name, bins, range)
        _wire.expect_dataset(request, self, self._client._capabilities)
        return _wire.histogram_from_proto(
            self._client._unary(datasets_rpc.DatasetServiceStub, "GetHistogram", request, timeout)
        )

    def suggestions(self) -> tuple[Suggestion, ...]:
        """Returns isovalues that are worth a look; none if samples were not counted."""
        return self.histogram().suggestions

    def refresh(self) -> Dataset:
        """Asks for the description again: `missing_shards` changes as agents come and go."""
        return self._client.dataset(self.name)

    def view(
        self,
        isovalue: float | None = None,
        *,
        surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
        camera: CameraLike | None = None,
        view: str | None = None,
        clip: ClipLike | None = None,
        size: tuple[int, int] = (800, 600),
        gateway: str | None = None,
        token: str | None = None,
    ) -> View:
        """Returns a view for a notebook cell: the surface under the mouse, and the exact picture.

        The browser gets its frames from the web gateway; without one, and in the saved notebook, the
        cell shows the exact picture.

        Args:
            isovalue, surfaces, camera, view, clip, size: as in `render`; default: the suggested isovalue.
            gateway: the gateway's address, as the browser reaches it; default: what the server names.
            token: token of the gateway, where it wants one.
        """
        return make_view(
            self, isovalue, surfaces=surfaces, camera=camera, view=view, clip=clip, size=size,
            gateway=gateway, token=token,
        )  # fmt: skip


def pick_frame(
    dataset: DatasetInfo,
    capabilities: Capabilities | None,
    isovalue: float | None,
    frame: Frame | None,
    look: dict[str, Any],
) -> pb.RenderIsosurfaceRequest:
    """Returns the frame that a pick is about."""
    if frame is None:
        known = _PICK_ARGUMENTS
        unknown = [name for name in look if name not in known]
        if unknown:
            raise InvalidArgumentError(f"pick: unknown argument {unknown[0]!r}; expected {', '.join(known)}")
        request = _wire.frame_request(dataset, isovalue, **look)
        _wire.expect_dataset(request, dataset, capabilities)
        return request
    if isovalue is not None or look:
        given = "isovalue" if isovalue is not None else next(iter(look))
        raise InvalidArgumentError(f"pick: {given} can't be given with frame, which has it")
    return frame._request


_PICK_ARGUMENTS = (
    "surfaces", "camera", "view", "azimuth", "elevation", "zoom", "fit", "size", "clip", "max_layers",
)  # fmt: skip
