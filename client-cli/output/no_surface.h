// Isovalues without a surface: the picture is empty, and the user is told the reason.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_NO_SURFACE_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_NO_SURFACE_H_

#include <string>
#include <vector>

#include "clients/cpp/request/label_flags.h"
#include "core/cli/command.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::cli {

// Returns one line, without its end, if no cell of the dataset can be active at `isovalue`; else
// "". It names the isovalue and the range of the dataset's values.
std::string DescribeNoSurface(const isoscope::v1::Dataset& dataset, double isovalue);

// Writes such a line to standard error for each isovalue that has one. The request is made anyway.
void WarnIfNoSurface(const isoscope::v1::Dataset& dataset, const std::vector<double>& isovalues,
                     const Context& context);

// The same for surfaces none of whose labels can be a sample. `flags` are resolved.
void WarnIfNoLabel(const isoscope::v1::Dataset& dataset, const client::LabelFlags& flags,
                   const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_NO_SURFACE_H_
