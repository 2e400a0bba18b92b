// A camera as JSON: an accepted one can see, and comes back with its bits.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "clients/cpp/request/camera_file.h"
#include "tests/fuzz/fuzz_input.h"
#include "wire/proto_convert.h"

namespace isoscope::fuzz {
namespace {

void Run(absl::string_view text) {
  const auto camera = client::CameraFromJson(text, "c.json");
  if (!camera.ok()) {
    RequireError(camera.status(), {absl::StatusCode::kInvalidArgument}, "c.json");
    return;
  }
  Require(wire::CameraFromProto(*camera, "camera").ok(), "an accepted camera can see");
  const auto again = client::CameraFromJson(client::CameraToJson(*camera), "again");
  Require(again.ok(), "a camera comes back from its text");
  const auto core = wire::CameraFromProto(*camera, "camera");
  const auto core_again = wire::CameraFromProto(*again, "camera");
  Require(core_again.ok() && *core == *core_again, "a camera comes back with its bits");
}

}  // namespace

std::vector<std::string> Seeds() {
  return {R"({"eye": [0, 0, 500], "target": [0, 0, 0], "up": [0, 1, 0],
             "perspective": {"fov_y_degrees": 30}})",
          R"({"eye": [1e-3, -2.5, 3], "target": [1e3, 0, 0], "orthographic": {"height": 200}})",
          R"({"eye": [0, 0], "target": null})"};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run({reinterpret_cast<const char*>(data), size});
  return 0;
}
