// A volume that lies in memory, for tests.

#ifndef ISOSCOPE_TESTS_SUPPORT_MEMORY_SOURCE_H_
#define ISOSCOPE_TESTS_SUPPORT_MEMORY_SOURCE_H_

#include <memory>
#include <string>

#include "core/source/volume_source.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::testing {

// Samples [z][y][x], x fastest, of `type`.
std::unique_ptr<source::VolumeSource> MakeMemorySource(const volume::GridGeometry& geometry,
                                                       volume::ScalarType type, std::string samples,
                                                       std::string name);
// The same, with all that the source says of itself.
std::unique_ptr<source::VolumeSource> MakeMemorySource(source::SourceInfo info,
                                                       std::string samples);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_MEMORY_SOURCE_H_
