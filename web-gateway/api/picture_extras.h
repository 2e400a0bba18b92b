// What the gateway makes of a PNG when a request asks for it: annotations over it, the record that
// makes the picture again, or a WebP. The server's pictures have none of these.

#ifndef ISOSCOPE_WEB_GATEWAY_API_PICTURE_EXTRAS_H_
#define ISOSCOPE_WEB_GATEWAY_API_PICTURE_EXTRAS_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"

#include "clients/cpp/picture_file/annotations.h"
#include "core/cli/flag_set.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::gateway {

// The most pixels of a picture that is decoded, for annotations or as a WebP: some 8K.
inline constexpr std::int64_t kMaxDecodedPixels = std::int64_t{1} << 25;

struct PictureExtras {
  client::Annotations annotations = {};
  bool has_record = false;
  bool is_webp = false;  // the answer is the PNG as a WebP (ConvertToWebp)

  [[nodiscard]] bool any() const { return annotations.any() || has_record || is_webp; }
  [[nodiscard]] bool needs_pixels() const { return annotations.any() || is_webp; }
};

// Declares axes, scale-bar, legend, caption and record. `extras` must outlive the parsing.
void AddExtrasFlags(cli::FlagSet* set, PictureExtras* extras);

// INVALID_ARGUMENT if the answer to `request` can't have them: it is no PNG, has too many pixels,
// shows no quantity for a legend, or no record could make it again. A WebP has no record. FAILED_PRECONDITION for a
// record of agents that tell no picture revision.
absl::Status CheckExtras(const PictureExtras& extras,
                         const isoscope::v1::RenderIsosurfaceRequest& request,
                         const std::string& picture_revision);

// Returns text that differs if the added bytes may differ, for an ETag; empty without extras.
std::string KeyOf(const PictureExtras& extras);

// Adds annotations and the record to the PNG of `response`. REQUIRES: CheckExtras is OK. Errors as client::AnnotatePng.
// Thread-safe; takes the time of encoding the picture, and memory for it three times.
absl::Status AddExtras(const PictureExtras& extras,
                       const isoscope::v1::RenderIsosurfaceRequest& request,
                       const isoscope::v1::Dataset& dataset, const std::string& picture_revision,
                       isoscope::v1::RenderIsosurfaceResponse* response);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_PICTURE_EXTRAS_H_
