// The choice of a field, a component and a step among those of a dataset's description. The
// coordinator chooses what it draws, and the gateway what a picture's ETag is of, by one rule.
//
// Thread-safe: pure functions.

#ifndef ISOSCOPE_WIRE_FIELD_SELECTION_H_
#define ISOSCOPE_WIRE_FIELD_SELECTION_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::wire {

// Indices of a field, and of a component in it.
struct FieldPlace {
  int field = 0;
  int component = 0;
};

// "" is the first field; of its components, the only one or the magnitude. A number names a
// component, too. Without a component, `field` may have it behind a colon, unless the whole of it
// is a field (volume::FindFieldName). INVALID_ARGUMENT: there is none of this name; says which
// there are. `path`, such as "selection.", is put before the names of the members. REQUIRES: the
// dataset has fields.
absl::StatusOr<FieldPlace> FindField(const isoscope::v1::Dataset& dataset, const std::string& field,
                                     const std::string& component, absl::string_view path);

// Returns the numbers of the steps that are served of a field, ascending.
std::vector<int> StepsOf(const isoscope::v1::Dataset& dataset, int field);

// Chooses one of `steps`, which ascend: the last one, or that of a number, or the nearest to a
// time (of two the earlier). NOT_FOUND: a step that is not among them; says which are.
// INVALID_ARGUMENT: a time that is not finite, or for a dataset without times.
// FAILED_PRECONDITION: `steps` is empty.
absl::StatusOr<int> ChooseStep(const isoscope::v1::Dataset& dataset,
                               const isoscope::v1::FieldSelection& selection,
                               const std::vector<int>& steps);

// For messages. Steps, which ascend: "0 to 4", "0, 2", "none".
std::string DescribeSteps(const std::vector<int>& steps);

// The time of a step; not set if the dataset has no times.
std::optional<double> TimeOf(const isoscope::v1::Dataset& dataset, int step);

// Replaces what a selection leaves open by what `dataset` serves: field, component and the number
// of the step. The number stays open for a dataset without times. Errors are those of FindField and
// ChooseStep. REQUIRES: the dataset has fields. O(steps).
absl::StatusOr<isoscope::v1::FieldSelection> ResolveSelection(
    const isoscope::v1::FieldSelection& selection, const isoscope::v1::Dataset& dataset);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_FIELD_SELECTION_H_
