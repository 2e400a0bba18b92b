// The different values of samples that may be labels.

#ifndef ISOSCOPE_CORE_VOLUME_LABEL_VALUES_H_
#define ISOSCOPE_CORE_VOLUME_LABEL_VALUES_H_

#include <cstddef>
#include <optional>
#include <vector>

namespace isoscope::volume {

// The most values that are listed: as many labels as a dataset has names of.
inline constexpr std::size_t kMaxListedValues = 65536;

// True for whole numbers from -2^53 to 2^53: those that a double tells from all others.
bool MayBeLabel(double value);

// The values of some samples. NaN and infinities are left out. Thread-compatible.
class LabelValues {
 public:
  LabelValues() = default;
  // max_count: 1 to kMaxListedValues
  explicit LabelValues(std::size_t max_count) : max_count_(max_count) {}

  void Add(double value);
  void Add(const LabelValues& other);

  // True if no more samples have to be seen: they are no labels, or too many.
  [[nodiscard]] bool is_done() const { return has_more_ || other_value_.has_value(); }

  // Ascending, distinct; none is -0.
  [[nodiscard]] const std::vector<double>& values() const { return values_; }
  // True if there are more than max_count.
  [[nodiscard]] bool has_more() const { return has_more_; }
  // A value that MayBeLabel is false for; not set if there is none.
  [[nodiscard]] const std::optional<double>& other_value() const { return other_value_; }

  // For messages. `values` are ascending and distinct, at most kMaxListedValues.
  static LabelValues Of(std::vector<double> values, bool has_more,
                        std::optional<double> other_value);

 private:
  std::size_t max_count_ = kMaxListedValues;
  std::vector<double> values_;
  bool has_more_ = false;
  std::optional<double> other_value_;
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_LABEL_VALUES_H_
