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

// Measures the surfaces of the selected field. Errors as client::ResolveLabels and
// client::MeasureSurfaces.
absl::StatusOr<std::vector<MeasuredSurface>> MeasureInfoSurfaces(
    const InfoSurfaceFlags& flags, const client::SelectionFlags& selection,
    const isoscope::v1::Dataset& dataset, Session* session, const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_INFO_SURFACES_H_
