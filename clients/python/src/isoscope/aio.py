"""The client for asyncio, with the names of the blocking one.

    async with isoscope.aio.connect("host:50051") as client:
        dataset = await client.dataset("head")
        frame = await dataset.render(isovalue=60, planes=["depth"])

A client belongs to the event loop that it was made in, and to its process.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, overload

import grpc
import grpc.aio

from isoscope import _wire
from isoscope._channel import (
    CONNECT_TIMEOUT,
    DEFAULT_TIMEOUT,
    ProcessChannel,
    Target,
    make_aio_channel,
    make_target,
)
from isoscope._proto import cluster_service_pb2 as cluster_pb
from isoscope._proto import cluster_service_pb2_grpc as cluster_rpc
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import dataset_service_pb2_grpc as datasets_rpc
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope._proto import isosurface_service_pb2_grpc as rpc
from isoscope._retry import Retries
from isoscope.camera import CameraLike
from isoscope import client as _blocking
from isoscope.data import AgentState, Capabilities, DatasetInfo, Histogram, Mesh, PickedPoint, Suggestion
from isoscope.errors import CancelledError, InvalidArgumentError, printable, raise_explained
from isoscope.frame import Frame, ImageFormat, PlaneName
from isoscope.look import AmbientOcclusion, ClipLike, ColorBy, ColorLike, LightLike, Silhouette, SurfaceLike, as_pixels

__all__ = ["Client", "Dataset", "connect"]

_STREAMS: Callable[[Any], Any] = rpc.IsosurfaceServiceStub


class _Connecting:
    """What `connect` returns: await it for a client, or use it in `async with`."""

    def __init__(self, target: Target, connect_timeout: float) -> None:
        self._target = target
        self._connect_timeout = connect_timeout
        self._client: Client | None = None

    async def _connect(self) -> Client:
        client = Client(self._target)
        try:
            client._capabilities = await client.capabilities(timeout=self._connect_timeout)
        except BaseException:
            await client.close()
            raise
        return client

    def __await__(self) -> Generator[Any, None, Client]:
        return self._connect().__await__()

    async def __aenter__(self) -> Client:
        self._client = await self._connect()
        return self._client

    async def __aexit__(self, *_: object) -> None:
        if self._client is not None:
            await self._client.close()


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
) -> _Connecting:
    """Connects as `isoscope.connect` does: `await connect(...)`, or `async with connect(...) as client`."""
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
    return _Connecting(target, connect_timeout)


class Client:
    """A connection to a coordinator. Close it, or use `async with`."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._channel = ProcessChannel(target, make_aio_channel)
        self._capabilities: Capabilities | None = None

    async def datasets(self, *, timeout: float | None = None) -> list[Dataset]:
        """Returns all datasets, in order of name."""
        response = await self._unary(
            datasets_rpc.DatasetServiceStub, "ListDatasets", datasets_pb.ListDatasetsRequest(), timeout
        )
        return [self._dataset(proto) for proto in response.datasets]

    async def dataset(self, name: str = "", *, timeout: float | None = None) -> Dataset:
        """Returns a dataset; the name may be left out if the server has just one."""
        request = datasets_pb.GetDatasetRequest(name=name)
        response = await self._unary(datasets_rpc.DatasetServiceStub, "GetDataset", request, timeout)
        return self._dataset(response.dataset)

    async def capabilities(self, *, timeout: float | None = None) -> Capabilities:
        """Returns the server's version and limits."""
        request = cluster_pb.GetCapabilitiesRequest()
        return _wire.capabilities_from_proto(
            await self._unary(cluster_rpc.ClusterServiceStub, "GetCapabilities", request, timeout)
        )

    async def agents(self, *, timeout: float | None = None) -> list[AgentState]:
        """Returns the agents of the cluster, and whether they can be reached."""
        request = cluster_pb.GetClusterStatusRequest()
        return _wire.agents_from_proto(
            await self._unary(cluster_rpc.ClusterServiceStub, "GetClusterStatus", request, timeout)
        )

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

    async def close(self) -> None:
        """Closes the connection; calls in work are cancelled. Any number of times."""
        channel = self._channel.take_to_close()
        if channel is not None:
            await channel.close()

    async def __aenter__(self) -> Client:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("an async client belongs to its event loop and is not pickled: pickle an isoscope.Dataset")

    def __repr__(self) -> str:
        version = f", version {printable(self._capabilities.version)}" if self._capabilities else ""
        return f"<isoscope.aio.Client of {self.address}{version}>"

    def _dataset(self, proto: Any) -> Dataset:
        return Dataset(_client=self, **_wire.dataset_fields(proto))

    def _timeout(self, timeout: float | None) -> float:
        if timeout is None:
            return self._target.timeout
        if not timeout > 0:
            raise InvalidArgumentError(f"timeout {timeout!r}: must be above 0 seconds")
        return timeout

    async def _unary(self, stub: Callable[[Any], Any], method: str, request: Any, timeout: float | None) -> Any:
        seconds = self._timeout(timeout)
        retries = Retries(seconds)
        while True:
            try:
                call = getattr(stub(self._channel.get()), method)
                return await call(request, timeout=retries.timeout(), metadata=self._target.call_metadata())
            except grpc.RpcError as error:
                delay = retries.delay_after(error)
                if delay is None:
                    raise_explained(error, self.address, seconds, self._target.tls)
            except grpc.aio.UsageError as error:
                raise CancelledError(f"the client of {self.address} is closed") from error
            await asyncio.sleep(delay)

    async def _stream(self, method: str, request: Any, timeout: float | None, take: Callable[[Any], None]) -> None:
        """Calls `take` for every message of a stream; a cancelled task stops the server."""
        seconds = self._timeout(timeout)
        retries = Retries(seconds)
        has_taken = False
        while True:
            call: Any = None
            try:
                call = getattr(_STREAMS(self._channel.get()), method)(
                    request, timeout=retries.timeout(), metadata=self._target.call_metadata()
                )
                async for message in call:
                    has_taken = True
                    take(message)
                return
            except grpc.RpcError as error:
                delay = None if has_taken else retries.delay_after(error)
                if delay is None:
                    raise_explained(error, self.address, seconds, self._target.tls)
            except grpc.aio.UsageError as error:
                raise CancelledError(f"the client of {self.address} is closed") from error
            except BaseException:
                if call is not None:
                    call.cancel()
                raise
            await asyncio.sleep(delay)


