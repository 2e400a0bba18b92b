// Writes frames as one animation: APNG or lossless WebP, by the name of the file.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANIMATION_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANIMATION_WRITER_H_

#include <array>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::client {

// The formats, which are also the ends of the files' names.
enum class AnimationFormat { kApng, kWebp };
inline constexpr std::array<AnimationFormat, 2> kAnimationFormats = {AnimationFormat::kWebp,
                                                                     AnimationFormat::kApng};
// "apng", "webp".
absl::string_view NameOf(AnimationFormat format);

// Options of an animation. It repeats without end.
struct AnimationOptions {
  int width_px = 0;
  int height_px = 0;
  int frame_count = 1;
  double fps = 12;         // in [0.1, 120]
  bool has_alpha = false;  // true if a frame may have a pixel that is not opaque
};

// Takes PNGs, all of one size, in order. Without Finish no file is left. Thread-compatible.
class AnimationWriter {
 public:
  virtual ~AnimationWriter() = default;

  // DATA_LOSS if `png` is no PNG, or has another size than the animation.
  virtual absl::Status AddFrame(absl::string_view png) = 0;
  // The file appears in one step. FAILED_PRECONDITION if frames are missing.
  virtual absl::Status Finish() = 0;
};

// True if the name ends in .apng or .webp, in letters of any case.
bool IsAnimationName(const std::string& path);

// OK if an animation of this size can be written: WebP has at most 16383 pixels a side. Otherwise
// INVALID_ARGUMENT.
absl::Status CheckAnimationSize(const std::string& path, int width_px, int height_px);

// REQUIRES: IsAnimationName(path), and CheckAnimationSize is OK. Errors as io::CreateWritableFile.
absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateAnimation(const std::string& path,
                                                                 const AnimationOptions& options);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANIMATION_WRITER_H_
