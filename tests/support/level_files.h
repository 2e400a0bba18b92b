// Levels for datasets of tests, made by themselves: each is partitioned as a volume of its own, and
// its shards are moved into those of the dataset. It does not use what partitioning does for levels.

#ifndef ISOSCOPE_TESTS_SUPPORT_LEVEL_FILES_H_
#define ISOSCOPE_TESTS_SUPPORT_LEVEL_FILES_H_

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/store/manifest.h"
#include "core/volume/volume_level.h"

namespace isoscope::testing {

// Returns the samples of the next level: `level` describes those given, [z][y][x], x fastest.
std::string ReducedSamples(const std::string& samples, const volume::VolumeLevel& level,
                           const volume::VolumeLevel& next, volume::LevelFilter filter);

// Gives a dataset without levels levels 1 to `highest`. Returns its new manifest. Each shard must get
// a block of each level.
//
// samples: of level 0, [z][y][x], x fastest
absl::StatusOr<store::Manifest> AddLevelFiles(const std::string& directory,
                                              const std::string& samples, int highest,
                                              volume::LevelFilter filter);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_LEVEL_FILES_H_
