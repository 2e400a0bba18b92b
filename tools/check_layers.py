#!/usr/bin/env python3
"""Checks that #include lines keep to the floors of the project, and that headers have tests.

    tools/check_layers.py [ROOT]

Five rules, each printed as `file:line: what is wrong`; exit code 1 if any is broken:

1. A module includes itself and modules on lower floors (MODULES), never higher ones; server and
   partition-agent, on the same floor, never include each other. A program's main.cc may include all.
2. gRPC and protobuf appear only in the files of GRPC_FILES and PROTO_FILES.
3. core/x/y.h has a test tests/unit/core/x/y_test.cc, or stands in UNTESTED_HEADERS with a reason.
4. CLI11 appears only in CLI11_FILE: its headers cost six seconds of compile time each time.
5. core, server and partition-agent call no elementary function of libm, whose bits depend on the
   machine: core/math/elementary.h has them. LIBM_FILES lists the exceptions with their reasons.
"""

import pathlib
import re
import sys

# Module: floor. A module may include modules on lower floors.
MODULES = {
    "core/base": 0,
    "core/cli": 1,
    "core/io": 1,
    "core/math": 1,
    "core/image": 1,
    "core/volume": 2,
    "core/mesh": 3,
    "core/view": 3,
    "core/frame": 4,
    "core/store": 4,
    "core/index": 4,
    "core/extract": 4,
    "core/composite": 4,
    "core/source": 4,
    "core/partition": 5,
    "core/picture": 5,
    "core/visibility": 5,
    "core/picture": 5,
    "core/render": 5,
    "proto": 5,
    "core/rpc": 6,
    "partition-agent": 7,
    "server": 7,
    "client-cli": 8,
    "bench": 9,
    "web-gateway": 9,
}

# Programs put modules together: */main.cc may include all of them.
ABOVE_ALL = 1 + max(MODULES.values())

# Who may name gRPC's headers, and the generated service stubs (*.grpc.pb.h).
GRPC_FILES = re.compile(
    r"(core/rpc|proto)/.*"
    r"|(server|partition-agent)/(.*_service_impl|.*_server|main)\.(h|cc)"
    r"|server/(agent_client|agent_prober|agent_queries|dataset_catalog|frame_call|frame_runner|interact_frame|render_statistics)\.(h|cc)"
    r"|client-cli/(coordinator_channel|service_client|embedded_cluster)\.(h|cc)"
    r"|web-gateway/(coordinator_client|interact_stream|gateway_server)\.(h|cc)"
)
# Who may name protobuf's headers and generated messages (*.pb.h).
PROTO_FILES = re.compile(GRPC_FILES.pattern + r"|(client-cli|bench|web-gateway)/.*")

# Who may name CLI11's headers.
CLI11_FILE = "core/cli/flag_set.cc"

UNTESTED_HEADERS = {
    "core/base/shutdown_signal.h": "signals of real processes: tests/integration/fault_test.cc",
    "core/volume/scalar_span.h": "with every type and tie: tests/unit/core/volume/range_table_test.cc",
    "core/render/cpu_renderer.h": "the contract of both back ends: tests/unit/core/render/renderer_test.cc",
    "core/picture/light_kernel.h": "inside of deferred_shading_test",
    "core/rpc/channel.h": "limits and keepalive of real servers: tests/integration",
    "core/rpc/unary_call.h": "every unary call of tests/unit/server and tests/integration",
    "core/rpc/server_flags.h": "inside of server_program_test",
    "core/base/scoped_timer.h": "the times of frame_pipeline_test",
    "core/base/status_macros.h": "used by every test",
    "core/base/units.h": "constants",
    "core/base/version.h": "one constant; tests/unit/client-cli/commands_test.cc",
    "core/composite/band_decoder.h": "every damage: tests/unit/core/composite/pixel_codec_test.cc",
    "core/composite/band_encoder.h": "inside of pixel_codec_test",
    "core/extract/bit_row.h": "inside of block_extractor_test",
    "core/extract/edge_crossings-inl.h": "inside of block_extractor_test",
    "core/extract/vertex_batch.h": "inside of block_extractor_test",
    "core/extract/vertex_placement-inl.h": "inside of block_extractor_test",
    "core/extract/block_kernels.h": "inside of block_extractor_test",
    "core/extract/block_shape.h": "inside of block_extractor_test",
    "server/frame_call.h": "every call of isosurface_service_test and tests/integration/planes_test.cc",
    "core/index/interval_tree_builder.h": "inside of interval_tree_test",
    "core/index/interval_tree_format.h": "constants; inside of interval_tree_test",
    "core/source/file_source.h": "inside of volume_source_test",
    "core/source/hdf5_handle.h": "inside of hdf5_source_test and hdf5_storage_test",
    "core/source/inflate_reader.h": "inside of volume_source_test",
    "core/source/itk_header.h": "inside of volume_source_test",
    "core/source/sample_location.h": "inside of volume_source_test",
    "core/mesh/block_mesh.h": "plain data",
    "core/cli/command.h": "plain data; tests/unit/client-cli/commands_test.cc",
    "core/cli/interrupt.h": "signals of real processes: tests/integration/cli_test.cc",
    "core/frame/appearance.h": "plain data",
    "core/frame/color.h": "plain data",
    "core/render/gl_mesh_drawer.h": "inside of renderer_test",
    "core/render/gl_objects.h": "inside of renderer_test",
    "core/render/gl_thread.h": "inside of renderer_test",
    "core/render/pass_resources.h": "inside of renderer_test",
    "core/render/raster_kernels.h": "inside of cpu_rasterizer_test",
    "core/render/shade_kernel.h": "inside of renderer_test",
    "core/store/json_fields.h": "inside of manifest_test",
    "core/store/sealed_json.h": "inside of manifest_test",
    "core/picture/ambient_occlusion_kernel.h": "inside of ambient_occlusion_test",
    "core/visibility/ray_kernel.h": "inside of occluder_selection_test",
    "core/view/footprint_kernel.h": "inside of view_test",
    "core/store/shard_format.h": "constants; inside of shard_reader_test",
    "core/frame/agent_statistics.h": "plain data",
    "core/frame/culling.h": "an enumeration",
    "core/frame/picture_effects.h": "plain data",
    "core/volume/block_samples.h": "plain data",
}

