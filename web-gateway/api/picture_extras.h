// What the gateway adds to a PNG when a request asks for it: annotations, and the record that makes
// the picture again. The server's pictures have neither.

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

// The most pixels of a picture that annotations are drawn on: some 8K. It is decoded for them.
inline constexpr std::int64_t kMaxAnnotatedPixels = std::int64_t{1} << 25;

struct PictureExtras {
  client::Annotations annotations = {};
  bool has_record = false;

  [[nodiscard]] bool any() const { return annotations.any() || has_record; }
};

// Declares axes, scale-bar, legend, caption and record. `extras` must outlive the parsing.
void AddExtrasFlags(cli::FlagSet* set, PictureExtras* extras);

// INVALID_ARGUMENT if the answer to `request` can't have them: it is no PNG, has too many pixels,
// shows no quantity for a legend, or no record could make it again. FAILED_PRECONDITION for a
// record of agents that tell no picture revision.
absl::Status CheckExtras(const PictureExtras& extras,
                         const isoscope::v1::RenderIsosurfaceRequest& request,
                         const std::string& picture_revision);

// Returns text that differs if the added bytes may differ, for an ETag; empty without extras.
std::string KeyOf(const PictureExtras& extras);

// Adds them to the PNG of `response`. REQUIRES: CheckExtras is OK. Errors as client::AnnotatePng.
// Thread-safe; takes the time of encoding the picture, and memory for it three times.
absl::Status AddExtras(const PictureExtras& extras,
                       const isoscope::v1::RenderIsosurfaceRequest& request,
                       const isoscope::v1::Dataset& dataset, const std::string& picture_revision,
                       isoscope::v1::RenderIsosurfaceResponse* response);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_PICTURE_EXTRAS_H_
