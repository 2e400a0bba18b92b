// The flags of the level of a frame or of a mesh: by number, or by the distance of its samples on the
// screen (isoscope.v1.LevelChoice).

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_LEVEL_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_LEVEL_FLAGS_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"

#include "core/cli/flag_set.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// Neither is given: level 0, which is exact.
struct LevelFlags {
  std::optional<std::int64_t> level = std::nullopt;     // 0 to volume::kMaxLevel
  std::optional<double> max_spacing_px = std::nullopt;  // above 0
};

// Registers --level and --max-spacing. `flags` must outlive the parsing.
void AddLevelFlags(cli::FlagSet* set, LevelFlags* flags);
// Registers --level alone: a mesh has no screen.
void AddMeshLevelFlag(cli::FlagSet* set, std::optional<std::int64_t>* level);

// UsageError if both are given.
absl::Status CheckUsage(const LevelFlags& flags);

// Writes the choice into the request; does nothing without one.
void SetLevel(const LevelFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request);

// Returns "level 2, 1 sample = 0.9 px" for people, and "level 0 (exact)".
std::string TextOfLevel(const isoscope::v1::DrawnLevel& drawn);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_LEVEL_FLAGS_H_
