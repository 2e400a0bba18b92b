// The levels of a volume that the cluster can draw, and who draws them.
//
// A level is drawn by agents whose shards have it. An agent that lacks it goes on with level 0, so a
// dataset may get its levels shard by shard. A level is served once every served shard has it.
// Levels of two filters never mix in a picture.

#ifndef ISOSCOPE_SERVER_CLUSTER_SERVED_LEVELS_H_
#define ISOSCOPE_SERVER_CLUSTER_SERVED_LEVELS_H_

#include <map>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/view/level_choice.h"
#include "core/volume/inside_rule.h"
#include "core/volume/volume_level.h"
#include "isoscope/v1/dataset.pb.h"
#include "server/cluster/frame_part.h"

namespace isoscope::server {

// An agent with a shard.
struct ShardOwner {
  ServingAgent agent;
  bool is_draining = false;
};

// Groups shards by their agents. Draining agents count only where all of a shard's are. Shards
// without agents are left out. Sets stand in order of their first shards.
//
// owners: by shard; by address
std::vector<ReplicaSet> GroupByAgents(const std::map<int, std::vector<ShardOwner>>& owners);

// The levels of a shard that an agent has, or of several volumes of it: those that all have.
struct OwnedLevels {
  std::vector<int> levels;  // ascending, 1 to volume::kMaxLevel
  volume::LevelFilter filter = volume::LevelFilter::kMean;
};

struct LevelOwner : ShardOwner {
  OwnedLevels owned = {};
};

// A level that can be drawn.
struct ServedLevel {
  int level = 0;  // at least 1
  volume::LevelFilter filter = volume::LevelFilter::kMean;
  std::vector<ReplicaSet> replica_sets;  // of all shards that are served
};

// Returns the levels that can be drawn, ascending. If agents have levels of both filters, those of
// means count where every shard has them.
//
// owners: by shard; by address
std::vector<ServedLevel> ServedLevelsOf(const std::map<int, std::vector<LevelOwner>>& owners);

// Describes the levels for clients. REQUIRES: geometry and blocks of `dataset` validate, and its grid
// has all of the levels.
void AddLevels(const std::vector<ServedLevel>& levels, isoscope::v1::Dataset* dataset);

// Returns true if the surface can be drawn on levels of this filter: an isovalue on means, labels on
// majorities.
bool FitsLevels(const volume::InsideRule& rule, volume::LevelFilter filter);

// Returns the level of a frame: null for level 0. FAILED_PRECONDITION if a level is named that is not
// served, or that a surface does not fit; the message lists the levels, and says how to get others.
// A level that is not named is the coarsest served one that is fine enough, or level 0 if a surface
// does not fit. The result points into `levels`.
//
// dataset:         names the dataset in messages; level 0's geometry
// pixels_per_unit: as view::PixelsPerUnit has it
absl::StatusOr<const ServedLevel*> ChooseLevel(const std::vector<ServedLevel>& levels,
                                               const isoscope::v1::Dataset& dataset,
                                               const volume::GridGeometry& grid,
                                               const std::vector<volume::InsideRule>& rules,
                                               const view::LevelChoice& choice,
                                               double pixels_per_unit);

// Returns the coarsest level that the surfaces can be drawn from; 0 if that is level 0.
int CoarsestOf(const std::vector<ServedLevel>& levels,
               const std::vector<volume::InsideRule>& rules);

// Returns `chosen`, or the first level that is at least `least`, whichever is coarser: the coarsest
// one if there is none. `chosen` if a surface does not fit the levels.
const ServedLevel* CoarserOf(const std::vector<ServedLevel>& levels,
                             const std::vector<volume::InsideRule>& rules,
                             const ServedLevel* chosen, int least);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_SERVED_LEVELS_H_
