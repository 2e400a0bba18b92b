// The flags that choose field and time step of a dataset that has several.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_FIELD_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_FIELD_FLAGS_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/flag_set.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::client {

// "NAME" or "NAME:COMPONENT".
struct FieldName {
  std::string field;
  std::string component;  // empty: the only one, or the magnitude
};
absl::StatusOr<FieldName> ParseFieldName(absl::string_view text);

// A step by its number, or the first or last one that is served.
struct StepName {
  enum class Kind { kNumber, kFirst, kLast };
  Kind kind = Kind::kNumber;
  int number = 0;  // of kNumber
};

// One step, or all from `first` to `last` in strides.
struct StepRange {
  StepName first;
  std::optional<StepName> last = std::nullopt;  // not set: `first` alone
  int stride = 1;                               // not 0; negative: backwards
};

// "N", "first", "last", "A:B" or "A:B:STRIDE".
absl::StatusOr<StepRange> ParseSteps(absl::string_view text);

struct FieldFlags {
  std::optional<FieldName> field = std::nullopt;
  std::optional<double> time = std::nullopt;
  std::optional<StepRange> steps = std::nullopt;
};

// Registers --field, --time and --step. `flags` must outlive the parsing.
//
// has_sweep: whether --step may name several
void AddFieldFlags(cli::FlagSet* set, FieldFlags* flags, bool has_sweep = false);

// UsageError if both --time and --step are given.
absl::Status CheckUsage(const FieldFlags& flags);

// The numbers of the steps that `range` names, of those that the dataset serves: not all numbers
// between are. INVALID_ARGUMENT if the dataset has no steps, or if none of those served is meant
// (says which are).
absl::StatusOr<std::vector<int>> StepsOf(const StepRange& range,
                                         const isoscope::v1::Dataset& dataset);

// Returns what the flags choose; not set: the default. INVALID_ARGUMENT as StepsOf.
//
// step: in place of --step, of a frame of a sweep
absl::StatusOr<std::optional<isoscope::v1::FieldSelection>> SelectionOf(
    const FieldFlags& flags, const isoscope::v1::Dataset& dataset,
    std::optional<int> step = std::nullopt);

// Returns the dataset with the type, range and bound of the component that `field` names (not set:
// the default), as far as the dataset has it.
isoscope::v1::Dataset DatasetOfField(isoscope::v1::Dataset dataset,
                                     const std::optional<FieldName>& field);

// "velocity x" and "m/s", for people; empty if the dataset has no fields, or does not say.
std::string TitleOfField(const isoscope::v1::Dataset& dataset, const FieldName& field);
std::string UnitOfField(const isoscope::v1::Dataset& dataset, const FieldName& field);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_FIELD_FLAGS_H_
