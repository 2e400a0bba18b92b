// The commands of this room, for the program isoscope.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_VIEW_COMMAND_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_VIEW_COMMAND_H_

#include <optional>
#include <string>

#include "absl/strings/string_view.h"

#include "clients/cpp/request/label_flags.h"
#include "core/cli/command.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/dataset_service.pb.h"

namespace isoscope::cli {

Command ViewCommand();

// Returns the isovalue that a page begins with: the level between two classes of samples, else any
// suggestion, else the middle of the range of the samples, else 0.
double FirstIsovalue(const isoscope::v1::GetHistogramResponse& histogram,
                     const isoscope::v1::Dataset& dataset);

// Returns `page` with "dataset=NAME&isovalue=V" in its query, and "label=VALUES:COLOR:OPACITY" for
// each surface of labels; colour and opacity only as they are given, for the page knows the
// dataset. All labels are one "labels=VALUES". REQUIRES: `label` is resolved.
std::string ViewAddress(absl::string_view page, const std::string& dataset,
                        const std::optional<double>& isovalue, const client::LabelFlags& label);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_VIEW_COMMAND_H_
