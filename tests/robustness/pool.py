"""The pool of requests, and how an answer becomes a digest.

The digest covers every byte that is promised: picture, planes, camera, points, mesh, histogram. It leaves out
statistics and times, which tell how an answer was made.
"""

import dataclasses
import hashlib
import math
import os
import pathlib
import queue
import random
import sys
import time
import typing

# Before gRPC is imported: the harness starts processes, and forks none that use gRPC.
os.environ["GRPC_ENABLE_FORK_SUPPORT"] = "0"
os.environ.setdefault("GRPC_VERBOSITY", "NONE")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "clients" / "python" / "src"))
sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "support"))

import grpc  # noqa: E402
from grpc_services import Stub  # noqa: E402

from isoscope._proto import cluster_service_pb2 as cluster_pb2  # noqa: E402
from isoscope._proto import dataset_service_pb2 as dataset_pb2  # noqa: E402
from isoscope._proto import interact_service_pb2 as interact_pb2  # noqa: E402
from isoscope._proto import isosurface_service_pb2 as pb  # noqa: E402

SIZE = (56.0, 48.0, 40.0)  # of the volume, world units


@dataclasses.dataclass(frozen=True)
class Request:
    """One request of the pool. `method` is that of the proto; `reference` names the pool's request of equal answer."""

    name: str
    method: str
    message: typing.Any
    reference: str


def _camera(chance, camera):
    centre = [(side - 1) / 2 for side in SIZE]
    z, turn = chance.uniform(-0.95, 0.95), chance.uniform(0, 2 * math.pi)
    ring = math.sqrt(1 - z * z)
    distance = chance.uniform(45, 180)
    way = (ring * math.cos(turn), ring * math.sin(turn), z)
    for axis, c, d in zip("xyz", centre, way):
        setattr(camera.eye, axis, c + distance * d)
        setattr(camera.target, axis, c + chance.uniform(-4, 4))
    camera.up.z = 1
    if chance.random() < 0.7:
        camera.perspective.fov_y_degrees = chance.uniform(20, 60)
    else:
        camera.orthographic.height = chance.uniform(30, 90)


def _surfaces(chance, message):
    for _ in range(chance.randint(1, 3)):
        surface = message.surfaces.add(isovalue=chance.randrange(20, 236) + chance.choice((0.0, 0.5)))
        surface.color.red, surface.color.green, surface.color.blue = (chance.random() for _ in range(3))
        surface.color.alpha = chance.choice((1.0, 1.0, 0.4, 0.7))


def _frame(chance, dataset):
    message = pb.RenderIsosurfaceRequest(dataset=dataset)
    _camera(chance, message.camera)
    message.viewport.width_px, message.viewport.height_px = (chance.randrange(64, 257) for _ in range(2))
    if chance.random() < 0.5:
        message.isovalue = chance.randrange(20, 236)
    else:
        _surfaces(chance, message)
    if chance.random() < 0.2:
        half_space = message.clip.half_spaces.add(offset=chance.uniform(10, 30))
        setattr(half_space.normal, chance.choice("xyz"), 1.0)
    if chance.random() < 0.15:
        message.lights.add().direction.z = 1
        message.lights[0].direction.x = chance.uniform(-1, 1)
    message.ray_seed = chance.randrange(1 << 31)
    return message


def _output(chance, message):
    """Planes, other formats, samples, effects: what not every frame has."""
    choice = chance.randrange(6)
    if choice == 0:
        message.samples = 4
    elif choice == 1:
        message.output.image_format = pb.OutputOptions.IMAGE_FORMAT_RGBA8
        message.output.depth = message.output.surface_index = True
    elif choice == 2:
        message.output.position = message.output.normal = message.output.depth_bounds = True
    elif choice == 3:
        message.ambient_occlusion.radius_px = 8
        message.silhouette.width_px = 1
    elif choice == 4:
        message.output.image_format = pb.OutputOptions.IMAGE_FORMAT_JPEG
        message.background_color.alpha = 1
    else:
        message.region.x, message.region.y = (chance.randrange(16) for _ in range(2))
        message.region.width_px = message.region.height_px = 40
    return message


