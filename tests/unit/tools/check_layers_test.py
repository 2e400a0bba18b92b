"""Tests tools/check_layers.py (its path is the first argument): each rule finds what breaks it."""

import importlib.util
import pathlib
import sys
import tempfile
import unittest

SCRIPT = sys.argv.pop(1)
_spec = importlib.util.spec_from_file_location("check_layers", SCRIPT)
check_layers = importlib.util.module_from_spec(_spec)
sys.dont_write_bytecode = True
_spec.loader.exec_module(check_layers)


class CheckIncludeTest(unittest.TestCase):
    def test_downward_and_own_includes_pass(self):
        for file, included in [
            ("core/render/a.cc", "core/view/view.h"),
            ("core/render/a.cc", "core/render/b.h"),
            ("core/base/a.cc", "vector"),
            ("rpc/channel.h", "grpcpp/channel.h"),
            ("core/cli/flag_set.cc", "CLI/CLI.hpp"),
            ("clients/cpp/connection/a.cc", "clients/cpp/request/b.h"),
            ("clients/cpp/request/a.h", "isoscope/v1/frame.pb.h"),
            ("server/frame/a.cc", "server/cluster/b.h"),
            ("server/a.cc", "server/frame/b.h"),
            ("web-gateway/a.cc", "clients/cpp/request/b.h"),
            ("client-cli/session/a.cc", "server/coordinator_server.h"),
            ("client-cli/commands/a.cc", "web-gateway/gateway_server.h"),
            ("bench/a.cc", "client-cli/session/session.h"),
        ]:
            self.assertIsNone(check_layers.check_include(file, included), (file, included))

    def test_upward_and_sideways_includes_fail(self):
        for file, included in [
            ("core/base/a.cc", "core/math/vec.h"),
            ("core/store/a.cc", "core/index/interval_tree.h"),
            ("rpc/a.cc", "server/frame/agent_link.h"),
            ("server/a.cc", "partition-agent/shard/shard.h"),
            ("partition-agent/a.cc", "server/frame/agent_link.h"),
            ("server/cluster/a.h", "server/coordinator_server.h"),
            ("server/cluster/a.h", "server/frame/b.h"),
            ("server/access/a.h", "server/admission/b.h"),
            ("clients/cpp/request/a.cc", "clients/cpp/connection/b.h"),
            ("clients/cpp/request/a.cc", "client-cli/output/b.h"),
            ("web-gateway/a.cc", "client-cli/session/session.h"),
            ("client-cli/output/a.cc", "client-cli/session/session.h"),
            ("client-cli/terminal/a.cc", "client-cli/commands/program.h"),
            ("client-cli/main.cc", "bench/program.h"),
            ("core/base/a.cc", "tests/support/temp_dir.h"),
        ]:
            self.assertIsNotNone(check_layers.check_include(file, included), (file, included))

    def test_formats_are_known_to_their_opener_alone(self):
        for file, included in [
            ("core/formats/a.cc", "core/formats/dicom/b.h"),
            ("core/formats/dicom/a.cc", "core/formats/dicom/b.h"),
            ("core/formats/dicom/a.cc", "core/source/bytes/b.h"),
            ("core/source/hdf5/a.cc", "core/source/child/b.h"),
            ("client-cli/session/a.cc", "core/formats/open_request.h"),
            ("client-cli/output/a.h", "core/source/volume_series.h"),
            ("client-cli/output/a.h", "core/source/adapt/value_range.h"),
        ]:
            self.assertIsNone(check_layers.check_include(file, included), (file, included))
        for file, included in [
            ("client-cli/session/a.cc", "core/formats/vtk/vtk_image.h"),
            ("client-cli/session/a.cc", "core/source/hdf5/hdf5_path.h"),
            ("bench/a.cc", "core/source/bytes/raw_file.h"),
            ("core/partition/a.cc", "core/formats/dicom/dicom_folder.h"),
            ("core/formats/dicom/a.cc", "core/formats/hdf5/b.h"),
            ("core/formats/dicom/a.cc", "core/formats/open_volume.h"),
            ("core/source/a.cc", "core/formats/dicom/b.h"),
        ]:
            self.assertIsNotNone(check_layers.check_include(file, included), (file, included))

    def test_grpc_messages_and_cli11_stay_in_their_rooms(self):
        for file, included in [
            ("core/store/a.cc", "isoscope/v1/frame.pb.h"),
            ("server/picture/a.cc", "google/protobuf/arena.h"),
            ("server/admission/a.h", "grpcpp/grpcpp.h"),
            ("client-cli/output/a.cc", "isoscope/v1/dataset_service.grpc.pb.h"),
            ("bench/peer.h", "grpcpp/grpcpp.h"),
            ("client-cli/commands/a.cc", "CLI/CLI.hpp"),
            ("core/cli/flag_set.h", "CLI/CLI.hpp"),
        ]:
            self.assertIsNotNone(check_layers.check_include(file, included), (file, included))

    def test_floors_hold_each_room_once_and_no_circle_fits_in(self):
        rooms = [room for floor in check_layers.FLOORS for room in floor]
        self.assertEqual(len(rooms), len(set(rooms)))
        for a in rooms:
            for b in rooms:
                there = check_layers.check_include(f"{a}/x.h", f"{b}/y.h") is None
                back = check_layers.check_include(f"{b}/y.h", f"{a}/x.h") is None
                self.assertFalse(a != b and there and back, (a, b))


