#!/usr/bin/env python3
"""Checks that #include lines keep to the floors of the project, and that headers have tests.

    tools/check_layers.py [ROOT]     checks the tree
    tools/check_layers.py --draw     prints the drawing of the floors that core/README.md has

Eight rules, each printed as `file:line: what is wrong`; exit code 1 if any is broken:

1. A room (a folder) includes itself and rooms on lower floors (FLOORS), never one on its own floor or above: so there
   is no circle. The three services (SERVICES) never include each other.
2. gRPC and protobuf appear only in the rooms of GRPC_ROOMS and PROTO_ROOMS.
3. x/y.h of core, wire and rpc has a test tests/unit/x/y_test.cc, or stands in UNTESTED_HEADERS with a reason.
4. CLI11 appears only in CLI11_FILE: its headers cost six seconds of compile time each time.
5. core, server and partition-agent call no elementary function of libm, whose bits depend on the
   machine: core/math/elementary.h has them. LIBM_FILES lists the exceptions with their reasons.
6. core/README.md has the drawing that --draw prints.
7. A room of a format (core/formats/x) is included by itself and core/formats alone: all others know the opener. Nor do
   others include the parts of readers (READER_ROOMS), but the contract (core/source) and the adapters.
8. A room has at most MAX_SOURCES sources (.cc).
"""

import pathlib
import re
import sys

# The rooms of each floor, from the top of the house to its ground.
FLOORS = [
    ["bench", "bench/peers", "clients/cpp/example"],
    ["client-cli"],
    ["client-cli/commands"],
    ["client-cli/terminal"],
    ["client-cli/session", "client-cli/output"],
    ["partition-agent", "server", "web-gateway"],
    ["partition-agent/play", "web-gateway/api"],
    ["partition-agent/frame", "web-gateway/http"],
    ["partition-agent/supply"],
    ["partition-agent/memory"],
    ["partition-agent/cache"],
    ["partition-agent/shard"],
    ["server/interact"],
    ["server/frame"],
    ["server/call", "server/cluster"],
    ["server/access", "server/admission", "server/picture"],
    ["clients/cpp/connection"],
    ["clients/cpp/request", "clients/cpp/mesh_file", "clients/cpp/picture_file"],
    ["rpc"],
    ["wire"],
    ["proto"],
    ["core/partition", "core/visibility", "core/picture", "core/render", "core/solid"],
    ["core/indexed"],
    ["core/frame", "core/store", "core/index", "core/extract", "core/composite", "core/formats"],
    [
        "core/formats/arrays",
        "core/formats/dicom",
        "core/formats/hdf5",
        "core/formats/maps",
        "core/formats/medical",
        "core/formats/netcdf",
        "core/formats/stacks",
        "core/formats/vtk",
        "core/formats/zarr",
    ],
    ["core/source/hdf5", "core/source/chunks", "core/source/remote"],
    ["core/source/child", "core/source/bytes"],
    ["core/source/adapt"],
    ["core/source"],
    ["core/source/grid", "core/synthetic"],
    ["core/mesh", "core/view"],
    ["core/http", "core/volume"],
    ["core/cli", "core/io", "core/math", "core/image"],
    ["core/base"],
]
# Room: floor, from the ground up.
ROOMS = {room: floor for floor, rooms in enumerate(reversed(FLOORS)) for room in rooms}

SERVICES = {"partition-agent", "server", "web-gateway"}

# The parts of readers, which only core/formats, its rooms, and each other may include.
READER_ROOMS = ("core/source/bytes", "core/source/child", "core/source/chunks", "core/source/hdf5")
FORMAT_ROOM = re.compile(r"core/formats/[^/]+$")

MAX_SOURCES = 30  # of a room: more are a room of their own

# Rooms that may include gRPC's headers and the generated service stubs (*.grpc.pb.h).
GRPC_ROOMS = {
    "proto",
    "rpc",
    "clients/cpp/connection",
    "partition-agent",
    "server",
    "server/call",
    "server/cluster",
    "server/frame",
    "server/interact",
    "client-cli/session",
    "web-gateway",
    "web-gateway/api",
}
# Rooms that may also include protobuf's headers and generated messages (*.pb.h).
PROTO_ROOMS = GRPC_ROOMS | {
    "wire",
    "clients/cpp/request",
    "clients/cpp/example",
    "client-cli/commands",
    "client-cli/output",
    "client-cli/terminal",
    "bench",
}

