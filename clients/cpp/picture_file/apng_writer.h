// Animated PNGs (PNG specification, third edition, sections 4.9 and 11.3.6).

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_APNG_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_APNG_WRITER_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "clients/cpp/picture_file/animation_writer.h"

namespace isoscope::client {

// Frames go to disk as they arrive: memory holds one at a time. Each keeps the deflated pixels of
// its PNG, so an animation is as large as its pictures together.
absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateApng(const std::string& path,
                                                            const AnimationOptions& options);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_APNG_WRITER_H_
