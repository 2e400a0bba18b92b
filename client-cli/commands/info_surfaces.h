// The surfaces that `info` measures.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_INFO_SURFACES_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_INFO_SURFACES_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "client-cli/output/surface_measures.h"
#include "client-cli/session/session.h"
#include "clients/cpp/request/clip_flags.h"
#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/cli/command.h"
#include "core/cli/flag_set.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::cli {

// Pixels a side of the frames that tell what levels cost.
inline constexpr int kLevelCostSidePx = 1024;

struct InfoSurfaceFlags {
  std::vector<double> isovalues;
  client::LabelFlags label;
  client::ClipFlags clip;
  bool closes = false;

  // True if there is no surface to measure.
  [[nodiscard]] bool empty() const { return isovalues.empty() && label.empty(); }
};

// `flags` must outlive the parsing.
void AddInfoSurfaceFlags(FlagSet* set, InfoSurfaceFlags* flags);

// UsageError if there is a clip region, or --close, without a surface; or more planes than a clip
// region can have.
absl::Status CheckUsage(const InfoSurfaceFlags& flags);

// Measures the surfaces of the selected field. If the dataset has levels, draws each isosurface from
// each of them, too, kLevelCostSidePx a side with the default camera. Errors as
// client::ResolveLabels, client::MeasureSurfaces and ServiceClient::RenderIsosurface.
absl::StatusOr<std::vector<MeasuredSurface>> MeasureInfoSurfaces(
    const InfoSurfaceFlags& flags, const client::SelectionFlags& selection,
    const isoscope::v1::Dataset& dataset, Session* session, const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_INFO_SURFACES_H_
