#include "client-cli/output/no_surface.h"

#include <algorithm>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/printable.h"

namespace isoscope::cli {
namespace {

std::string ExactNumber(double value) { return absl::StrFormat("%.9g", value); }

}  // namespace

std::string DescribeNoSurface(const isoscope::v1::Dataset& dataset, double isovalue) {
  const std::string head = absl::StrCat("isovalue ", ExactNumber(isovalue), " has no surface: ");
  if (!dataset.has_value_range()) {
    return absl::StrCat(head, "no sample of the volume is finite");
  }
  const double min = dataset.value_range().min();
  const double max = dataset.value_range().max();
  // A sample equal to the isovalue is inside: at `min` all samples are.
  if (min < isovalue && isovalue <= max) {
    return "";
  }
  return absl::StrCat(head, "the values of the volume are in [", ExactNumber(min), ", ",
                      ExactNumber(max),
                      "], and it must be above the smallest and at most the largest");
}

void WarnIfNoSurface(const isoscope::v1::Dataset& dataset, const std::vector<double>& isovalues,
                     const Context& context) {
  for (const double isovalue : isovalues) {
    const std::string line = DescribeNoSurface(dataset, isovalue);
    if (!line.empty()) {
      *context.err << "isoscope: " << line << std::endl;
    }
  }
}

void WarnIfNoLabel(const isoscope::v1::Dataset& dataset, const client::LabelFlags& flags,
                   const Context& context) {
  const auto can_be_sample = [&](double value) {
    return dataset.has_value_range() && dataset.value_range().min() <= value &&
           value <= dataset.value_range().max();
  };
  for (const client::LabelSurface& surface : flags.surfaces) {
    if (std::none_of(surface.values.begin(), surface.values.end(), can_be_sample)) {
      *context.err << "isoscope: " << base::Printable(surface.name) << " has no surface: "
                   << (dataset.has_value_range()
                           ? absl::StrCat("the values of the volume are in [",
                                          ExactNumber(dataset.value_range().min()), ", ",
                                          ExactNumber(dataset.value_range().max()), "]")
                           : "no sample of the volume is finite")
                   << std::endl;
    }
  }
}

}  // namespace isoscope::cli
