// Which scalar of a dataset with fields is drawn, and when: flags of `render`, `pick` and `export`.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_SELECTION_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_SELECTION_FLAGS_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/flag_set.h"
#include "isoscope/v1/dataset.pb.h"

namespace isoscope::client {

// "NAME" or "NAME:COMPONENT", as of --field. The name is never empty; as it is parsed it is the
// whole text, which ResolveNames (dataset_fields.h) or the server splits: names may have colons.
struct FieldValue {
  std::string name;
  std::string component = {};  // may be empty: the only one, the magnitude, or still in `name`

  friend bool operator==(const FieldValue&, const FieldValue&) = default;
};
absl::StatusOr<FieldValue> ParseField(absl::string_view text);

// "N" from 0, "first" or "last"; the last one is -1, as in FieldSelection.time_step.
absl::StatusOr<std::int64_t> ParseStep(absl::string_view text);

struct SelectionFlags {
  std::optional<FieldValue> field = std::nullopt;
  std::optional<std::string> component = std::nullopt;
  std::optional<double> time = std::nullopt;
  std::optional<std::int64_t> step = std::nullopt;

  [[nodiscard]] bool empty() const { return !field && !component && !time && !step; }
};

// `flags` must outlive the parsing.
void AddSelectionFlags(cli::FlagSet* set, SelectionFlags* flags);

// UsageError if flags contradict each other. Names are the server's to check.
absl::Status CheckUsage(const SelectionFlags& flags);

// Unset if no flag is given. REQUIRES: CheckUsage(flags) is OK.
std::optional<isoscope::v1::FieldSelection> ToProto(const SelectionFlags& flags);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_SELECTION_FLAGS_H_
