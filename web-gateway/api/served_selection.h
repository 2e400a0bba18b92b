// How a picture depends on steps that are appended later, for its ETag. A running simulation
// appends steps to a dataset and does not change its id, so "the last step" is another picture
// later.

#ifndef ISOSCOPE_WEB_GATEWAY_API_SERVED_SELECTION_H_
#define ISOSCOPE_WEB_GATEWAY_API_SERVED_SELECTION_H_

#include <string>

#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::gateway {

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

#endif  // ISOSCOPE_WEB_GATEWAY_API_SERVED_SELECTION_H_
