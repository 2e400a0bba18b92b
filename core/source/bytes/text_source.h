// Samples written as text: numbers with white space between them.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_TEXT_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_TEXT_SOURCE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/adapt/wide_source.h"
#include "core/source/volume_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct TextLocation {
  std::string file{};
  std::int64_t offset = 0;  // before the first number
  // Numbers are read exactly as this type; integers of 64 bits (`wide`) become float64.
  volume::ScalarType type = volume::ScalarType::kFloat32;
  std::optional<WideType> wide{};
  std::int64_t components = 1;  // of a tuple
  std::int64_t component = 0;   // the one that is read
  bool ends_at_tag = false;     // '<' ends the numbers, as in XML
};

// Opens the samples at `location`, x fastest, as a volume; `name` is for messages. It is read
// forwards: asked for earlier rows it starts over. ReadRows: INVALID_ARGUMENT if the numbers
// end early, or a word is no number, or none of that type (names it and its offset). Holds 64 KiB.
absl::StatusOr<std::unique_ptr<VolumeSource>> MakeTextSource(const volume::GridGeometry& geometry,
                                                             const TextLocation& location,
                                                             const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_TEXT_SOURCE_H_
