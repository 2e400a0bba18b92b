#include "core/volume/label_values.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace isoscope::volume {

bool MayBeLabel(double value) {
  constexpr double kMaxWhole = 0x1.0p53;
  return std::abs(value) <= kMaxWhole && value == std::trunc(value);
}

void LabelValues::Add(double value) {
  if (!std::isfinite(value)) {
    return;
  }
  if (!MayBeLabel(value)) {
    other_value_ = std::min(other_value_.value_or(value), value);
    return;
  }
  value += 0.0;  // makes 0 of -0
  const auto at = std::lower_bound(values_.begin(), values_.end(), value);
  if (at != values_.end() && *at == value) {
    return;
  }
  if (values_.size() == max_count_) {
    has_more_ = true;
    return;
  }
  values_.insert(at, value);
}

void LabelValues::Add(const LabelValues& other) {
  for (const double value : other.values_) {
    Add(value);
  }
  has_more_ = has_more_ || other.has_more_;
  if (other.other_value_.has_value()) {
    Add(*other.other_value_);
  }
}

LabelValues LabelValues::Of(std::vector<double> values, bool has_more,
                            std::optional<double> other_value) {
  LabelValues list;
  list.values_ = std::move(values);
  list.has_more_ = has_more;
  list.other_value_ = other_value;
  return list;
}

}  // namespace isoscope::volume
