// The flags that say which fields and time steps of a source are meant.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_SERIES_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_SERIES_FLAGS_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "client-cli/session/source_flags.h"
#include "core/cli/flag_set.h"
#include "core/partition/series_selection.h"
#include "core/source/volume_series.h"

namespace isoscope::cli {

struct SeriesFlags {
  std::optional<std::string> axes;
  std::vector<std::string> fields;
  std::optional<partition::StepRange> steps;
  std::optional<double> time;
};

// "N", "A:B" or "A:B:S": steps A, A + S, ..., up to and with B. INVALID_ARGUMENT quotes the text
// and says what is allowed.
absl::StatusOr<partition::StepRange> ParseStepRange(absl::string_view text);

// `flags` must outlive the parsing.
void AddSeriesFlags(FlagSet* set, SeriesFlags* flags);

// Opens all fields and steps of a source that the flags choose; of a raw file, its only one. Errors
// as OpenSource, source::OpenVolumeSeries and partition::SelectFrom.
absl::StatusOr<std::unique_ptr<source::VolumeSeries>> OpenSourceSeries(const SourceFlags& source,
                                                                       const SeriesFlags& series,
                                                                       const std::string& path);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_SERIES_FLAGS_H_
