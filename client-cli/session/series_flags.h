// The flags that say which fields and time steps of a source are meant.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_SERIES_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_SERIES_FLAGS_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "client-cli/session/source_flags.h"
#include "core/cli/flag_set.h"
#include "core/formats/open_request.h"
#include "core/source/series_selection.h"

namespace isoscope::cli {

struct SeriesFlags {
  std::vector<std::string> fields;
  std::optional<source::StepRange> steps;
  std::optional<double> time;
};

// "N", "A:B" or "A:B:S": steps A, A + S, ..., up to and with B. INVALID_ARGUMENT quotes the text
// and says what is allowed.
absl::StatusOr<source::StepRange> ParseStepRange(absl::string_view text);

// `flags` must outlive the parsing.
void AddSeriesFlags(FlagSet* set, SeriesFlags* flags);

// All that the flags say of the source at `path`. REQUIRES: CheckUsage(source) is OK.
source::OpenRequest RequestOf(const SourceFlags& source, const SeriesFlags& series,
                              const std::string& path);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_SERIES_FLAGS_H_
