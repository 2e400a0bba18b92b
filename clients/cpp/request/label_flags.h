// The flags for surfaces of labels: where samples are one of a set of values.
//
// 1. Parsing keeps the text of a set, because only the dataset knows names (ParseLabel).
// 2. Once the dataset is known, ResolveLabels turns sets into values, with a colour and a name.
// 3. MakeRequest takes the resolved surfaces (render_request.h).

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_LABEL_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_LABEL_FLAGS_H_

#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/flag_set.h"
#include "core/frame/color.h"
#include "core/frame/frame_spec.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::v1 {
class GetHistogramResponse;
}  // namespace isoscope::v1

namespace isoscope::client {

// "SET[:COLOR[:OPACITY]]"; COLOR may be empty. SET is a name, or values, ranges and names with
// commas between: "3", "3,7", "3-7", "left lung", "left lung,right lung".
struct LabelValue {
  std::string set = {};
  std::optional<frame::Color> color = std::nullopt;  // without its alpha
  std::optional<float> opacity = std::nullopt;       // in (0, 1]

  friend bool operator==(const LabelValue&, const LabelValue&) = default;
};
absl::StatusOr<LabelValue> ParseLabel(absl::string_view text);

// A surface of labels.
struct LabelSurface {
  std::vector<double> values = {};  // ascending, distinct, finite, at least one
  frame::Color color = {};
  bool is_color_given = false;  // by the flag
  bool is_smooth = false;
  std::string name = {};  // for people: "left lung", or "label 3"

  friend bool operator==(const LabelSurface&, const LabelSurface&) = default;
};

struct LabelFlags {
  std::vector<LabelValue> sets = {};
  bool wants_all = false;                   // --labels all: each but 0
  bool smooths = false;                     // --smooth-labels: all of them
  std::vector<LabelSurface> surfaces = {};  // resolved

  // True if no flag names a label.
  [[nodiscard]] bool empty() const { return sets.empty() && !wants_all; }
  // The number of surfaces; unknown, and 0, of --labels all that is not resolved.
  [[nodiscard]] std::size_t surface_count() const {
    return !surfaces.empty() ? surfaces.size() : wants_all ? 0 : sets.size();
  }
};

// `flags` must outlive the parsing. Without `has_opacity` the help leaves the opacity out.
void AddLabelFlags(cli::FlagSet* set, LabelFlags* flags, bool has_opacity = true);

// For files and measures: a frame has a limit of surfaces, an export has none.
inline constexpr std::size_t kAnyNumberOfSurfaces = std::numeric_limits<int>::max();

// UsageError if there are more surfaces than `max_surfaces`, both flags for labels, or --smooth-labels
// without labels.
absl::Status CheckUsage(const LabelFlags& flags, std::size_t max_surfaces = frame::kMaxSurfaces);

// True if a histogram of 4096 bins tells the values of the samples: integers whose range is as
// small.
bool HasExactBins(const isoscope::v1::Dataset& dataset);

// Returns the values that samples have: those that the histogram lists, or those of its bins; not
// set if neither is exact.
std::optional<std::vector<double>> PresentValues(
    const isoscope::v1::Dataset& dataset, const isoscope::v1::GetHistogramResponse& histogram);

// Sets flags->surfaces. The colour is that of the flag, else that of the first value of the set in
// the dataset, else volume::DefaultLabelColor.
//
// present:      values of samples, for --labels all; not set: those that have names count
// max_surfaces: as CheckUsage has it
// why:          why `present` is not set, for the error; may be empty
//
// INVALID_ARGUMENT: a name that the dataset does not have (says the nearest one), or several times;
// a set of more than 256 values; --labels all of more labels than max_surfaces, or of none.
absl::Status ResolveLabels(const isoscope::v1::Dataset& dataset,
                           const std::optional<std::vector<double>>& present, LabelFlags* flags,
                           std::size_t max_surfaces = frame::kMaxSurfaces,
                           const std::string& why = "");

// Says why the values that a histogram lists are no labels: "a sample is 0.5, and labels are whole
// numbers"; empty if they are some, or if it lists none.
std::string WhyNoLabels(const isoscope::v1::GetHistogramResponse& histogram);

// Returns a name for a set of values: their names or "label 3", with commas between.
std::string NameOfLabels(const std::vector<double>& values, const isoscope::v1::Dataset& dataset);

void AddTo(const LabelSurface& surface, isoscope::v1::Surface* proto);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_LABEL_FLAGS_H_
