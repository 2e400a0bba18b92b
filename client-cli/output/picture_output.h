// The output of `isoscope render`: one picture or numbered ones, each with its record, or one
// animation; all with annotations if they are requested.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_PICTURE_OUTPUT_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_PICTURE_OUTPUT_H_

#include <memory>
#include <ostream>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "clients/cpp/picture_file/animation_writer.h"
#include "clients/cpp/picture_file/annotations.h"
#include "core/view/camera.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// The path that stands for standard output.
inline constexpr char kStandardOutput[] = "-";

struct PictureOutputOptions {
  // With a number (FrameFileName) it names one picture for each frame. Empty: none is written.
  std::string path;
  std::ostream* out = nullptr;  // for kStandardOutput
  int frame_count = 1;
  double fps = 12;  // of an animation
  bool has_metadata = true;
  client::Annotations annotations = {};
  isoscope::v1::Dataset dataset = {};  // for annotations, and the record of each picture
  std::string picture_revision;        // for the record
};

// UsageError if the suffix of `path` implies a format that is not written, or if an animation can't
// have this size.
absl::Status CheckPicturePath(const std::string& path, const view::Viewport& viewport);

// Thread-compatible.
class PictureOutput {
 public:
  explicit PictureOutput(PictureOutputOptions options) : options_(std::move(options)) {}

  // Adds the answer to `request`, frame `index`. Frames come in order, all of one size. Without a
  // number in `path` only the last frame is kept, unless `path` is an animation.
  absl::Status Write(int index, const isoscope::v1::RenderIsosurfaceRequest& request,
                     const isoscope::v1::RenderIsosurfaceResponse& response);
  // Call after the last frame: writes an animation.
  absl::Status Finish();

  // The last picture, annotated, as PNG; empty before.
  [[nodiscard]] const std::string& last_png() const { return last_png_; }

 private:
  absl::Status WritePng(const std::string& path, const std::string& png) const;
  absl::Status AddToAnimation(const isoscope::v1::RenderIsosurfaceRequest& request,
                              const std::string& png);

  const PictureOutputOptions options_;
  std::unique_ptr<client::AnimationWriter>
      animation_;  // null for pictures, and before the first frame
  std::string last_png_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_PICTURE_OUTPUT_H_
