#include "clients/cpp/request/level_flags.h"

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/request/parse_value.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/volume/volume_level.h"

namespace isoscope::client {
namespace {

constexpr char kLevelGroup[] = "Levels";

absl::StatusOr<std::int64_t> ParseLevel(absl::string_view text) {
  return ParseInteger(text, 0, volume::kMaxLevel);
}

}  // namespace

void AddMeshLevelFlag(cli::FlagSet* set, std::optional<std::int64_t>* level) {
  cli::AddFlag(set, "--level", "N", level, ParseLevel,
               "the level of the dataset: 0 (default) is its samples, and exact; each further one "
               "has half as many on each axis, and may lack what is thinner than one of its "
               "samples; `isoscope info` lists them")
      .Group(kLevelGroup);
}

void AddLevelFlags(cli::FlagSet* set, LevelFlags* flags) {
  AddMeshLevelFlag(set, &flags->level);
  cli::AddFlag(set, "--max-spacing", "PX", &flags->max_spacing_px, ParsePositiveNumber,
               "the coarsest level whose samples are at most this many pixels apart, where the "
               "volume is nearest to the eye; such as 1.1, which is quick and close to exact")
      .Group(kLevelGroup);
}

absl::Status CheckUsage(const LevelFlags& flags) {
  if (flags.level && flags.max_spacing_px) {
    return cli::UsageError("--level and --max-spacing exclude each other: both choose the level");
  }
  return absl::OkStatus();
}

void SetLevel(const LevelFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request) {
  if (flags.level) {
    request->mutable_level()->set_level(static_cast<std::int32_t>(*flags.level));
  } else if (flags.max_spacing_px) {
    request->mutable_level()->set_max_spacing_px(*flags.max_spacing_px);
  }
}

std::string TextOfLevel(const isoscope::v1::DrawnLevel& drawn) {
  if (drawn.level() == 0) {
    return "level 0 (exact)";
  }
  return absl::StrCat("level ", drawn.level(),
                      ", 1 sample = ", absl::StrFormat("%.2g px", drawn.max_spacing_px()));
}

}  // namespace isoscope::client