# Rooms whose computations may decide a bit of a picture, and who may call libm there all the same.
BIT_ROOMS = ("core/", "server/", "partition-agent/")
LIBM_FILES = {
    "core/source/volume_generator.cc": "test volumes: samples are made once, then stored",
    "core/render/gl_mesh_drawer.cc": "pow in GLSL: the driver's, which is a part of the picture revision",
    "server/rate_control.cc": "chooses a size by measured times",
}

# sqrt, fmod, remainder, frexp, ldexp and roundings are exact or correctly rounded by IEEE 754.
LIBM_CALL = re.compile(
    r"(?<![\w.>:])(?:std::|::)?"
    r"((?:a?(?:sin|cos|tan)h?|atan2|sincos|exp2?|exp10|expm1|pow|log(?:2|10|1p)?|cbrt|hypot|erfc?|[lt]gamma|fma)[fl]?)"
    r"\s*\("
)
COMMENT = re.compile(r"//.*")

INCLUDE = re.compile(r'^\s*#\s*include\s+[<"]([^>"]+)[>"]')


def module_of(path):
    """The module that a path below the root belongs to, or None."""
    for module in MODULES:
        if path.startswith(module + "/"):
            return module
    return None


def floor_of(file):
    """The floor that `file`, which belongs to a module, stands on."""
    return ABOVE_ALL if file.endswith("/main.cc") else MODULES[module_of(file)]


def check_include(file, included):
    """What is wrong with `file` including `included`, or None."""
    if included.endswith(".grpc.pb.h") or included.startswith(("grpc/", "grpcpp/")):
        if not GRPC_FILES.fullmatch(file):
            return f"gRPC ({included}) is for core/rpc, servers and service clients"
        return None
    if included.endswith(".pb.h") or included.startswith("google/protobuf/"):
        if not PROTO_FILES.fullmatch(file):
            return f"messages ({included}) are for core/rpc, servers, client-cli, bench and web-gateway"
        return None
    if included.startswith("CLI/") and file != CLI11_FILE:
        return f"CLI11 ({included}) is for {CLI11_FILE}: use core/cli/flag_set.h"
    of_file, of_included = module_of(file), module_of(included)
    if of_included is None or of_file == of_included:
        if included.startswith("tests/"):
            return f"product code includes {included}"
        return None
    if MODULES[of_included] >= floor_of(file):
        return f"{of_file} (floor {MODULES[of_file]}) includes {included} (floor {MODULES[of_included]})"
    return None


def check_libm(file, line):
    """What is wrong with `line` of `file` calling libm, or None."""
    if not file.startswith(BIT_ROOMS) or file in LIBM_FILES:
        return None
    match = LIBM_CALL.search(COMMENT.sub("", line))
    return match and (
        f"calls {match.group(1)} of libm, whose bits depend on the machine: use core/math/elementary.h"
    )


def check(root):
    """All complaints about the tree below `root`."""
    complaints = []
    for module in MODULES:
        for path in sorted((root / module).glob("*")):
            if path.suffix not in (".h", ".cc"):
                continue
            file = path.relative_to(root).as_posix()
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
                match = INCLUDE.match(line)
                complaint = check_include(file, match.group(1)) if match else check_libm(file, line)
                if complaint:
                    complaints.append(f"{file}:{number}: {complaint}")
            if path.suffix == ".h" and module.startswith("core/"):
                test = f"tests/unit/{file[:-2]}_test.cc"
                if file not in UNTESTED_HEADERS and not (root / test).exists():
                    complaints.append(f"{file}:1: has no test {test}")
    for folder in sorted(p for p in (root / "core").glob("*") if p.is_dir()):
        if f"core/{folder.name}" not in MODULES:
            complaints.append(f"core/{folder.name}:1: stands on no floor; add it to {__file__}")
    for source in LIBM_FILES:
        path = root / source
        if path.exists() and not any(
            LIBM_CALL.search(COMMENT.sub("", line)) for line in path.read_text(encoding="utf-8").splitlines()
        ):
            complaints.append(f"{source}:1: may call libm but does not")
    for header in UNTESTED_HEADERS:
        if (root / "core").exists() and not (root / header).exists():
            complaints.append(f"{header}:1: is excused from a test but does not exist")
    return complaints


def main():
    default = pathlib.Path(__file__).resolve().parent.parent
    root = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else default
    complaints = check(root)
    for complaint in complaints:
        print(complaint)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
