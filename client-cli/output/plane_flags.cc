#include "client-cli/output/plane_flags.h"

#include <filesystem>

#include "absl/strings/match.h"

#include "clients/cpp/picture_file/npy_writer.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/frame/output_spec.h"
#include "core/io/atomic_file.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

absl::StatusOr<std::int64_t> ParseQuality(absl::string_view text) {
  return client::ParseInteger(text, 1, 100);
}

}  // namespace

std::size_t PlaneFlags::bytes_per_pixel() const {
  return frame::RawBytesPerPixel({.image_format = frame::ImageFormat::kNone,
                                  .depth = depth.has_value(),
                                  .surface_index = surface_index.has_value(),
                                  .position = position.has_value(),
                                  .normal = normal.has_value()});
}

void AddPlaneFlags(FlagSet* set, PlaneFlags* flags) {
  AddFlag(set, "--quality", "N", &flags->jpeg_quality, ParseQuality,
          "of a JPEG, 1 to 100 (default: 90)");
  AddFlag(set, "--depth", "FILE.npy", &flags->depth, ParseText,
          "write each pixel's distance from the eye along the view axis, in world units; "
          "infinity for the background");
  AddFlag(set, "--surface-index", "FILE.npy", &flags->surface_index, ParseText,
          "write which surface each pixel shows, from 0; 255 for the background");
  AddFlag(set, "--position", "FILE.npy", &flags->position, ParseText,
          "write each pixel's point in world space; NaN for the background");
  AddFlag(set, "--normal", "FILE.npy", &flags->normal, ParseText,
          "write each pixel's unit normal in world space; NaN for the background");
}

bool IsJpegName(const std::string& path) {
  const std::string suffix = std::filesystem::path(path).extension().string();
  return absl::EqualsIgnoreCase(suffix, ".jpg") || absl::EqualsIgnoreCase(suffix, ".jpeg");
}

absl::Status CheckUsage(const PlaneFlags& flags, const std::optional<std::string>& output) {
  if (flags.jpeg_quality && !(output && IsJpegName(*output))) {
    return UsageError("--quality is for JPEG: --output must end in .jpg");
  }
  return absl::OkStatus();
}

absl::Status CheckWritable(const PlaneFlags& flags) {
  for (const std::optional<std::string>& path :
       {flags.depth, flags.surface_index, flags.position, flags.normal}) {
    if (path) {
      ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*path));
    }
  }
  return absl::OkStatus();
}

v1::OutputOptions MakeOutputOptions(const PlaneFlags& flags,
                                    const std::optional<std::string>& output) {
  v1::OutputOptions options;
  if (!output) {
    options.set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
  } else if (IsJpegName(*output)) {
    options.set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
    options.set_jpeg_quality(static_cast<std::int32_t>(flags.jpeg_quality.value_or(0)));
  }
  options.set_depth(flags.depth.has_value());
  options.set_surface_index(flags.surface_index.has_value());
  options.set_position(flags.position.has_value());
  options.set_normal(flags.normal.has_value());
  return options;
}

absl::Status WritePlanes(const PlaneFlags& flags, const v1::RenderIsosurfaceResponse& response) {
  const int width = response.extent().width_px();
  const int height = response.extent().height_px();
  constexpr int kFloatBytes = 4;
  if (flags.depth) {
    ISOSCOPE_RETURN_IF_ERROR(
        client::WriteNpy(*flags.depth, "<f4", kFloatBytes, {height, width}, response.depth()));
  }
  if (flags.surface_index) {
    ISOSCOPE_RETURN_IF_ERROR(client::WriteNpy(*flags.surface_index, "|u1", 1, {height, width},
                                              response.surface_index()));
  }
  if (flags.position) {
    ISOSCOPE_RETURN_IF_ERROR(client::WriteNpy(*flags.position, "<f4", kFloatBytes,
                                              {height, width, 3}, response.position()));
  }
  if (flags.normal) {
    ISOSCOPE_RETURN_IF_ERROR(
        client::WriteNpy(*flags.normal, "<f4", kFloatBytes, {height, width, 3}, response.normal()));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::cli
