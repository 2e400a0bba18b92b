// The fields, components and steps of a series: one of them, and what there is to choose from.

#ifndef ISOSCOPE_CORE_SOURCE_SERIES_PARTS_H_
#define ISOSCOPE_CORE_SOURCE_SERIES_PARTS_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/volume_series.h"

namespace isoscope::source {

// The part of a series of `file` as a series of one field: a field ("velocity"), or a component of
// one by name or number ("velocity:y", "velocity:1"). NOT_FOUND: no such field or component (lists
// those there are).
absl::StatusOr<std::unique_ptr<VolumeSeries>> SelectPart(std::unique_ptr<VolumeSeries> series,
                                                         const std::string& file,
                                                         const std::string& part);
// Describes the fields to choose from, as `isoscope info` and errors do:
// "p [Pa], velocity (x, y, z)", at most 50 of them.
std::string DescribeFields(const std::vector<SourceField>& fields);
// "3, from 0 to 2 s"; "1, without a time".
std::string DescribeSteps(const std::vector<double>& times, const std::string& unit);
// True if the series has one field of one component, and one step.
bool IsOneVolume(const SeriesInfo& series);
// Names of components: "" for one; x, y, z for three; else 0, 1, ...
std::vector<std::string> ComponentNames(std::int64_t count);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SERIES_PARTS_H_
