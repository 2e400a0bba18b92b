#include "client-cli/session/level_flags.h"

#include <cstdint>

#include "absl/strings/str_cat.h"

#include "clients/cpp/request/parse_value.h"
#include "core/cli/flags.h"
#include "core/volume/volume_level.h"

namespace isoscope::cli {

const char* LevelFlags::FirstGiven() const {
  return highest ? "--levels" : are_labels ? "--label-levels" : nullptr;
}

void AddLevelFlags(FlagSet* set, LevelFlags* flags) {
  AddFlag(set, "--levels", "auto|none|N", &flags->highest, ParseLevels,
          "coarser volumes to make beside the samples, each with half of them on each axis: N, "
          "none, or auto: from 512 x 512 x 512 samples on, down to about 64 x 64 x 64 (default: "
          "auto)");
  set->AddSwitch("--label-levels", &flags->are_labels,
                 "samples of levels are the most frequent of eight, not their mean: for labels "
                 "(default: where values have names)");
}

absl::StatusOr<int> ParseLevels(absl::string_view text) {
  if (text == "auto") {
    return partition::LevelOptions::kAuto;
  }
  if (text == "none") {
    return 0;
  }
  const absl::StatusOr<std::int64_t> number = client::ParseInteger(text, 0, volume::kMaxLevel);
  if (!number.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", text, "' is neither auto, none nor a whole number from 0 to ", volume::kMaxLevel));
  }
  return static_cast<int>(*number);
}

partition::LevelOptions LevelOptionsOf(const LevelFlags& flags) {
  partition::LevelOptions options;
  options.highest = flags.highest.value_or(partition::LevelOptions::kAuto);
  if (flags.are_labels) {
    options.filter = volume::LevelFilter::kMajority;
  }
  return options;
}

}  // namespace isoscope::cli
