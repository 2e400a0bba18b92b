#include "clients/cpp/picture_file/animation_writer.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "clients/cpp/picture_file/apng_writer.h"
#include "clients/cpp/picture_file/webp_writer.h"
#include "core/cli/usage.h"

namespace isoscope::client {
namespace {

bool IsWebp(const std::string& path) { return absl::EndsWithIgnoreCase(path, ".webp"); }

}  // namespace

absl::string_view NameOf(AnimationFormat format) {
  return format == AnimationFormat::kApng ? "apng" : "webp";
}

bool IsAnimationName(const std::string& path) {
  return IsWebp(path) || absl::EndsWithIgnoreCase(path, ".apng");
}

absl::Status CheckAnimationSize(const std::string& path, int width_px, int height_px) {
  if (IsWebp(path) && (width_px > kMaxWebpSidePx || height_px > kMaxWebpSidePx)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "--output '", path, "': ", width_px, " x ", height_px, " pixels; a WebP has at most ",
        kMaxWebpSidePx, " a side: write an .apng, or a smaller picture"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateAnimation(const std::string& path,
                                                                 const AnimationOptions& options) {
  return IsWebp(path) ? CreateWebp(path, options) : CreateApng(path, options);
}

}  // namespace isoscope::client