def make_pool(seed, dataset, count=48):
    """Half plain frames, a quarter with more output, the rest picks, meshes and histograms."""
    chance = random.Random(seed)
    pool = []
    for index in range(count):
        name = f"r{index}"
        part = index / count
        if part < 0.75:
            message = _frame(chance, dataset)
            if part >= 0.5:
                _output(chance, message)
            pool.append(Request(name, "RenderIsosurface", message, name))
            # The same frame in parts, or as an interactive view at rest, must be the same frame.
            if index % 6 == 5 and part < 0.5:
                pool.append(Request(f"{name}-live", "Interact", message, name))
            if index % 4 == 3:
                stream = pb.RenderIsosurfaceStreamRequest(request=message)
                pool.append(Request(f"{name}-stream", "RenderIsosurfaceStream", stream, name))
        elif part < 0.85:
            frame = _frame(chance, dataset)
            pick = pb.PickSurfaceRequest(frame=frame)
            for _ in range(chance.randint(1, 6)):
                size = frame.viewport
                pick.pixels.add(x=chance.randrange(size.width_px), y=chance.randrange(size.height_px))
            pool.append(Request(name, "PickSurface", pick, name))
        elif part < 0.95:
            mesh = pb.ExportIsosurfaceRequest(dataset=dataset, isovalue=chance.randrange(60, 200))
            pool.append(Request(name, "ExportIsosurface", mesh, name))
        else:
            histogram = dataset_pb2.GetHistogramRequest(dataset=dataset, max_bin_count=chance.choice((16, 256)))
            pool.append(Request(name, "GetHistogram", histogram, name))
    return pool


def least_agent_mib(pool):
    """The least memory limit of an agent that can draw every frame of the pool: AgentMemory::ReserveStep, with its
    bytes of a pixel and of a translucent fragment, and the share of the limit that is for them."""
    least = 0
    for request in pool:
        message = request.message
        if request.method == "PickSurface":
            message = message.frame
        elif request.method == "RenderIsosurfaceStream":
            message = message.request
        elif request.method in ("ExportIsosurface", "GetHistogram"):
            continue
        layers = (message.max_layers or 8) + 1 if any(surface.color.alpha < 1 for surface in message.surfaces) else 0
        pixels = message.viewport.width_px * message.viewport.height_px * max(message.samples, 1)
        least = max(least, math.ceil(pixels * (32 + 24 * layers) * 32 / 5 / 2**20))
    return least


def with_partial(pool):
    """The frames of the pool that may lack shards."""
    partial = []
    for request in pool:
        if request.method == "RenderIsosurface":
            message = pb.RenderIsosurfaceRequest()
            message.CopyFrom(request.message)
            message.allow_partial = True
            partial.append(Request(f"{request.name}-partial", request.method, message, request.reference))
    return partial


def _frame_digest(response):
    missing = tuple(response.statistics.missing_shards)
    response.ClearField("statistics")
    response.ClearField("trace")
    return hashlib.sha256(response.SerializeToString(deterministic=True)).hexdigest(), missing


def join_parts(parts):
    """The response that the parts of a stream make."""
    whole = pb.RenderIsosurfaceResponse()
    for part in parts:
        kept = {}
        for field, value in part.part.ListFields():
            if field.type == field.TYPE_BYTES:
                kept[field.name] = getattr(whole, field.name) + value
        whole.MergeFrom(part.part)
        for name, value in kept.items():
            setattr(whole, name, value)
    return whole


class FrameFailed(Exception):
    """The error of a frame in an interactive stream; `code` is the name of gRPC's code."""

    def __init__(self, code, message):
        super().__init__(f"{code}: {message}")
        self.code, self.message = code, message


_CODE_NAMES = {code.value[0]: code.name for code in grpc.StatusCode}


