// The flags for levels: coarser volumes beside the samples of a dataset.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_LEVEL_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_LEVEL_FLAGS_H_

#include <optional>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/flag_set.h"
#include "core/partition/level_plan.h"

namespace isoscope::cli {

struct LevelFlags {
  std::optional<int> highest;  // as LevelOptions::highest
  bool are_labels = false;

  // The first flag given, or null.
  [[nodiscard]] const char* FirstGiven() const;
};

// `flags` must outlive the parsing.
void AddLevelFlags(FlagSet* set, LevelFlags* flags);

// "auto", "none" or a number from 0 on.
absl::StatusOr<int> ParseLevels(absl::string_view text);

// Levels as they are asked for: kAuto unless --levels says otherwise.
partition::LevelOptions LevelOptionsOf(const LevelFlags& flags);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_LEVEL_FLAGS_H_
