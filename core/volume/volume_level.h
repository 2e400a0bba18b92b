// Levels: coarser volumes that are made from the samples of a volume (docs/numerics.md, "Levels").
//
// Level 0 is the samples. Level l is a scalar volume of its own with half the samples of level
// l - 1 on each axis: sample (i, j, k) is the mean, or the majority, of the 2 x 2 x 2 samples from
// (2i, 2j, 2k) on. An odd last plane is left out. A sample lies at the centre of the samples that
// it was made from, so a plane in the data stays where it was:
//
//   level 0   0   1   2   3   4   5   6   7   8      9 samples
//   level 1     0       1       2       3            4 samples, the first at 0.5
//   level 2         0               1                2 samples, the first at 1.5
//
// All functions are pure and thread-safe. Their results are the same on every machine.

#ifndef ISOSCOPE_CORE_VOLUME_VOLUME_LEVEL_H_
#define ISOSCOPE_CORE_VOLUME_VOLUME_LEVEL_H_

#include <array>
#include <cstddef>
#include <cstdint>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

// How samples of a level are made from those of the level before.
enum class LevelFilter {
  kMean,      // NaN if any sample is NaN; integers round half to even
  kMajority,  // the most frequent value, the lowest one on ties; integers only
};
// Returns "mean" or "majority": the names in manifests and of the command line.
absl::string_view NameOf(LevelFilter filter);
// INVALID_ARGUMENT, listing the names, if there is none.
absl::StatusOr<LevelFilter> LevelFilterFromName(absl::string_view name);

// False for majorities of floats.
bool CanFilter(LevelFilter filter, ScalarType type);

// What a level is, whether it was written or not.
struct VolumeLevel {
  int index = 0;      // 0: the samples themselves
  GridGeometry grid;  // in the same world as level 0
  ScalarType type = ScalarType::kUint8;
  // A sample's value in field units is stored / value_scale: a power of two. Means of 8-bit samples
  // are stored in 16 bits with a scale of 256, everything else with 1.
  double value_scale = 1;

  friend bool operator==(const VolumeLevel&, const VolumeLevel&) = default;
};

// No volume has a higher level than this: axes have at most 2^24 samples.
inline constexpr int kMaxLevel = 23;

// Returns the samples of a level on each axis: those of level 0, shifted right.
math::Index3 LevelDims(const math::Index3& sample_dims, int level);
// Returns the highest level that has at least 2 samples on each axis. 0 to kMaxLevel.
int HighestLevel(const math::Index3& sample_dims);
// Returns the highest level that partitioning makes unless it is told otherwise: 0 for less than
// 512^3 samples; else the last one with more than about 45^3 samples, so that the coarsest has
// about 64^3, and with at least kMinAutoEdge samples on each axis.
int AutoHighestLevel(const math::Index3& sample_dims);
inline constexpr std::int64_t kMinAutoEdge = 16;

// Returns the sample type that a level >= 1 has if level 0 has samples of `type`.
ScalarType LevelType(ScalarType type, LevelFilter filter);
// Returns value_scale of a level >= 1 likewise.
double LevelValueScale(ScalarType type, LevelFilter filter);

// Returns level `level` of the volume `grid` of samples of `type`.
// REQUIRES: 0 <= level <= HighestLevel(grid.sample_dims); CanFilter(filter, type).
VolumeLevel LevelOf(const GridGeometry& grid, ScalarType type, LevelFilter filter, int level);

// Makes a row of a level from four rows of the level before.
//
// rows:  at (y, z) = (0, 0), (1, 0), (0, 1), (1, 1), each 2 * count samples of `type`; any alignment
// out:   count samples of `out_type`; must not overlap the rows; any alignment
//
// out_type: LevelType(type, filter) if the rows are level 0's; else `type`
// REQUIRES: CanFilter(filter, type).
void ReduceRows(ScalarType type, ScalarType out_type, LevelFilter filter,
                const std::array<const char*, 4>& rows, std::size_t count, char* out);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_VOLUME_LEVEL_H_
