"""The errors that a method may give: read from the comments of the protos, which are the promise."""

import pathlib
import re

PROTOS = pathlib.Path(__file__).resolve().parents[2] / "proto" / "isoscope" / "v1"
_CODE = (
    "CANCELLED|INVALID_ARGUMENT|DEADLINE_EXCEEDED|NOT_FOUND|ALREADY_EXISTS|PERMISSION_DENIED|RESOURCE_EXHAUSTED|"
    "FAILED_PRECONDITION|ABORTED|OUT_OF_RANGE|UNIMPLEMENTED|INTERNAL|UNAVAILABLE|DATA_LOSS|UNAUTHENTICATED|UNKNOWN"
)
# The server says with these that the request is wrong, or that the server is. Requests of the harness are right.
_NEVER_RIGHT = {"INVALID_ARGUMENT", "INTERNAL", "CANCELLED", "PERMISSION_DENIED", "UNAUTHENTICATED"}


def parse(text):
    """{method: codes} of one proto: those in the bullets and sentences after "Errors:" above an rpc."""
    found = {}
    for comment, method in re.findall(r"((?:^ *//[^\n]*\n)+) *rpc (\w+)\(", text, re.MULTILINE):
        words = " ".join(re.sub(r"^ *// ?", "", line) for line in comment.splitlines())
        if "Errors:" not in words:
            continue
        errors = words.split("Errors:", 1)[1]
        codes = set(re.findall(rf"\b({_CODE})\b", errors))
        if like := re.search(r"\b[Aa]s (\w+)\.", errors):
            codes |= found.get(like.group(1), set())
        found[method] = codes
    return found


def load(folder=PROTOS):
    """{method: codes that a right request may get}."""
    codes = {}
    for path in sorted(folder.glob("*_service.proto")):
        codes.update(parse(path.read_text()))
    # Its own table is that of the stream; frames in it have the errors of frames.
    codes["Interact"] |= codes["RenderIsosurface"]
    return {method: found - _NEVER_RIGHT for method, found in codes.items()}
