// Write, for each frame:
//
//   1. Skip a frame that a later one would overwrite: one name without a number.
//   2. Draw the annotations, if any, over the decoded picture, and encode it again.
//   3. Add it to the animation, or
//   4. add the record to the PNG (docs/format/picture.md), and write it to the file or to standard
//      output. Masks and partial pictures have no record, because none could reproduce them.
//
// The record of an annotated picture has the digest of the plain PNG and the boxes that were drawn
// over, so that `render --like` can compare all other pixels.

#include "client-cli/output/picture_output.h"

#include <optional>
#include <utility>

#include "client-cli/output/frame_name.h"
#include "client-cli/output/output_suffix.h"
#include "clients/cpp/connection/annotated_picture.h"
#include "clients/cpp/connection/film_file.h"
#include "clients/cpp/connection/png_metadata.h"
#include "core/base/status_macros.h"
#include "core/cli/usage.h"
#include "core/io/atomic_file.h"

namespace isoscope::cli {
namespace {

// Of pictures, and of animations (client::IsAnimationName).
constexpr char kPictureSuffixes[] = ".png and .jpg, and .apng and .webp for films";

}  // namespace

absl::Status CheckPicturePath(const std::string& path, const view::Viewport& viewport) {
  if (path == kStandardOutput) {
    return absl::OkStatus();
  }
  const std::string first = FrameFileName(path, 0);
  if (client::IsAnimationName(first)) {
    ISOSCOPE_RETURN_IF_ERROR(
        AsUsageError(client::CheckAnimationSize(path, viewport.width_px, viewport.height_px)));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(CheckSuffix(first, ".png", kPictureSuffixes));
  }
  return absl::OkStatus();
}

absl::Status PictureOutput::Write(int index, const isoscope::v1::RenderIsosurfaceRequest& request,
                                  const isoscope::v1::RenderIsosurfaceResponse& response) {
  const std::string path = FrameFileName(options_.path, index);
  const bool is_animation = client::IsAnimationName(path);
  const bool is_kept =
      is_animation || index + 1 == options_.frame_count || HasFrameNumber(options_.path);
  if (!is_kept) {
    return absl::OkStatus();
  }
  std::string png = response.png();
  std::optional<client::AnnotatedPicture> annotated;
  if (options_.annotations.any()) {
    ISOSCOPE_ASSIGN_OR_RETURN(annotated, client::AnnotatePng(options_.annotations, request,
                                                             response, options_.dataset, &png));
  }
  last_png_ = png;
  if (options_.path.empty()) {
    return absl::OkStatus();
  }
  if (is_animation) {
    return AddToAnimation(request, png);
  }
  // The picture of the mask depends on the shards, and a partial one on the agents that were
  // available. No record could reproduce it.
  if (!options_.has_metadata || request.culling() == isoscope::v1::CULLING_MASK ||
      response.statistics().missing_shards_size() > 0) {
    return WritePng(path, png);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string with_record,
                            client::RecordPng(png, request, response, options_.dataset,
                                              options_.picture_revision, std::move(annotated)));
  return WritePng(path, with_record);
}

absl::Status PictureOutput::WritePng(const std::string& path, const std::string& png) const {
  if (path != kStandardOutput) {
    return io::WriteFileAtomically(path, png);
  }
  *options_.out << png << std::flush;
  return options_.out->good()
             ? absl::OkStatus()
             : absl::DataLossError("the picture can't be written to standard output");
}

absl::Status PictureOutput::AddToAnimation(const isoscope::v1::RenderIsosurfaceRequest& request,
                                           const std::string& png) {
  if (animation_ == nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        animation_, client::CreateFilm(options_.path, request, options_.frame_count, options_.fps));
  }
  return animation_->AddFrame(png);
}

absl::Status PictureOutput::Finish() {
  return animation_ != nullptr ? animation_->Finish() : absl::OkStatus();
}

}  // namespace isoscope::cli
