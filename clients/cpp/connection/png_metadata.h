// The record of a picture: how it was made, as text in its PNG (docs/format/picture.md). With it
// `isoscope render --like` makes the picture again.

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

// What was drawn over a picture after it had come.
struct AnnotatedPicture {
  std::string plain_png_sha256;        // of the PNG before, without a record: 64 hex digits
  std::vector<view::PixelRect> boxes;  // outside them the pixels are those of before

  friend bool operator==(const AnnotatedPicture&, const AnnotatedPicture&) = default;
};

// All that decides the pixels.
struct PictureRecord {
  std::string picture_revision;                   // code, back end and driver that drew it
  std::string samples_digest;                     // of samples and grid
  isoscope::v1::RenderIsosurfaceRequest request;  // DecidingPart of it
  std::optional<AnnotatedPicture> annotated = std::nullopt;
};

// `request` without the members that do not decide a pixel: the dataset's name, culling, ray seed.
isoscope::v1::RenderIsosurfaceRequest DecidingPart(
    const isoscope::v1::RenderIsosurfaceRequest& request);

// The JSON of a record: the same record gives the same text.
std::string EncodePictureRecord(const PictureRecord& record);
// DATA_LOSS if the text is no record; FAILED_PRECONDITION, with its name, if a member of it or of
// the request is unknown: a newer version made the picture. Safe for any bytes.
absl::StatusOr<PictureRecord> DecodePictureRecord(absl::string_view text);

// The PNG with the record before its first IDAT. DATA_LOSS if `png` is none.
absl::StatusOr<std::string> AddPictureRecord(absl::string_view png, const PictureRecord& record);

struct RecordedPng {
  PictureRecord record;
  std::string plain_png;  // without the record: the bytes that RenderIsosurface gave
};
// NOT_FOUND if the PNG carries no record; DATA_LOSS if it is none; else as DecodePictureRecord.
absl::StatusOr<RecordedPng> SplitRecordedPng(absl::string_view png);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_PNG_METADATA_H_
