// The record of a picture: all inputs of its pixels, as text in its PNG (docs/format/picture.md).
// With it `isoscope render --like` repeats the picture.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_PNG_METADATA_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_PNG_METADATA_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/view/view.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// The keyword of the iTXt chunk.
inline constexpr absl::string_view kPictureRecordKeyword = "isoscope";

// The annotations that were drawn over a received picture.
struct AnnotatedPicture {
  std::string plain_png_sha256;        // of the PNG without annotations and record: 64 hex digits
  std::vector<view::PixelRect> boxes;  // pixels outside them are unchanged

  friend bool operator==(const AnnotatedPicture&, const AnnotatedPicture&) = default;
};

// All inputs that affect the pixels.
struct PictureRecord {
  std::string picture_revision;                   // code, back end and driver of the agents
  std::string samples_digest;                     // of samples and grid
  isoscope::v1::RenderIsosurfaceRequest request;  // reduced by DecidingPart; names its level
  std::optional<AnnotatedPicture> annotated = std::nullopt;
  std::optional<isoscope::v1::DrawnLevel> drawn_level = std::nullopt;  // not set: level 0
};

// Returns `request` without the members that do not affect a pixel: the dataset's name, culling,
// ray seed.
isoscope::v1::RenderIsosurfaceRequest DecidingPart(
    const isoscope::v1::RenderIsosurfaceRequest& request);

// Returns the JSON of a record; equal records give equal text.
std::string EncodePictureRecord(const PictureRecord& record);
// DATA_LOSS if the text is no record. FAILED_PRECONDITION, with its name, if a member of it or of
// the request is unknown: a newer version made the picture. Safe for any bytes.
absl::StatusOr<PictureRecord> DecodePictureRecord(absl::string_view text);

// Returns the PNG with the record before its first IDAT. DATA_LOSS if `png` is no PNG.
absl::StatusOr<std::string> AddPictureRecord(absl::string_view png, const PictureRecord& record);

struct RecordedPng {
  PictureRecord record;
  std::string plain_png;  // without the record: the bytes from RenderIsosurface
};
// NOT_FOUND if the PNG carries no record; DATA_LOSS if it is no PNG; else as DecodePictureRecord.
absl::StatusOr<RecordedPng> SplitRecordedPng(absl::string_view png);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_PNG_METADATA_H_
