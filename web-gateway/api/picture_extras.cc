#include "web-gateway/api/picture_extras.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "clients/cpp/connection/annotated_picture.h"
#include "clients/cpp/picture_file/annotation_flags.h"
#include "clients/cpp/picture_file/webp_writer.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/view/camera.h"
#include "web-gateway/api/render_query.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

bool IsPng(const v1::RenderIsosurfaceRequest& request) {
  return request.output().image_format() == v1::OutputOptions::IMAGE_FORMAT_UNSPECIFIED ||
         request.output().image_format() == v1::OutputOptions::IMAGE_FORMAT_PNG;
}

// A size that is wrong is the coordinator's to refuse.
view::Viewport SizeOf(const v1::RenderIsosurfaceRequest& request) {
  const bool is_part = request.has_region();
  return {is_part ? request.region().width_px() : request.viewport().width_px(),
          is_part ? request.region().height_px() : request.viewport().height_px()};
}

// INVALID_ARGUMENT if the picture is too large to be decoded, or for a WebP.
absl::Status CheckSize(const PictureExtras& extras, const view::Viewport& size) {
  const std::int64_t pixels =
      std::max<std::int64_t>(size.width_px, 0) * std::max<std::int64_t>(size.height_px, 0);
  if (extras.needs_pixels() && pixels > kMaxDecodedPixels) {
    return absl::InvalidArgumentError(
        absl::StrCat("the picture has ", pixels,
                     " pixels: axes, scale-bar, legend and caption are drawn on at most ",
                     kMaxDecodedPixels, ", and a WebP is made of as many"));
  }
  if (extras.is_webp && std::max(size.width_px, size.height_px) > client::kMaxWebpSidePx) {
    return absl::InvalidArgumentError(absl::StrCat("the picture has ", size.width_px, " x ",
                                                   size.height_px, " pixels: a WebP has at most ",
                                                   client::kMaxWebpSidePx, " a side"));
  }
  return absl::OkStatus();
}

bool ShowsQuantity(const v1::RenderIsosurfaceRequest& request) {
  return (request.has_caps() && request.caps().color_map() != v1::COLOR_MAP_UNSPECIFIED) ||
         std::any_of(request.surfaces().begin(), request.surfaces().end(),
                     [](const v1::Surface& surface) { return surface.has_color_by(); });
}

}  // namespace

void AddExtrasFlags(cli::FlagSet* set, PictureExtras* extras) {
  client::AddAnnotationFlags(set, &extras->annotations);
  set->AddSwitch("--record", &extras->has_record,
                 "write into the PNG how it was made: `isoscope render --like` makes it again");
}

absl::Status CheckExtras(const PictureExtras& extras, const v1::RenderIsosurfaceRequest& request,
                         const std::string& picture_revision) {
  if (!extras.any()) {
    return absl::OkStatus();
  }
  if (!IsPng(request)) {
    return absl::InvalidArgumentError(
        "axes, scale-bar, legend and caption are of a PNG or a WebP, record is of a PNG: leave "
        "them "
        "or the format out");
  }
  if (extras.has_record && extras.is_webp) {
    return absl::InvalidArgumentError("record is written into a PNG: leave it or format=webp out");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckSize(extras, SizeOf(request)));
  if (extras.annotations.has_legend && !ShowsQuantity(request)) {
    return absl::InvalidArgumentError(
        "legend shows what the colours of color-by and of caps=MAP mean: give one of them");
  }
  if (extras.has_record && request.culling() == v1::CULLING_MASK) {
    return absl::InvalidArgumentError(
        "record can't be used with culling=mask: it is approximate, and can't be made again");
  }
  if (extras.has_record && picture_revision.empty()) {
    return absl::FailedPreconditionError(
        "the agents are of several versions, or tell none, so that no record can say what drew the "
        "picture: leave record out");
  }
  return absl::OkStatus();
}

std::string KeyOf(const PictureExtras& extras) {
  if (!extras.any()) {
    return "";
  }
  const client::Annotations& drawn = extras.annotations;
  // Another version may draw otherwise. The caption is last, because it may hold any text.
  return absl::StrCat("extras of ", base::Version(), drawn.has_axes ? " axes" : "",
                      drawn.has_scale_bar ? " scale-bar" : "", drawn.has_legend ? " legend" : "",
                      extras.has_record ? " record" : "", extras.is_webp ? " webp" : "",
                      drawn.caption ? " caption " : "", drawn.caption.value_or(""));
}

absl::Status AddExtras(const PictureExtras& extras, const v1::RenderIsosurfaceRequest& request,
                       const v1::Dataset& dataset, const std::string& picture_revision,
                       v1::RenderIsosurfaceResponse* response) {
  std::optional<client::AnnotatedPicture> annotated;
  if (extras.annotations.any()) {
    std::string png = std::move(*response->mutable_png());
    absl::StatusOr<client::AnnotatedPicture> drawn =
        client::AnnotatePng(extras.annotations, request, *response, dataset, &png);
    if (absl::IsInvalidArgument(drawn.status())) {
      return absl::InvalidArgumentError(WithoutDashes(drawn.status().message()));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(annotated, std::move(drawn));
    response->set_png(std::move(png));
  }
  if (extras.has_record) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::string png,
                              client::RecordPng(response->png(), request, *response, dataset,
                                                picture_revision, std::move(annotated)));
    response->set_png(std::move(png));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::gateway
