// What a client adds to the PNG of an answer: annotations over its pixels, and its record.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_ANNOTATED_PICTURE_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_ANNOTATED_PICTURE_H_

#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/connection/png_metadata.h"
#include "clients/cpp/picture_file/annotations.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// Draws the annotations over `*png`, the picture of `response` to `request`. Returns what its
// record says of them. Needs the decoded picture twice in memory. Errors as Annotate;
// INVALID_ARGUMENT if the answer can't be read. Thread-safe.
absl::StatusOr<AnnotatedPicture> AnnotatePng(const Annotations& annotations,
                                             const isoscope::v1::RenderIsosurfaceRequest& request,
                                             const isoscope::v1::RenderIsosurfaceResponse& response,
                                             const isoscope::v1::Dataset& dataset,
                                             std::string* png);

// Returns the PNG with its record, which makes the picture again (png_metadata.h). The picture of
// the mask, and one without some shards, depend on the agents: no record reproduces them.
// `annotated`: of AnnotatePng; unset: the bytes are those of the answer. DATA_LOSS if `png` is no
// PNG. Thread-safe.
absl::StatusOr<std::string> RecordPng(absl::string_view png,
                                      const isoscope::v1::RenderIsosurfaceRequest& request,
                                      const isoscope::v1::RenderIsosurfaceResponse& response,
                                      const isoscope::v1::Dataset& dataset,
                                      const std::string& picture_revision,
                                      std::optional<AnnotatedPicture> annotated);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_ANNOTATED_PICTURE_H_
