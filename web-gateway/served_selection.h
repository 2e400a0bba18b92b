// The field and the time step of a picture, before it is drawn: for its ETag. A running simulation
// appends steps to a dataset and does not change its id, so "the last step" is another picture
// later.

#ifndef ISOSCOPE_WEB_GATEWAY_SERVED_SELECTION_H_
#define ISOSCOPE_WEB_GATEWAY_SERVED_SELECTION_H_

#include <optional>
#include <string>

#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::gateway {

// Replaces what a selection leaves open by what `dataset` serves: the first field, the only
// component or the magnitude, the number of the last step or of the one nearest to a time (of two
// the earlier). Nothing if the dataset has no such field, component or step: the coordinator says
// so. REQUIRES: the dataset has fields. O(steps).
std::optional<isoscope::v1::FieldSelection> ResolveSelection(
    const isoscope::v1::FieldSelection& selection, const isoscope::v1::Dataset& dataset);

// The digest of the volumes of a step; empty if the dataset has no such step.
std::string DigestOfStep(const isoscope::v1::FieldSelection& resolved,
                         const isoscope::v1::Dataset& dataset);

// Whether a later step gives the same request another step.
bool DependsOnLaterSteps(const isoscope::v1::FieldSelection& selection,
                         const isoscope::v1::Dataset& dataset);

// The ranges over all steps that the colours of a picture may depend on: empty if the dataset has
// no fields, or if the request names each range of its colour maps.
std::string RangesOfColors(const isoscope::v1::RenderIsosurfaceRequest& request,
                           const isoscope::v1::Dataset& dataset);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_SERVED_SELECTION_H_
