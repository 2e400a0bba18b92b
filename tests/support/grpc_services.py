"""Stubs and servicers of gRPC by the descriptors of the services, for tests: the Python client has none of protoc's."""

import grpc


_KINDS = {
    "RenderIsosurfaceStream": "unary_stream", "ExportIsosurface": "unary_stream", "Interact": "stream_stream",
}  # fmt: skip


def _methods(module):
    """Yields (service, method, its kind, type of requests, of responses) for the single service of a module of
    messages."""
    (service,) = module.DESCRIPTOR.services_by_name.values()
    for name in service.methods_by_name:
        types = (getattr(module, name + end) for end in ("Request", "Response"))
        yield service.full_name, name, _KINDS.get(name, "unary_unary"), *types


class Stub:
    """Calls of a channel: a method for each one of the service."""

    def __init__(self, channel, module):
        for service, name, kind, request, response in _methods(module):
            call = getattr(channel, kind)(f"/{service}/{name}", request.SerializeToString, response.FromString)
            setattr(self, name, call)


def serve(implementation, server, *modules):
    """Lets a server answer the methods that `implementation` has."""
    for service, name, kind, request, response in (row for module in modules for row in _methods(module)):
        if hasattr(implementation, name):
            make = getattr(grpc, f"{kind}_rpc_method_handler")
            handler = make(getattr(implementation, name), request.FromString, response.SerializeToString)
            server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(service, {name: handler}),))