def _turned(frame):
    """The same frame seen from elsewhere: where a person's view came from."""
    turned = pb.RenderIsosurfaceRequest()
    turned.CopyFrom(frame)
    turned.camera.eye.x += 7
    return turned


class Client:
    """One connection to one coordinator. For one thread."""

    def __init__(self, address, tls=None):
        options = [
            ("grpc.use_local_subchannel_pool", 1),
            ("grpc.initial_reconnect_backoff_ms", 50),
            ("grpc.min_reconnect_backoff_ms", 3000),  # how long a handshake may take
            ("grpc.max_reconnect_backoff_ms", 300),
            ("grpc.max_receive_message_length", 64 << 20),
        ]
        if tls is None:
            self._channel = grpc.insecure_channel(address, options)
        else:
            files = ((tls / name).read_bytes() for name in ("ca.pem", "client.key", "client.pem"))
            self._channel = grpc.secure_channel(address, grpc.ssl_channel_credentials(*files), options)
        self._frames = Stub(self._channel, pb)
        self._views = Stub(self._channel, interact_pb2)
        self._datasets = Stub(self._channel, dataset_pb2)
        self.cluster = Stub(self._channel, cluster_pb2)

    def ask(self, request, timeout):
        """(digest, missing shards), or grpc.RpcError, FrameFailed."""
        if request.method == "GetHistogram":
            answer = self._datasets.GetHistogram(request.message, timeout=timeout)
            return hashlib.sha256(answer.SerializeToString(deterministic=True)).hexdigest(), ()
        if request.method == "Interact":
            return self._look(request.message, timeout)
        call = getattr(self._frames, request.method)
        if request.method == "RenderIsosurface":
            return _frame_digest(call(request.message, timeout=timeout))
        if request.method == "RenderIsosurfaceStream":
            return _frame_digest(join_parts(call(request.message, timeout=timeout)))
        if request.method == "PickSurface":
            answer = call(request.message, timeout=timeout)
            answer.ClearField("statistics")
            return hashlib.sha256(answer.SerializeToString(deterministic=True)).hexdigest(), ()
        sha = hashlib.sha256()
        for chunk in call(request.message, timeout=timeout):
            sha.update(chunk.SerializeToString(deterministic=True))
        return sha.hexdigest(), ()

    def _look(self, frame, timeout):
        """A view that moves once and then rests: the exact frame. Goes away without a word, as people do."""
        says = queue.SimpleQueue()
        for number, view in enumerate((_turned(frame), frame), 1):
            state = interact_pb2.ViewState(sequence_number=number, frame=view, is_at_rest=view is frame)
            says.put(interact_pb2.InteractRequest(view_state=state))
        call = self._views.Interact(iter(says.get, None), timeout=timeout)
        try:
            for answer in call:
                if answer.sequence_number == 2 and answer.HasField("error"):
                    raise FrameFailed(_CODE_NAMES.get(answer.error.code, "UNKNOWN"), answer.error.message)
                if answer.sequence_number == 2 and answer.is_exact:
                    return _frame_digest(answer.frame)
                shown = interact_pb2.FrameShown(frame_number=answer.frame_number)
                says.put(interact_pb2.InteractRequest(frame_shown=shown))
            raise FrameFailed("UNKNOWN", "the stream ended with OK, without the exact frame")
        finally:
            says.put(None)
            call.cancel()

    def close(self):
        self._channel.close()


def make_references(client, pool, timeout=60):
    """{request: digest} of a quiet cluster. The pool must not contradict itself."""
    references = {}
    end = time.monotonic() + timeout
    for request in pool:
        while True:
            try:
                digest, _ = client.ask(request, timeout)
                break
            except grpc.RpcError as error:  # agents answer while they open their shards
                if error.code() != grpc.StatusCode.UNAVAILABLE or "opening" not in error.details() or time.monotonic() > end:
                    raise
                time.sleep(0.1)
        if references.setdefault(request.reference, digest) != digest:
            raise AssertionError(f"{request.name} and {request.reference} have different bytes in a quiet cluster")
        references[request.name] = digest
    return references