# The only file that may include CLI11's headers.
CLI11_FILE = "core/cli/flag_set.cc"

UNTESTED_HEADERS = {
    "core/source/volume_source.h": "the contract, by every reader's test",
    "core/source/chunks/chunked_array.h": "the contract, by stored_array_test",
    "core/source/volume_series.h": "the contract, by every reader's test",
    "core/source/series_entry.h": "plain data",
    "core/source/series_parts.h": "inside of find_volume_test and located_series_test",
    "core/formats/stacks/png_slice.h": "inside of image_slices_test",
    "core/source/bytes/raw_file.h": "inside of open_volume_test",
    "core/source/bytes/byte_source.h": "the contract: local_bytes_test, open_address_test",
    "core/source/bytes/object_store.h": "the contract: local_bytes_test, open_address_test",
    "core/source/remote/secret.h": "one type",
    "core/source/remote/remote_client.h": "inside of open_address_test and open_s3_test",
    "core/source/bytes/file_content.h": "inside of refused_formats_test",
    "core/source/grid/axis_distances.h": "one type",
    "core/source/grid/vtk_extent.h": "inside of vti_grid_test",
    "core/formats/medical/sample_format.h": "inside of open_volume_test",
    "core/formats/netcdf/minc_axis.h": "inside of minc1_series_test and minc2_header_test",
    "core/source/bytes/slice_image.h": "inside of image_slices_test",
    "core/source/hdf5/hdf5_file_lookup.h": "inside of hdf5_links_test and hdf5_storage_test",
    "core/store/sample_reader.h": "the contract: sample_opener_test",
    "core/store/source_volume.h": "inside of source_request_test and sample_opener_test",
    "core/store/shard_joiner.h": "inside of part_joiner_test and tests/integration/parts_test.py",
    "core/partition/part_writer.h": "inside of part_joiner_test",
    "core/base/shutdown_signal.h": "signals of real processes: tests/integration/fault_test.cc",
    "core/partition/block_batch.h": "inside of partitioner_test",
    "core/partition/level_writer.h": "inside of partition_levels_test",
    "core/partition/output_folder.h": "names, errors and what is left: partitioner_failure_test",
    "core/partition/shard_set.h": "inside of partitioner_test",
    "core/partition/volume_writer.h": "inside of partitioner_test",
    "core/partition/series_work_folder.h": "inside of series_partitioner_test",
    "core/partition/series_writer.h": "inside of series_partitioner_test",
    "core/io/transfers.h": "through file_test, scratch_file_test and read_queue_test",
    "core/io/read_engine.h": "both engines: tests/unit/core/io/read_queue_test.cc",
    "core/volume/scalar_span.h": "with every type and tie: tests/unit/core/volume/range_table_test.cc",
    "core/render/cpu_renderer.h": "the contract of both back ends: tests/unit/core/render/renderer_test.cc",
    "core/picture/light_kernel.h": "inside of deferred_shading_test",
    "core/http/peer_listener.h": "inside of metrics_server_test",
    "core/http/peer_stream.h": "inside of metrics_server_test; tests/integration/gateway_test.cc",
    "core/http/tls_context.h": "handshakes of real programs: tests/integration/gateway_tls_test.cc",
    "core/http/transport.h": "inside of http_reader_test and metrics_server_test",
    "rpc/channel.h": "limits and keepalive of real servers: tests/integration",
    "rpc/unary_call.h": "every unary call of tests/unit/server and tests/integration",
    "rpc/server_flags.h": "inside of server_program_test",
    "core/base/scoped_timer.h": "the times of frame_pipeline_test",
    "core/base/status_macros.h": "used by every test",
    "core/base/units.h": "constants",
    "core/base/version.h": "one constant; tests/unit/client-cli/commands/program_test.cc",
    "core/cli/command.h": "plain data; tests/unit/client-cli/commands/program_test.cc",
    "core/cli/program.h": "with the commands of a program: tests/unit/client-cli/commands/program_test.cc",
    "core/cli/interrupt.h": "signals of real processes: tests/integration/cli_test.cc",
    "core/frame/color.h": "plain data",
    "core/composite/band_decoder.h": "every damage: tests/unit/core/composite/pixel_codec_test.cc",
    "core/composite/band_encoder.h": "inside of pixel_codec_test",
    "core/extract/bit_row.h": "inside of block_extractor_test",
    "core/extract/edge_crossings-inl.h": "inside of block_extractor_test",
    "core/extract/gradient_normal-inl.h": "inside of block_extractor_test and label_kernels_test",
    "core/extract/vertex_batch.h": "inside of block_extractor_test",
    "core/extract/vertex_placement-inl.h": "inside of block_extractor_test",
    "core/extract/block_kernels.h": "inside of block_extractor_test",
    "core/extract/block_shape.h": "inside of block_extractor_test",
    "core/solid/block_field.h": "inside of block_surface_test",
    "core/solid/cell_pieces.h": "inside of block_surface_test",
    "core/solid/seams.h": "inside of block_surface_test",
    "core/solid/solid_complex.h": "inside of block_surface_test",
    "core/solid/surface_fans.h": "inside of block_surface_test",
    "core/solid/vertex_pool.h": "inside of block_surface_test",
    "core/index/interval_tree_builder.h": "inside of interval_tree_test",
    "core/index/interval_tree_format.h": "constants; inside of interval_tree_test",
    "core/source/bytes/file_source.h": "inside of volume_source_test",
    "core/source/grid/grid_rules.h": "inside of layout_formats_test and resampled_source_test",
    "core/source/hdf5/hdf5_handle.h": "inside of hdf5_source_test and hdf5_storage_test",
    "core/source/bytes/inflate_reader.h": "inside of volume_source_test",
    "core/source/bytes/sample_location.h": "inside of volume_source_test",
    "core/mesh/block_mesh.h": "plain data",
    "core/render/fragment_shader.h": "inside of renderer_test and layer_pass_test",
    "core/render/gl_mesh_drawer.h": "inside of renderer_test",
    "core/render/gl_objects.h": "inside of renderer_test",
    "core/render/gl_thread.h": "inside of renderer_test",
    "core/render/pass_resources.h": "inside of renderer_test",
    "core/render/raster_kernels.h": "inside of cpu_rasterizer_test",
    "core/render/shade_kernel.h": "inside of renderer_test",
    "core/store/json_fields.h": "inside of manifest_test",
    "core/store/sealed_json.h": "inside of manifest_test",
    "core/store/manifest_members.h": "inside of manifest_test and series_manifest_test",
    "core/picture/ambient_occlusion_kernel.h": "inside of ambient_occlusion_test",
    "core/volume/active_spans.h": "inside of range_table_test and span_octree_test",
    "core/visibility/ray_packet-inl.h": "inside of occluder_selection_test",
    "core/visibility/ray_kernel.h": "inside of occluder_selection_test",
    "core/view/footprint_kernel.h": "inside of view_test",
    "core/store/shard_format.h": "constants; inside of shard_reader_test",
    "core/frame/agent_statistics.h": "plain data",
    "core/frame/culling.h": "an enumeration",
    "core/volume/block_samples.h": "plain data",
}

