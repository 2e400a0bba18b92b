// The shards that an agent serves, of any datasets.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "google/protobuf/repeated_field.h"

#include "core/volume/grid_geometry.h"
#include "partition-agent/shard/series_shard.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

using SeriesShards = std::vector<std::shared_ptr<SeriesShard>>;

// The shards of a level of a volume.
struct LevelShards {
  Shards shards;
  volume::GridGeometry whole;  // of level 0: frames of all levels have its clip planes
  double value_scale = 1;      // volume::VolumeLevel::value_scale
};

// Thread-safe. Dataset ids are those of datasets, or of scalar volumes of a series.
class ShardSet {
 public:
  // Coordinators and clients ask again after this time while shards are being opened.
  static constexpr absl::Duration kOpeningDelay = absl::Seconds(1);

  // The shards are being opened: call Fill once they are.
  ShardSet() = default;
  explicit ShardSet(Shards shards, SeriesShards series = {}) {
    Fill(std::move(shards), std::move(series));
  }
  ShardSet(const ShardSet&) = delete;
  ShardSet& operator=(const ShardSet&) = delete;

  // Call it once.
  void Fill(Shards shards, SeriesShards series);
  [[nodiscard]] bool is_filled() const { return is_filled_.load(std::memory_order_acquire); }

  // Finds the shards of a dataset by index, and opens those of a series. UNAVAILABLE
  // (ErrorReason::kAgentOpening) before Fill. FAILED_PRECONDITION names
  // the dataset or shard that is not served; INVALID_ARGUMENT if the indices are malformed; of a
  // series also errors as SeriesShard::OpenVolume. O(shards). May block on the disk.
  [[nodiscard]] absl::StatusOr<Shards> Find(
      const std::string& dataset_id,
      const google::protobuf::RepeatedField<std::int32_t>& shard_indices,
      SeriesShard::Opening opening = SeriesShard::Opening::kForFrame) const;
  // Finds the shards of a level, 0 to volume::kMaxLevel. Errors as Find; FAILED_PRECONDITION names a
  // shard that lacks the level.
  [[nodiscard]] absl::StatusOr<LevelShards> FindLevel(
      const std::string& dataset_id,
      const google::protobuf::RepeatedField<std::int32_t>& shard_indices, int level,
      SeriesShard::Opening opening = SeriesShard::Opening::kForFrame) const;
  // Returns some shard of a level of a dataset that is served, for what all shards have. Errors as
  // FindLevel.
  [[nodiscard]] absl::StatusOr<LevelShards> FindAny(const std::string& dataset_id,
                                                    int level = 0) const;

  // Those of datasets without fields. None before Fill; then they stay.
  [[nodiscard]] const Shards& plain() const { return is_filled() ? shards_ : kNoShards; }
  [[nodiscard]] const SeriesShards& series() const { return is_filled() ? series_ : kNoSeries; }
  [[nodiscard]] std::size_t size() const { return plain().size() + series().size(); }

 private:
  // One shard of a dataset that is served; of a series it is open or can be opened.
  struct Served {
    const std::shared_ptr<const Shard>* plain = nullptr;
    SeriesShard* series = nullptr;
    [[nodiscard]] int index() const;
    [[nodiscard]] absl::StatusOr<std::shared_ptr<const Shard>> Open(
        const std::string& dataset_id, int level, SeriesShard::Opening opening) const;
    // Returns a level without shards.
    [[nodiscard]] LevelShards DescribeLevel(const std::string& dataset_id, int level) const;
  };
  // FAILED_PRECONDITION if there are none.
  [[nodiscard]] absl::StatusOr<std::vector<Served>> ServedOf(const std::string& dataset_id) const;

  static inline const Shards kNoShards{};
  static inline const SeriesShards kNoSeries{};

  std::atomic<bool> is_filled_{false};
  Shards shards_;  // both never change once is_filled_ is set
  SeriesShards series_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_
