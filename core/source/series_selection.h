// Some fields and steps of a source, in place of all.

#ifndef ISOSCOPE_CORE_SOURCE_SERIES_SELECTION_H_
#define ISOSCOPE_CORE_SOURCE_SERIES_SELECTION_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/volume_series.h"

namespace isoscope::source {

// Steps first, first + stride, ..., up to and with last. REQUIRES: 0 <= first <= last, stride >= 1.
struct StepRange {
  int first = 0;
  int last = 0;
  int stride = 1;
};

struct SeriesSelection {
  std::vector<std::string> fields;  // names, in the order of the result; empty: all
  // The format knows no names of fields: `fields`, of one element, is the name of the only one.
  bool names_field = false;
  std::optional<StepRange> steps = std::nullopt;  // not set: all
  std::optional<double> time = std::nullopt;      // finite; of a source without times
};

// Tells how to open a field, or a component of one ("u:x"), that lies on another grid: "; it lies
// on another grid: open run.nc:u". "" if the source has no such field.
std::string OtherGridAdvice(const SeriesInfo& source, absl::string_view field);

// Says in a sentence without its end which fields lie on other grids, and how to open one: "b" lies on
// another grid: open run.zarr:b. Names five at most. "" if there are none.
std::string OtherGridsNote(const SeriesInfo& source);

// INVALID_ARGUMENT: no such field (lists those there are) or step, a field twice, or a time
// although the source has times.
absl::StatusOr<std::unique_ptr<VolumeSeries>> SelectFrom(std::unique_ptr<VolumeSeries> source,
                                                         const SeriesSelection& selection);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SERIES_SELECTION_H_