# Rooms whose computations may affect the bits of a picture, and their files that may call libm all the same.
BIT_ROOMS = ("core/", "server/", "partition-agent/")
LIBM_FILES = {
    "core/synthetic/volume_generator.cc": "test volumes: samples are made once, then stored",
    "core/render/gl_mesh_drawer.cc": "pow in GLSL: the driver's, which is a part of the picture revision",
    "server/interact/rate_control.cc": "chooses a size by measured times",
}

# sqrt, fmod, remainder, frexp, ldexp and roundings are exact or correctly rounded by IEEE 754.
LIBM_CALL = re.compile(
    r"(?<![\w.>:])(?:std::|::)?"
    r"((?:a?(?:sin|cos|tan)h?|atan2|sincos|exp2?|exp10|expm1|pow|log(?:2|10|1p)?|cbrt|hypot|erfc?|[lt]gamma|fma)[fl]?)"
    r"\s*\("
)
COMMENT = re.compile(r"//.*")

# The lines of core/README.md between which the drawing stands.
DRAWING_BEGIN = "<!-- floors: made by tools/check_layers.py --draw -->"
DRAWING_END = "<!-- end of floors -->"

INCLUDE = re.compile(r'^\s*#\s*include\s+[<"]([^>"]+)[>"]')


def room_of(path):
    """The room that a path below the root lies in, or None."""
    folder = path.rpartition("/")[0]
    return folder if folder in ROOMS else None


