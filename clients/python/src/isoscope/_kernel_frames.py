"""Frames of a moving view through the kernel, where the browser can't reach the web gateway.

The viewer's module sends the WebSocket's messages to the kernel instead; here they become the call
InteractService.Interact, and its answers become what the WebSocket would have sent: a length, JSON,
the picture, the depths. Credits and adaption are between module and server; nothing is queued here.
"""

from __future__ import annotations

import json
import queue
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any

import grpc
from google.protobuf import json_format

from isoscope._proto import interact_service_pb2 as pb
from isoscope._proto import interact_service_pb2_grpc as rpc
from isoscope.errors import explain

# A view may be open for long; without a deadline, a lost server would never be noticed.
_SESSION_SECONDS = 24 * 3600.0
_STUB: Callable[[Any], Any] = rpc.InteractServiceStub


class KernelFrames:
    """One view's stream. `handle` takes the module's messages, `send(content, buffers)` answers them."""

    def __init__(self, client: Any, send: Callable[[dict[str, Any], list[bytes]], None], dataset: str) -> None:
        self._client = client
        self._send = send
        self._dataset = dataset
        self._requests: queue.SimpleQueue[pb.InteractRequest | None] | None = None
        self._sequence_number = 0

    def handle(self, content: Any) -> None:
        """Takes one message of the module; others are ignored."""
        kind = content.get("type") if isinstance(content, dict) else None
        if kind == "isoscope/open":
            self.close()
            self._requests = queue.SimpleQueue()
            threading.Thread(target=self._run, args=(self._requests,), name="isoscope-view", daemon=True).start()
        elif kind == "isoscope/interact" and self._requests is not None:
            self._interact(str(content.get("text", "")), self._requests)
        elif kind == "isoscope/close":
            self.close()

    def close(self) -> None:
        """Ends the stream; `handle` may open another."""
        requests, self._requests = self._requests, None
        if requests is not None:
            requests.put(None)

    def _interact(self, text: str, requests: queue.SimpleQueue[pb.InteractRequest | None]) -> None:
        try:
            request = json_format.Parse(text, pb.InteractRequest())
        except json_format.ParseError as error:
            self._send_error(3, f"the viewer and this package do not fit each other: {error}")
            return
        if request.HasField("view_state"):
            self._sequence_number = request.view_state.sequence_number
            # A view is of one dataset, whatever the browser says.
            request.view_state.frame.dataset = self._dataset
        requests.put(request)

    def _run(self, requests: queue.SimpleQueue[pb.InteractRequest | None]) -> None:
        def sent() -> Iterator[pb.InteractRequest]:
            while (request := requests.get()) is not None:
                yield request

        target = self._client._target
        try:
            call = _STUB(self._client._channel.get()).Interact(
                sent(), timeout=_SESSION_SECONDS, metadata=target.call_metadata()
            )
            for response in call:
                if self._requests is not requests:
                    call.cancel()
                    return
                self._send({"type": "isoscope/frame"}, [frame_message(response)])
        except grpc.RpcError as error:
            if self._requests is requests:
                code = error.code().value[0] if isinstance(error.code(), grpc.StatusCode) else 2
                self._send_error(code, explain(error, target.address, _SESSION_SECONDS, target.tls).message)
        except Exception as error:  # a closed client: the browser must hear of it
            if self._requests is requests:
                self._send_error(14, str(error))
        finally:
            # Ends the iterator in gRPC's thread.
            requests.put(None)

    def _send_error(self, code: int, message: str) -> None:
        response = pb.InteractResponse(sequence_number=self._sequence_number)
        response.error.code, response.error.message = code, message
        self._send({"type": "isoscope/frame"}, [frame_message(response)])


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
