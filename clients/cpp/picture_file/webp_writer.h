// WebP, lossless: animations and single pictures.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_WEBP_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_WEBP_WRITER_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/picture_file/animation_writer.h"

namespace isoscope::client {

// The format's own limit.
inline constexpr int kMaxWebpSidePx = 16383;

// Only the differences between frames are stored. libwebp holds a few pictures, and all encoded
// frames, until Finish: memory grows with the size of the file.
absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateWebp(const std::string& path,
                                                            const AnimationOptions& options);

// Returns the picture of a PNG as a WebP of one lossless image (VP8L), with the colours of transparent
// pixels. DATA_LOSS if `png` is no PNG, INVALID_ARGUMENT if it has too many pixels a side. Holds the
// decoded picture twice. Thread-safe.
absl::StatusOr<std::string> WebpOfPng(absl::string_view png);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_WEBP_WRITER_H_
