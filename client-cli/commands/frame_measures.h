// Measures the surfaces of frames, for `render --stats`.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_FRAME_MEASURES_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_FRAME_MEASURES_H_

#include <string>
#include <vector>

#include "absl/status/status.h"

#include "client-cli/output/frame_statistics.h"
#include "client-cli/session/session.h"
#include "core/cli/command.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// Returns the request for the whole surfaces of a frame, cut at its clip region.
isoscope::v1::ExportIsosurfaceRequest MeshOfFrame(
    const isoscope::v1::RenderIsosurfaceRequest& frame);

// Adds the measures of their surfaces to the frames, which must have their requests. Frames of the
// same surfaces cost one measurement. Where measuring fails, it says so on standard error, and
// measures no more: a frame is no worse without them. CANCELLED: the user interrupted it.
//
// names: of labels, as MeasuredSurfaces has them
absl::Status AddMeasures(const isoscope::v1::Dataset& dataset,
                         const std::vector<std::string>& names, Session* session,
                         std::vector<FrameRecord>* frames, const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_FRAME_MEASURES_H_