def check_include(file, included):
    """Returns the fault of `file` including `included`, or None."""
    of_file, of_included = room_of(file), room_of(included)
    if included.endswith(".grpc.pb.h") or included.startswith(("grpc/", "grpcpp/")):
        if of_file not in GRPC_ROOMS:
            return f"gRPC ({included}) is not for {of_file}; see GRPC_ROOMS"
        return None
    if included.endswith(".pb.h") or included.startswith("google/protobuf/"):
        if of_file not in PROTO_ROOMS:
            return f"messages ({included}) are not for {of_file}; see PROTO_ROOMS"
        return None
    if included.startswith("CLI/") and file != CLI11_FILE:
        return f"CLI11 ({included}) is for {CLI11_FILE}: use core/cli/flag_set.h"
    if included.startswith("tests/"):
        return f"product code includes {included}"
    if of_included is None or of_file == of_included:
        return None
    if not of_file.startswith("core/formats"):
        if FORMAT_ROOM.match(of_included):
            return f"{of_file} includes {included}: formats are for core/formats, the opener, alone"
        if of_included in READER_ROOMS and not of_file.startswith("core/source"):
            return f"{of_file} includes {included}: parts of readers are for core/formats; see READER_ROOMS"
    services = {room.partition("/")[0] for room in (of_file, of_included)}
    if len(services) == 2 and services <= SERVICES:
        return f"{of_file} includes {included}: services do not know each other"
    if ROOMS[of_included] >= ROOMS[of_file]:
        return f"{of_file} (floor {ROOMS[of_file]}) includes {included} (floor {ROOMS[of_included]})"
    return None


def draw():
    """Returns the floors as text, the highest first. A floor within a program belongs to the program alone."""
    lines = []
    for floor, rooms in zip(range(len(FLOORS) - 1, -1, -1), FLOORS):
        lines.append(f"{floor:4}  " + "   ".join(rooms))
    return "```\n" + "\n".join(lines) + "\n```\n"


def check_libm(file, line):
    """Returns the fault of `line` of `file` calling libm, or None."""
    if not file.startswith(BIT_ROOMS) or file in LIBM_FILES:
        return None
    match = LIBM_CALL.search(COMMENT.sub("", line))
    return match and (
        f"calls {match.group(1)} of libm, whose bits depend on the machine: use core/math/elementary.h"
    )


def check(root):
    """Returns all faults of the tree below `root`."""
    complaints = []
    for room in ROOMS:
        sources = len(list((root / room).glob("*.cc")))
        if sources > MAX_SOURCES:
            complaints.append(f"{room}:1: has {sources} sources, more than {MAX_SOURCES}: split the room")
        for path in sorted((root / room).glob("*")):
            if path.suffix not in (".h", ".cc"):
                continue
            file = path.relative_to(root).as_posix()
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
                match = INCLUDE.match(line)
                complaint = check_include(file, match.group(1)) if match else check_libm(file, line)
                if complaint:
                    complaints.append(f"{file}:{number}: {complaint}")
            if path.suffix == ".h" and room.startswith(("core/", "wire", "rpc")):
                test = f"tests/unit/{file[:-2]}_test.cc"
                if file not in UNTESTED_HEADERS and not (root / test).exists():
                    complaints.append(f"{file}:1: has no test {test}")
    for house in sorted({room.partition("/")[0] for room in ROOMS}):
        for path in sorted((root / house).rglob("*.h")) + sorted((root / house).rglob("*.cc")):
            file = path.relative_to(root).as_posix()
            if room_of(file) is None:
                complaints.append(f"{file}:1: stands on no floor; add its folder to FLOORS")
    readme = root / "core/README.md"
    if readme.exists() and f"{DRAWING_BEGIN}\n{draw()}{DRAWING_END}\n" not in readme.read_text(encoding="utf-8"):
        complaints.append("core/README.md:1: has another drawing of the floors than --draw prints")
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
    if sys.argv[1:] == ["--draw"]:
        print(draw(), end="")
        return 0
    default = pathlib.Path(__file__).resolve().parent.parent
    root = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else default
    complaints = check(root)
    for complaint in complaints:
        print(complaint)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
