#include "core/volume/inside_rule.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"

namespace isoscope::volume {
namespace {

constexpr std::size_t kListedLabels = 8;

}  // namespace

InsideRule InsideRule::OfIsovalue(double isovalue) {
  ISOSCOPE_CHECK(std::isfinite(isovalue));
  return {.isovalue = isovalue};
}

InsideRule InsideRule::OfLabels(std::vector<double> labels, bool smooths) {
  ISOSCOPE_CHECK(!labels.empty());
  for (double& label : labels) {
    ISOSCOPE_CHECK(std::isfinite(label));
    label += 0.0;  // makes 0 of -0
  }
  std::sort(labels.begin(), labels.end());
  labels.erase(std::unique(labels.begin(), labels.end()), labels.end());
  ISOSCOPE_CHECK_LE(labels.size(), kMaxLabels);
  return {.isovalue = 0, .labels = std::move(labels), .smooths = smooths};
}

bool InsideRule::IsInside(double sample) const {
  return has_labels()
             ? std::binary_search(labels.begin(), labels.end(), sample) && !std::isnan(sample)
             : sample >= isovalue;
}

bool InsideRule::IsActive(const ScalarSpan& span) const {
  if (!has_labels()) {
    return volume::IsActive(span, isovalue);
  }
  if (!(span.min < span.max)) {
    return false;
  }
  const auto first = std::lower_bound(labels.begin(), labels.end(), span.min);
  return first != labels.end() && *first <= span.max;
}

bool InsideRule::MayHaveInside(const ScalarSpan& span) const {
  if (!(span.min <= span.max)) {
    return false;
  }
  if (!has_labels()) {
    return isovalue <= span.max;
  }
  const auto first = std::lower_bound(labels.begin(), labels.end(), span.min);
  return first != labels.end() && *first <= span.max;
}

std::string InsideRule::Text() const {
  if (!has_labels()) {
    return absl::StrCat("isovalue ", isovalue);
  }
  std::string text =
      absl::StrCat(smooths ? "smooth " : "", labels.size() == 1 ? "label" : "labels");
  for (std::size_t i = 0; i < labels.size() && i < kListedLabels; ++i) {
    absl::StrAppend(&text, i == 0 ? " " : ", ", labels[i]);
  }
  if (labels.size() > kListedLabels) {
    absl::StrAppend(&text, " and ", labels.size() - kListedLabels, " more");
  }
  return text;
}

}  // namespace isoscope::volume
