#include "clients/cpp/connection/render_frame.h"

#include <cstddef>

#include "clients/cpp/picture_file/npy_writer.h"
#include "core/base/status_macros.h"
#include "core/frame/output_spec.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;

// A single message is copied less often than parts, but needs memory for the whole twice. The
// server takes a picture for as large as its pixels.
constexpr std::size_t kMaxUnaryPlaneBytes = std::size_t{64} << 20;
constexpr std::size_t kMaxUnaryPixels = std::size_t{6} << 20;

// Returns the number of pixels. The service refuses a negative size.
std::size_t PixelsOf(const v1::RenderIsosurfaceRequest& request) {
  const int width =
      request.has_region() ? request.region().width_px() : request.viewport().width_px();
  const int height =
      request.has_region() ? request.region().height_px() : request.viewport().height_px();
  return width <= 0 || height <= 0
             ? 0
             : static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

std::size_t PlaneBytesPerPixel(const v1::OutputOptions& output) {
  return frame::RawBytesPerPixel({.image_format = frame::ImageFormat::kNone,
                                  .depth = output.depth(),
                                  .surface_index = output.surface_index(),
                                  .position = output.position(),
                                  .normal = output.normal(),
                                  .depth_bounds = output.depth_bounds()});
}

}  // namespace

absl::StatusOr<v1::RenderIsosurfaceResponse> RenderFrame(const v1::RenderIsosurfaceRequest& request,
                                                         absl::Duration timeout,
                                                         ServiceClient* client) {
  const std::size_t pixels = PixelsOf(request);
  return pixels > kMaxUnaryPixels ||
                 pixels * PlaneBytesPerPixel(request.output()) > kMaxUnaryPlaneBytes
             ? client->RenderIsosurfaceStream(request, timeout)
             : client->RenderIsosurface(request, timeout);
}

void RequestPlanes(const PlaneFiles& files, v1::OutputOptions* options) {
  options->set_depth(files.depth.has_value());
  options->set_surface_index(files.surface_index.has_value());
  options->set_position(files.position.has_value());
  options->set_normal(files.normal.has_value());
  options->set_depth_bounds(files.depth_bounds.has_value());
}

absl::Status WritePlanes(const PlaneFiles& files, const v1::RenderIsosurfaceResponse& response) {
  const int width = response.extent().width_px();
  const int height = response.extent().height_px();
  constexpr int kFloatBytes = 4;
  if (files.depth) {
    ISOSCOPE_RETURN_IF_ERROR(
        WriteNpy(*files.depth, "<f4", kFloatBytes, {height, width}, response.depth()));
  }
  if (files.surface_index) {
    ISOSCOPE_RETURN_IF_ERROR(
        WriteNpy(*files.surface_index, "|u1", 1, {height, width}, response.surface_index()));
  }
  if (files.position) {
    ISOSCOPE_RETURN_IF_ERROR(
        WriteNpy(*files.position, "<f4", kFloatBytes, {height, width, 3}, response.position()));
  }
  if (files.normal) {
    ISOSCOPE_RETURN_IF_ERROR(
        WriteNpy(*files.normal, "<f4", kFloatBytes, {height, width, 3}, response.normal()));
  }
  if (files.depth_bounds) {
    ISOSCOPE_RETURN_IF_ERROR(WriteNpy(*files.depth_bounds, "<f4", kFloatBytes, {height, width, 2},
                                      response.depth_bounds()));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::client
