"""Frames of a moving view through the kernel, where the browser can't reach the web gateway.

The viewer's module sends the WebSocket's messages to the kernel instead; here they become the call
InteractService.Interact, and its answers become what the WebSocket would have sent: a length, JSON,
the picture, the depths. Credits and adaption are between module and server; nothing is queued here.
"""

from __future__ import annotations

import contextlib
import json
import queue
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any

import grpc
from google.protobuf import json_format

from isoscope._proto import interact_service_pb2 as pb
from isoscope.errors import explain

# A view may be open for long. Without a deadline a lost server would never be noticed.
_SESSION_SECONDS = 24 * 3600.0
# A browser at rest sends nothing either; its next view state opens the stream again.
_IDLE_SECONDS = 60.0
_METHOD = "/isoscope.v1.InteractService/Interact"


class KernelFrames:
    """One view's stream. `handle` takes the module's messages, `send(content, buffers)` answers them.

    A kernel hears nothing of a tab that is closed. So a stream from whose browser nothing came for `idle_seconds` ends,
    with its threads; the next view state of a browser that is still there opens another.
    """

    def __init__(
        self,
        client: Any,
        send: Callable[[dict[str, Any], list[bytes]], None],
        dataset: str,
        idle_seconds: float = _IDLE_SECONDS,
    ) -> None:
        self._client = client
        self._send = send
        self._dataset = dataset
        self._idle_seconds = idle_seconds
        self._is_open = False
        self._stream: _Stream | None = None
        self._sequence_number = 0

    def handle(self, content: Any) -> None:
        """Takes one message of the module; others are ignored."""
        kind = content.get("type") if isinstance(content, dict) else None
        if kind == "isoscope/open":
            self.close()
            self._is_open = True
        elif kind == "isoscope/interact" and self._is_open:
            self._interact(str(content.get("text", "")))
        elif kind == "isoscope/close":
            self.close()

    def close(self) -> None:
        """Ends the stream; `handle` may open another."""
        self._is_open = False
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.end()

    def _interact(self, text: str) -> None:
        try:
            request = json_format.Parse(text, pb.InteractRequest())
        except json_format.ParseError as error:
            self._send_error(3, f"the viewer and this package do not fit each other: {error}")
            return
        if request.HasField("view_state"):
            self._sequence_number = request.view_state.sequence_number
            # A view shows one dataset, whatever the browser asks for.
            request.view_state.frame.dataset = self._dataset
            if self._stream is None or self._stream.has_ended:
                self._stream = _Stream(self._idle_seconds)
                threading.Thread(target=self._run, args=(self._stream,), name="isoscope-view", daemon=True).start()
        if self._stream is not None:
            self._stream.put(request)

    def _run(self, stream: _Stream) -> None:
        with self._client._channel.call_at_work():
            self._pass_frames(stream)

    def _pass_frames(self, stream: _Stream) -> None:
        target = self._client._target
        try:
            interact = self._client._channel.get().stream_stream(
                _METHOD, pb.InteractRequest.SerializeToString, pb.InteractResponse.FromString
            )
            call = interact(stream.requests(), timeout=_SESSION_SECONDS, metadata=target.call_metadata())
            stream.begin(call)
            for response in call:
                if stream.has_ended:
                    return
                self._send({"type": "isoscope/frame"}, [frame_message(response)])
        except grpc.RpcError as error:
            if not stream.has_ended:
                code = error.code().value[0] if isinstance(error.code(), grpc.StatusCode) else 2
                self._send_error(code, explain(error, target.address, _SESSION_SECONDS, target.tls).message)
        except Exception as error:  # a closed client: the browser must hear of it, if it is there
            if not stream.has_ended:
                with contextlib.suppress(Exception):
                    self._send_error(14, str(error))
        finally:
            stream.end()

    def _send_error(self, code: int, message: str) -> None:
        response = pb.InteractResponse(sequence_number=self._sequence_number)
        response.error.code, response.error.message = code, message
        self._send({"type": "isoscope/frame"}, [frame_message(response)])


class _Stream:
    """The requests of one call. Thread-safe."""

    def __init__(self, idle_seconds: float) -> None:
        self._idle_seconds = idle_seconds
        self._queue: queue.SimpleQueue[pb.InteractRequest | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._call: Any = None
        self.has_ended = False

    def put(self, request: pb.InteractRequest) -> None:
        self._queue.put(request)

    def requests(self) -> Iterator[pb.InteractRequest]:
        """Yields gRPC's messages, in a separate thread, until the end or until none comes for too long."""
        while not self.has_ended:
            try:
                request = self._queue.get(timeout=self._idle_seconds)
            except queue.Empty:
                break
            if request is None:
                break
            yield request
        self.end()

    def begin(self, call: Any) -> None:
        """Takes the call that `end` cancels."""
        with self._lock:
            self._call = call
            has_ended = self.has_ended
        if has_ended:
            call.cancel()

    def end(self) -> None:
        """Ends the call and both threads. Any number of times."""
        with self._lock:
            if self.has_ended:
                return
            self.has_ended = True
            call = self._call
        self._queue.put(None)
        if call is not None:
            call.cancel()


def frame_message(response: pb.InteractResponse) -> bytes:
    """Returns an answer as the gateway's WebSocket sends it."""
    image, depths = response.frame.png or response.frame.jpeg, response.depth_grid.depths
    kind = "image/png" if response.frame.png else "image/jpeg"
    rest = pb.InteractResponse()
    rest.CopyFrom(response)
    if rest.HasField("frame"):
        rest.frame.ClearField("png")
        rest.frame.ClearField("jpeg")
    if rest.HasField("depth_grid"):
        rest.depth_grid.ClearField("depths")
    values = json_format.MessageToDict(rest)
    values["image"] = {"type": kind, "bytes": len(image)}
    values["depthBytes"] = len(depths)
    head = json.dumps(values).encode()
    return struct.pack("<I", len(head)) + head + image + depths