class CheckLibmTest(unittest.TestCase):
    def test_elementary_functions_of_libm_decide_no_bit(self):
        for file, line in [
            ("core/view/a.cc", "  const double s = 1 / std::tan(x / 2);"),
            ("core/picture/a.h", "inline float P(float x) { return powf(x, 2); }"),
            ("server/frame/a.cc", "y = std::hypot (a, b) + ::exp2f(c);"),
            ("partition-agent/a.cc", "std::fma(a, b, c)"),
            ("core/math/a.h", "return std::atan2(y, x);"),
        ]:
            self.assertIsNotNone(check_layers.check_libm(file, line), (file, line))

    def test_exact_functions_own_ones_and_other_rooms_pass(self):
        for file, line in [
            ("core/view/a.cc", "  const double s = 1 / math::Tan(x / 2) + std::sqrt(y);"),
            ("core/view/a.cc", "  // at distance R / sin(fov/2)"),
            ("core/view/a.cc", "std::ldexp(std::floor(x), 3); shape.exp(2); image->log(x); MyExp(2);"),
            ("core/view/a.cc", "base::log(x); explog(3)"),
            ("client-cli/a.cc", "std::tan(x)"),
            ("core/synthetic/volume_generator.cc", "std::cos(x)"),
        ]:
            self.assertIsNone(check_layers.check_libm(file, line), (file, line))


class CheckTreeTest(unittest.TestCase):
    def test_complaints_name_file_and_line(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            (root / "core/base").mkdir(parents=True)
            (root / "core/base/a.h").write_text('\n#include "core/math/vec.h"\n')
            (root / "core/attic").mkdir()
            (root / "core/base/b.cc").write_text("double F(double x) {\n  return std::cos(x);\n}\n")
            (root / "core/README.md").write_text("# core\n")
            (root / "core/attic/c.h").write_text("\n")
            (root / "server/interact").mkdir(parents=True)
            (root / "wire").mkdir()
            for number in range(check_layers.MAX_SOURCES + 1):
                (root / f"wire/s{number}.cc").write_text("int x;\n")
            (root / "server/interact/rate_control.cc").write_text("int x;\n")
            complaints = "\n".join(check_layers.check(root))
        self.assertIn("core/base/a.h:2: core/base (floor 0) includes core/math/vec.h", complaints)
        self.assertIn("core/base/a.h:1: has no test tests/unit/core/base/a_test.cc", complaints)
        self.assertIn("core/base/b.cc:2: calls cos of libm", complaints)
        self.assertIn("server/interact/rate_control.cc:1: may call libm but does not", complaints)
        self.assertIn("core/attic/c.h:1: stands on no floor", complaints)
        self.assertIn("wire:1: has 31 sources, more than 30", complaints)
        self.assertIn("core/README.md:1: has another drawing", complaints)


if __name__ == "__main__":
    unittest.main()