@dataclass(frozen=True, kw_only=True, repr=False)
class Dataset(DatasetInfo):
    """A volume on the server: the methods of `isoscope.Dataset`, to be awaited."""

    _client: Client = field(compare=False)

    def __repr__(self) -> str:
        ends = "empty" if self.range is None else f"{self.range[0]:g} to {self.range[1]:g}"
        return f"Dataset({self.name!r}, {' x '.join(map(str, self.dims))} {self.dtype.name}, {ends})"

    async def render(
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
        """Renders one frame: `isoscope.Dataset.render` tells about the arguments."""
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
        parts = _wire.FrameParts()
        in_parts = pb.RenderIsosurfaceStreamRequest(request=request)
        await self._client._stream("RenderIsosurfaceStream", in_parts, timeout, parts.add)
        return parts.frame(request)

    @overload
    async def pick(
        self, pixels: tuple[int, int], isovalue: float | None = None, *, frame: Frame | None = None, **look: Any
    ) -> PickedPoint | None: ...

    @overload
    async def pick(
        self, pixels: Sequence[Sequence[int]], isovalue: float | None = None, *, frame: Frame | None = None, **look: Any
    ) -> list[PickedPoint | None]: ...

    async def pick(
        self,
        pixels: tuple[int, int] | Sequence[Sequence[int]],
        isovalue: float | None = None,
        *,
        frame: Frame | None = None,
        timeout: float | None = None,
        **look: Any,
    ) -> PickedPoint | None | list[PickedPoint | None]:
        """Tells what pixels show: `isoscope.Dataset.pick` tells about the arguments."""
        several, is_one = as_pixels(pixels)
        request = _wire.pick_request(
            _blocking.pick_frame(self, self._client._capabilities, isovalue, frame, look), several
        )
        response = await self._client._unary(rpc.IsosurfaceServiceStub, "PickSurface", request, timeout)
        points = _wire.picked_from_proto(response, several)
        return points[0] if is_one else points

    async def mesh(
        self,
        isovalue: float | None = None,
        *,
        surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
        clip: ClipLike | None = None,
        timeout: float | None = None,
    ) -> Mesh:
        """Returns whole isosurfaces as one welded mesh: `isoscope.Dataset.mesh` tells about the arguments."""
        request = _wire.export_request(self, isovalue, surfaces, clip)
        _wire.expect_dataset(request, self, self._client._capabilities)
        parts = _wire.MeshParts(request)
        await self._client._stream("ExportIsosurface", request, timeout, parts.add)
        return parts.mesh()

    async def histogram(
        self, bins: int = 256, range: tuple[float, float] | None = None, *, timeout: float | None = None
    ) -> Histogram:
        """Counts the samples by value: `isoscope.Dataset.histogram` tells about the arguments."""
        request = _wire.histogram_request(self.name, bins, range)
        _wire.expect_dataset(request, self, self._client._capabilities)
        return _wire.histogram_from_proto(
            await self._client._unary(datasets_rpc.DatasetServiceStub, "GetHistogram", request, timeout)
        )

    async def suggestions(self) -> tuple[Suggestion, ...]:
        """Returns isovalues that are worth a look; none if samples were not counted."""
        return (await self.histogram()).suggestions

    async def refresh(self) -> Dataset:
        """Asks for the description again: `missing_shards` changes as agents come and go."""
        return await self._client.dataset(self.name)
