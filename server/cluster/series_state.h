// A series of the cluster: which agents serve which of its scalar volumes, and the choice of one.
//
// A scalar volume is offered once every shard of the series has it, on some agent of the crew that
// draws. Agents that lack it are not used for its frames; others go on with theirs. So agents can
// be given a new step one after the other while frames of old steps are drawn.
//
// The rest of the coordinator knows no fields: it works on the dataset of one volume, whose id,
// ranges and agents Select puts into a DatasetState of its own.

#ifndef ISOSCOPE_SERVER_CLUSTER_SERIES_STATE_H_
#define ISOSCOPE_SERVER_CLUSTER_SERIES_STATE_H_

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "core/store/series_manifest.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/cluster/frame_part.h"
#include "server/cluster/served_levels.h"

namespace isoscope::server {

struct DatasetState;

// An agent that serves one shard of a series.
struct SeriesOwner {
  ServingAgent agent;
  bool is_draining = false;
  // The dataset ids of the agent's volumes, by key.
  std::map<store::ScalarVolumeKey, std::string> volumes;
  // The levels of volumes that have any, by dataset id.
  std::map<std::string, OwnedLevels> levels;
};

// Immutable.
struct SeriesState {
  std::map<int, std::vector<SeriesOwner>> owners;  // by shard; by address
  // Dataset ids of the volumes that every shard of `owners` has.
  std::map<store::ScalarVolumeKey, std::string> offered;
  // The ranges of each volume's samples and gradients, by its dataset id.
  std::map<std::string, isoscope::v1::FieldComponent> ranges;
};

// Finds the volumes that are offered. If agents have different volumes of one key, it takes that of
// most agents among those that every shard has. Between equal ones the lesser id counts.
SeriesState MakeSeriesState(std::map<int, std::vector<SeriesOwner>> owners);

// Joins the descriptions of a series by its agents: the ranges and bounds are those of the longest,
// which has the most steps. Then leaves out the steps that are not offered, and sets the digests of
// the others.
isoscope::v1::Dataset JoinDescriptions(const std::vector<const isoscope::v1::Dataset*>& datasets,
                                       const SeriesState& series);

// Returns the levels of a volume that every shard has; none if the volume is not offered.
std::vector<ServedLevel> LevelsOf(const SeriesState& series, const store::ScalarVolumeKey& key);

// The ranges that a volume has at its own step, as a component has them over all steps.
isoscope::v1::FieldComponent RangesOf(const isoscope::internal::v1::VolumeDescription& volume);

// A component of a field, and its volume at the step that was chosen.
struct FieldVolume {
  std::string field;
  std::string component;
  std::string unit;
  std::string dataset_id;
};

// The choice of a request.
struct SelectedVolume {
  std::shared_ptr<const DatasetState> dataset;  // of the volume; its ranges are those of all steps
  isoscope::v1::FieldComponent at_step;         // the volume's own ranges
  // One for each surface of the frame; "": it is not coloured by a field. Empty: none is.
  std::vector<std::string> color_dataset_ids;
  std::optional<isoscope::v1::FieldSelection> selection;  // with all members; not set: no fields
  std::optional<double> time;
  std::vector<FieldVolume> all_fields;  // in the order of the dataset, if they were asked for
};

// Chooses a scalar volume of a dataset. A dataset without fields is its own volume.
//
// selection: null: the default
// surfaces:  those of the frame, or none; ranges of colours by a field are set where they are not,
//            those of what is visible to the default
//
// with_all_fields: whether the values of all fields are asked for, too
//
// UNAVAILABLE: no agent has all volumes of a shard that the frame needs. INVALID_ARGUMENT: a field
// or component that the dataset does not have (lists them), one or a time or all fields of a
// dataset without fields, which has step 0 alone; a time that is not finite. NOT_FOUND: a step that
// is not served (says which are). FAILED_PRECONDITION: none is.
absl::StatusOr<SelectedVolume> SelectVolume(const std::shared_ptr<const DatasetState>& dataset,
                                            const isoscope::v1::FieldSelection* selection,
                                            std::vector<frame::Surface>* surfaces,
                                            bool with_all_fields = false);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_SERIES_STATE_H_
