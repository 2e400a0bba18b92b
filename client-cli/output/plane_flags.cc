#include "client-cli/output/plane_flags.h"

#include <filesystem>

#include "absl/strings/match.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/io/atomic_file.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

absl::StatusOr<std::int64_t> ParseQuality(absl::string_view text) {
  return client::ParseInteger(text, 1, 100);
}

}  // namespace

void AddPlaneFlags(FlagSet* set, PlaneFlags* flags) {
  AddFlag(set, "--quality", "N", &flags->jpeg_quality, ParseQuality,
          "of a JPEG, 1 to 100 (default: 90)");
  AddFlag(set, "--depth", "FILE.npy", &flags->files.depth, ParseText,
          "write each pixel's distance from the eye along the view axis, in world units; "
          "infinity for the background");
  AddFlag(set, "--surface-index", "FILE.npy", &flags->files.surface_index, ParseText,
          "write which surface each pixel shows, from 0; 255 for the background");
  AddFlag(set, "--position", "FILE.npy", &flags->files.position, ParseText,
          "write each pixel's point in world space; NaN for the background");
  AddFlag(set, "--normal", "FILE.npy", &flags->files.normal, ParseText,
          "write each pixel's unit normal in world space; NaN for the background");
  AddFlag(set, "--depth-bounds", "FILE.npy", &flags->files.depth_bounds, ParseText,
          "write the nearest and the farthest --depth that the exact picture can have at each "
          "pixel; both infinite where it is proved background (docs/numerics.md)");
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
       {flags.files.depth, flags.files.surface_index, flags.files.position, flags.files.normal,
        flags.files.depth_bounds}) {
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
  client::RequestPlanes(flags.files, &options);
  return options;
}

}  // namespace isoscope::cli
