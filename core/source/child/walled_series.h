// A series whose library runs in a child process (walled_source.h), from the texts in which the
// child describes it.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_WALLED_SERIES_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_WALLED_SERIES_H_

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/adapt/resampled_source.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/axis_distances.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// All that a child says of a file.
struct WalledFile {
  SeriesInfo info{};                    // but its name, which the parent knows
  std::vector<std::int64_t> numbers{};  // by field: by which the child knows it
  AxisDistances distances{};            // of the grid of all fields, if it is not even

  void Add(SourceField field, std::int64_t number) {
    info.fields.push_back(std::move(field));
    numbers.push_back(number);
  }
};

// For the child: returns texts "key=value", none of them empty.
std::vector<std::string> WalledTexts(const WalledFile& file);
// For the child: returns the number of the field, the step and the component of the part by which
// the series asks for a volume. REQUIRES: such a part.
std::array<std::int64_t, 3> ParseWalledPart(const std::string& part);
// For the child: what of the grid the user gives, as has_spacing, by the last word of such a part;
// and that word.
GridRules GivenRules(absl::string_view part);
std::string GivenWord(const GridRules& rules);

// Makes a volume of one that the library opened for `part` of `file`.
using WrapWalled = std::unique_ptr<VolumeSource> (*)(std::unique_ptr<VolumeSource> volume,
                                                     const std::string& file,
                                                     const std::string& part);

// For the parent: the series of `library.describe`, which takes `part`, opened by `library.open`.
// Nothing in the texts is taken for granted: DATA_LOSS if they make no sense. Null if there are
// none. If the rules resample, `library.open` takes grids that are not even, and the volumes are
// resampled here; others are what `wrap` makes of them, unless it is null. Errors also as
// DescribeWalled; those of opening a volume also as ResampleSource.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenWalledSeries(const WalledLibrary& library,
                                                               const std::string& file,
                                                               const std::string& part,
                                                               const GridRules& rules = {},
                                                               WrapWalled wrap = nullptr);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_WALLED_SERIES_H_
