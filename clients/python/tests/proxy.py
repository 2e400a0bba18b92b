"""A gRPC proxy for tests: passes calls on, byte by byte, and can do what the service does not.

It shows the service a token of its own: whoever calls needs none, unless the test wants one.

TLS with or without client certificates, tokens, calls that fail the first times.
"""

import pathlib
import subprocess
from concurrent import futures

import grpc

from isoscope._proto.interact_service_pb2 import InteractRequest
from grpc_services import Stub
from isoscope._proto import isosurface_service_pb2


class _Passer(grpc.GenericRpcHandler):
    def __init__(self, proxy):
        self._proxy = proxy

    def service(self, details):
        proxy, method = self._proxy, details.method
        if method.endswith("/Interact") and proxy.interact is not None:
            return grpc.stream_stream_rpc_method_handler(
                lambda requests, context: proxy.interact(requests, Stub(proxy.upstream, isosurface_service_pb2)),
                InteractRequest.FromString,
                lambda response: response.SerializeToString(),
            )

        def pass_on(request, context):
            proxy.check(method, context)
            call = proxy.upstream.unary_stream(method)
            timeout = min(context.time_remaining() or 60, 60)
            try:
                yield from call(request, timeout=timeout)
            except grpc.RpcError as error:
                context.abort(error.code(), error.details())

        return grpc.unary_stream_rpc_method_handler(pass_on)


class _WithToken(grpc.UnaryUnaryClientInterceptor, grpc.UnaryStreamClientInterceptor):
    def __init__(self, token):
        self._metadata = (("authorization", f"Bearer {token}"),)

    def intercept_unary_unary(self, go_on, details, request):
        return go_on(details._replace(metadata=self._metadata), request)

    intercept_unary_stream = intercept_unary_unary


class Proxy:
    """Passes the calls on to the server of `client`.

    failures: (code, sentence) or (code, sentence, google.rpc.Status) of the next calls, instead of passing them on.
    token: what the calls must bring.
    interact: (requests, stub) -> responses, in place of InteractService.Interact.
    seen: (method, metadata, seconds left) of every call.
    """

    def __init__(self, client, *, credentials=None, token=None, interact=None):
        channel = grpc.insecure_channel(client.address, [("grpc.max_receive_message_length", -1)])
        self.upstream = grpc.intercept_channel(channel, _WithToken(pathlib.Path(client.token_file).read_text()))
        self.token = token
        self.interact = interact
        self.failures = []
        self.seen = []
        self._server = grpc.server(futures.ThreadPoolExecutor(4), handlers=[_Passer(self)])
        if credentials is None:
            self.port = self._server.add_insecure_port("127.0.0.1:0")
        else:
            self.port = self._server.add_secure_port("127.0.0.1:0", credentials)
        self.address = f"127.0.0.1:{self.port}"
        self._server.start()

    def check(self, method, context):
        metadata = dict(context.invocation_metadata())
        self.seen.append((method, metadata, context.time_remaining()))
        if self.token is not None and metadata.get("authorization") != f"Bearer {self.token}":
            context.abort(grpc.StatusCode.UNAUTHENTICATED, "a token is needed: authorization: Bearer TOKEN")
        if self.failures:
            code, sentence, *details = self.failures.pop(0)
            if details:
                context.set_trailing_metadata((("grpc-status-details-bin", details[0]),))
            context.abort(code, sentence)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._server.stop(None).wait()
        self.upstream.close()


def make_certificates(folder):
    """Writes ca.pem, server.pem, server.key, client.pem and client.key with openssl; returns the folder."""

    def openssl(*arguments):
        subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True, cwd=folder)

    openssl(
        "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", 2,
        "-subj", "/CN=test authority", "-keyout", "ca.key", "-out", "ca.pem",
    )  # fmt: skip
    for name in ("server", "client"):
        (folder / "names").write_text("subjectAltName=DNS:isoscope.test\n")
        openssl(
            "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", f"/CN={name}",
            "-keyout", f"{name}.key", "-out", f"{name}.csr",
        )  # fmt: skip
        openssl(
            "x509", "-req", "-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", 2,
            "-extfile", "names", "-out", f"{name}.pem",
        )  # fmt: skip
    return folder
