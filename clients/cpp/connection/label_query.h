// Asks a coordinator for what the flags of labels need of it.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_LABEL_QUERY_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_LABEL_QUERY_H_

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/selection_flags.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::client {

class ServiceClient;

// Resolves the flags (ResolveLabels); of --labels all by the values of the samples of the selected
// field, if these are whole numbers. It reads all samples, unless they are integers of a small
// range. Does nothing without flags. FAILED_PRECONDITION: the coordinator does not know surfaces of
// labels, or smooth ones. Otherwise errors of ResolveLabels and of the calls.
absl::Status ResolveLabels(const isoscope::v1::Dataset& dataset, const SelectionFlags& selection,
                           absl::Duration timeout, ServiceClient* client, LabelFlags* flags,
                           std::size_t max_surfaces = frame::kMaxSurfaces);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_LABEL_QUERY_H_
