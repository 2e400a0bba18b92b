// The only volume of a path, for tests that have files of one.

#ifndef ISOSCOPE_TESTS_SUPPORT_ONLY_VOLUME_H_
#define ISOSCOPE_TESTS_SUPPORT_ONLY_VOLUME_H_

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/formats/open_volume.h"
#include "core/source/series_parts.h"

namespace isoscope::source {

// Opens it, as `isoscope` does. INVALID_ARGUMENT also: there are several.
inline absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVolumeFile(const std::string& path,
                                                                    const std::string& format = "",
                                                                    const GridRules& rules = {}) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> series,
                            OpenVolumeSeries(path, {.axes = "", .format = format, .rules = rules}));
  return IsOneVolume(series->info())
             ? series->Open(0, 0, 0)
             : absl::InvalidArgumentError(absl::StrCat(
                   path, ": several volumes: ", DescribeFields(series->info().fields),
                   "; steps: ", DescribeSteps(series->info().times, series->info().time_unit)));
}

}  // namespace isoscope::source

#endif  // ISOSCOPE_TESTS_SUPPORT_ONLY_VOLUME_H_
