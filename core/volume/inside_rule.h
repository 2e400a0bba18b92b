// Which samples are inside of a surface: those from an isovalue on, or those that are one of its
// labels. This is the one definition of "inside" and "active" (docs/numerics.md, "Labels").

#ifndef ISOSCOPE_CORE_VOLUME_INSIDE_RULE_H_
#define ISOSCOPE_CORE_VOLUME_INSIDE_RULE_H_

#include <compare>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "core/volume/scalar_span.h"

namespace isoscope::volume {

// The most labels that one surface has.
inline constexpr std::size_t kMaxLabels = 256;

// A value type. Thread-compatible.
struct InsideRule {
  // Field units, finite; 0 if there are labels.
  double isovalue = 0;
  // Ascending, distinct, finite, none is -0. Empty: samples are inside from the isovalue on.
  std::vector<double> labels = {};
  // Whether vertices move along their grid edges, so that steps between labels become slopes. Only
  // of labels. Which samples are inside, and which edges are crossed, stays the same.
  bool smooths = false;

  // Returns the rule of an isovalue. REQUIRES: it is finite.
  static InsideRule OfIsovalue(double isovalue);
  // Returns the rule of labels in any order. Those that are equal count once.
  // REQUIRES: 1 to kMaxLabels of them, all finite.
  static InsideRule OfLabels(std::vector<double> labels, bool smooths = false);

  [[nodiscard]] bool has_labels() const { return !labels.empty(); }
  // Returns true if a sample is inside. NaN is not.
  [[nodiscard]] bool IsInside(double sample) const;
  // Returns true if a block, cell or edge with these samples may have a part of the surface. For an
  // isovalue that is volume::IsActive. For labels: min < max, and a label is in [min, max].
  [[nodiscard]] bool IsActive(const ScalarSpan& span) const;
  [[nodiscard]] bool IsActive(double min, double max) const { return IsActive({min, max}); }
  // Returns true if a sample in the span may be inside. False for an empty span.
  [[nodiscard]] bool MayHaveInside(const ScalarSpan& span) const;
  // Returns "isovalue 3.5", "labels 3, 7" or "smooth labels 3, 7", for logs and errors: not a key.
  // The first 8 labels are listed, of others the number is told.
  [[nodiscard]] std::string Text() const;

  // Equal rules give the same surface of any volume. The order is that of isovalues, then of
  // labels; it is total, as no number is NaN.
  friend bool operator==(const InsideRule&, const InsideRule&) = default;
  friend auto operator<=>(const InsideRule&, const InsideRule&) = default;
  // For absl::Hash.
  template <typename H>
  friend H AbslHashValue(H hash, const InsideRule& rule) {
    return H::combine(std::move(hash), rule.isovalue, rule.labels, rule.smooths);
  }
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_INSIDE_RULE_H_
