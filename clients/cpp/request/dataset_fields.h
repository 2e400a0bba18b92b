// Looks into the fields of a dataset.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_DATASET_FIELDS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_DATASET_FIELDS_H_

#include <string>

#include "absl/status/status.h"

#include "clients/cpp/request/look_flags.h"
#include "clients/cpp/request/selection_flags.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::client {

// Splits names of fields, as --field and --color-by have them, into field and component by those
// that the dataset has: a whole name first, then the longest one (volume::FindFieldName). Names
// that it does not have stay for the server to refuse, unless one is near: INVALID_ARGUMENT names
// that. `look` may be null. UsageError: a component that is named twice.
absl::Status ResolveNames(const isoscope::v1::Dataset& dataset, SelectionFlags* selection,
                          LookFlags* look = nullptr);

// Returns the dataset with the type, range and bound of the component that the flags choose, as far
// as it has that. Without --field and --component they are those of the dataset.
isoscope::v1::Dataset DatasetOfField(isoscope::v1::Dataset dataset, const SelectionFlags& flags);

// "velocity x" and "m/s", for people; empty if the dataset has no such field, or does not say.
std::string TitleOfField(const isoscope::v1::Dataset& dataset, const FieldValue& field);
std::string UnitOfField(const isoscope::v1::Dataset& dataset, const FieldValue& field);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_DATASET_FIELDS_H_
