// The grid of a MetaImage header.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_META_IMAGE_GRID_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_META_IMAGE_GRID_H_

#include <string>

#include "absl/status/statusor.h"

#include "core/source/bytes/text_header.h"
#include "core/source/grid/grid_rules.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// The grid of the first three axes, without distances 1 apart. INVALID_ARGUMENT: fewer axes; not as
// many numbers as there are axes; what the rules do not take (GridFaults); two fields of one
// meaning that differ; volume::Validate.
absl::StatusOr<volume::GridGeometry> ReadMetaImageGrid(const std::string& path,
                                                       const GridRules& rules);

// The fields of the header, by their names in lower case. Errors as LocateMetaImageSamples.
absl::StatusOr<HeaderFields> ReadMetaImageFields(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_META_IMAGE_GRID_H_
