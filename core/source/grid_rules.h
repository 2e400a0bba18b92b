// Leave to take a grid that readers refuse: the flags --ignore-shear, --resample and --spacing.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_RULES_H_
#define ISOSCOPE_CORE_SOURCE_GRID_RULES_H_

#include <optional>

namespace isoscope::source {

// By default a reader refuses all three kinds of grid.
struct GridRules {
  // A sheared transform is read as it is; AdjustSource makes it straight.
  bool ignores_shear = false;
  // Samples at uneven distances are resampled (resampled_source.h) after those of the value `fill`
  // have become NaN, so that no value is mixed with it.
  bool resamples = false;
  std::optional<double> fill{};
  // The distances of samples are given: a reader takes 1 where those of the file are missing or
  // make no sense.
  bool has_spacing = false;

  [[nodiscard]] bool is_default() const { return !ignores_shear && !resamples && !has_spacing; }
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_RULES_H_
